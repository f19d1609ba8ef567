"""The zoo: shapes, wiring and the paper's parameter counts."""

import json
from pathlib import Path

import pytest
import torch

from nunet_models.errors import ConfigError, with_hint
from nunet_models.experiments.plan import read_plan
from nunet_models.export.collections import TINY_ARCHITECTURES, tiny_spec
from nunet_models.export.metadata import describe_components
from nunet_models.zoo import PAPER_DECODER, GraphSpec, SerialGraph, graph_spec
from nunet_models.zoo.backbones import build_unet
from nunet_models.zoo.spec import ComponentSpec, decoder_channels, decoder_name
from nunet_models.zoo.weights import begin_with, imagenet_encoder, like_component


def parameters(module):
    return sum(p.numel() for p in module.parameters())


@pytest.mark.parametrize(
    "architecture", [*TINY_ARCHITECTURES, "rcnn1", "wnet_c_gru", "wnet_c_auto"]
)
def test_every_architecture_gives_raw_numbers_of_its_size(architecture):
    spec = tiny_spec(architecture)
    outputs = SerialGraph(spec).eval()(torch.zeros(2, 3, *spec.inner_size))
    wanted = [(2, spec.outputs_of(c), *spec.inner_size) for c in spec.components]
    assert [tuple(o.shape) for o in outputs] == wanted


@pytest.mark.parametrize("architecture", TINY_ARCHITECTURES)
def test_a_spec_survives_json(architecture):
    spec = tiny_spec(architecture)
    assert GraphSpec.from_json(json.loads(json.dumps(spec.to_json()))) == spec


def test_the_units_of_a_state_have_the_key_that_they_always_had_in_checkpoints():
    written = tiny_spec("wnet_c_lstm").to_json()["components"]
    assert [component["memory"] for component in written] == [0, 4]
    assert not any("state_units" in component for component in written)


def test_a_component_of_an_older_file_has_the_default_of_what_the_file_lacks():
    older = {"name": "depth", "task": "depth", "backbone": "tiny", "decoder_channels": [8] * 5}
    assert ComponentSpec.from_json(older) == ComponentSpec(
        "depth", "depth", "tiny", decoder_channels=(8,) * 5
    )
    assert ComponentSpec.from_json({**older, "memory": 3}).state_units == 3


def test_a_state_of_a_network_without_a_bottleneck_is_refused():
    with pytest.raises(ConfigError, match=r"`depth` of `wnet_c_lstm`.* backbone `cnn`") as raised:
        graph_spec("wnet_c_lstm", backbone="tiny,cnn")
    assert raised.value.hint


def test_the_paper_s_networks_have_its_parameter_counts():
    # Keras: conv 2280 + 4065, dense 35796608 + 2 * 16512 + 8256 + 4160 + 19968000
    cnn = graph_spec("cnn", inner_size=(480, 640))
    # Keras: conv 9030 + 16215, LSTM 2217984 + 2099200, dense 262656 + 65664 + 39628800
    rcnn = graph_spec("rcnn", inner_size=(480, 640))
    with torch.device("meta"):
        assert parameters(build_unet("resnet34", in_channels=3, out_channels=1,
                                     decoder_channels=PAPER_DECODER)) == 24_436_369  # fmt: skip
    assert parameters(SerialGraph(cnn)) == 55_816_393
    assert parameters(SerialGraph(rcnn)) == 44_299_549
    # without the second LSTM and the dense layer before it
    rcnn1 = graph_spec("rcnn1", inner_size=(480, 640))
    assert parameters(SerialGraph(rcnn1)) == 44_299_549 - 2_099_200 - 262_656


def test_each_pool_of_the_recurrent_network_is_followed_by_dropout_as_in_the_paper_s_code():
    layers = [
        type(layer).__name__
        for layer in SerialGraph(tiny_spec("rcnn1")).components[0].dense.features
    ]
    assert layers == ["Conv2d", "ReLU", "MaxPool2d", "Dropout"] * 2


def test_the_single_u_net_of_the_controls_is_as_large_as_w_net_connected():
    plan = read_plan(Path(__file__).parents[1] / "lists" / "size.toml")
    wide = decoder_channels(plan.networks["wide"][-1])
    single = graph_spec("unet", decoder=wide, inner_size=(120, 160))
    double = graph_spec("wnet_c", inner_size=(120, 160))
    found = [describe_components(SerialGraph(spec).eval()) for spec in (single, double)]
    for size in ("parameters", "gflop"):
        alone, both = (sum(component[size] for component in of) for of in found)
        assert alone == pytest.approx(both, rel=0.005), size


def test_a_decoder_is_named_or_listed():
    assert decoder_channels("paper") == PAPER_DECODER
    assert decoder_channels("160,96,64,48,24") == (160, 96, 64, 48, 24)
    assert decoder_name(PAPER_DECODER) == "paper"
    assert decoder_name((160, 96, 64, 48, 24)) == "160,96,64,48,24"


@pytest.mark.parametrize(
    "text", ["heavy", "1,2,3,4", "0,1,2,3,4", "8,8,8,8,-8", "8,8,8,8,", "1.5,2,3,4,5"]
)
def test_another_decoder_is_refused(text):
    with pytest.raises(ConfigError) as raised:
        decoder_channels(text)
    assert (
        str(raised.value) == f"`--decoder {text}`; expected lite or paper, or 5 numbers of filters"
    )
    assert raised.value.hint == "`lite` is 128,64,48,32,16"


def test_a_connected_component_sees_the_image_and_a_plain_one_does_not():
    for architecture, channels in (("wnet", 13), ("wnet_c", 16)):
        graph = SerialGraph(tiny_spec(architecture))
        assert graph.components[1].unet.encoder.stages[0][0].in_channels == channels


def test_logits_cross_the_joint_and_a_sigmoid_only_where_it_is_kept():
    spec = tiny_spec("wnet")
    logits = torch.randn(1, 13, 96, 128)
    assert SerialGraph(spec).joint(torch.zeros(1, 3, 96, 128), [logits]) is logits
    first, second = spec.components
    kept = GraphSpec(
        "wnet",
        (first.changed(sigmoid_joint=True), second),
        input_size=(96, 128),
        inner_size=(96, 128),
    )
    joint = SerialGraph(kept).joint(torch.zeros(1, 3, 96, 128), [logits])
    assert torch.equal(joint, logits.sigmoid())


def test_a_run_continues_from_the_raw_numbers_of_earlier_components():
    graph = SerialGraph(tiny_spec("nunet3_c")).eval()
    image = torch.randn(1, 3, 96, 128)
    outputs = graph(image)
    rest = graph.run(image, graph.components[2:], before=[-outputs[0], outputs[1]])
    assert torch.equal(rest[0], -outputs[0]) and torch.equal(rest[2], outputs[2])


def test_each_component_has_its_own_backbone():
    spec = graph_spec("nunet3_c", backbone="tiny,resnet18,mobilenet_v2")
    assert [c.backbone for c in spec.components] == ["tiny", "resnet18", "mobilenet_v2"]
    assert [c.task for c in spec.components] == ["segmentation", "depth", "depth"]


def test_tasks_and_kept_sigmoids_are_the_caller_s():
    spec = graph_spec("nunet4_c", tasks=("segmentation", "segmentation", "depth", "depth"))
    assert [c.name for c in spec.components] == [
        "segmentation",
        "segmentation2",
        "coarse2",
        "depth",
    ]
    paper = graph_spec("wnet", tasks=("depth", "depth"), sigmoid_joints=["depth1"])
    assert [paper.outputs_of(c) for c in paper.components] == [1, 1]
    assert [c.sigmoid_joint for c in paper.components] == [True, False]


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        (
            {"tasks": ("depth",)},
            "`depth` do not fit `wnet` of 2 components",
        ),
        (
            {"tasks": ("color", "depth")},
            "of segmentation, normals, objectness or depth, one per component",
        ),
        ({"tasks": ("depth", "segmentation")}, "must be of task `depth`"),
        ({"sigmoid_joints": ["depth"]}, "no component `depth` whose numbers another one reads"),
    ],
)
def test_tasks_and_sigmoids_that_do_not_fit_are_refused(changes, word):
    with pytest.raises(ConfigError) as raised:
        graph_spec("wnet", **changes)
    assert word in with_hint(str(raised.value), raised.value.hint)


@pytest.mark.parametrize(
    ("architecture", "backbone", "word"),
    [
        ("znet", "tiny", "no architecture `znet`"),
        ("wnet", "tiny,tiny,tiny", "3 backbones"),
        ("unet", "resnet9000", "no backbone `resnet9000`"),
        ("unet", "tu-nonsense", r"a U-Net from backbone `tu-nonsense`: "),
        ("unet", "vit_tiny_patch16_224", r"a U-Net from backbone `vit_tiny_patch16_224`: "),
    ],
)
def test_unknown_names_are_refused_with_a_hint(architecture, backbone, word):
    with pytest.raises(ConfigError, match=word) as raised:
        SerialGraph(graph_spec(architecture, backbone=backbone))
    assert raised.value.hint


def test_an_inner_size_that_does_not_divide_is_refused():
    with pytest.raises(ConfigError, match="whole factor"):
        graph_spec("unet", inner_size=(224, 320))


@pytest.mark.parametrize("architecture", ["wnet_c_lstm", "wnet_c_gru"])
def test_an_untrained_state_changes_nothing_and_is_carried(architecture):
    graph = SerialGraph(tiny_spec(architecture)).eval()
    image = torch.randn(1, 3, 96, 128)
    state = graph.components[-1].no_state()
    first, state = graph.with_state(image, state)
    assert torch.allclose(first[-1], graph(image)[-1])
    assert state[0].abs().sum() > 0
    torch.nn.init.ones_(graph.components[-1].memory.widen.weight)
    fresh, _ = graph.with_state(image, graph.components[-1].no_state())
    again, _ = graph.with_state(image, state)
    assert not torch.allclose(fresh[-1], again[-1])


def test_a_state_fits_a_backbone_whose_pools_round_down():
    spec = graph_spec("wnet_c_lstm", backbone="tiny,vgg16")
    spec = spec.with_sizes(input_size=(112, 144), inner_size=(112, 144))
    graph = SerialGraph(spec).eval()
    state = graph.components[-1].no_state()
    assert state[0].shape == (1, 64, 3, 4)  # 112 / 32 and 144 / 32, rounded down
    with torch.no_grad():
        outputs, left = graph.with_state(torch.zeros(1, 3, 112, 144), state)
    assert outputs[-1].shape == (1, 1, 112, 144) and left[0].shape == state[0].shape


def test_imagenet_weights_leave_further_input_channels_at_zero():
    graph = SerialGraph(graph_spec("wnet_c"))
    for component in graph.components:
        imagenet_encoder(component)
    first, second = (c.unet.encoder.model.conv_stem.weight for c in graph.components)
    assert torch.equal(first, second[:, :3])
    assert second[:, 3:].abs().sum() == 0


def test_no_imagenet_weights_is_said_by_name():
    with pytest.raises(ConfigError, match="no ImageNet weights for backbone `tiny`"):
        imagenet_encoder(SerialGraph(tiny_spec("unet")).components[0])


def test_a_component_can_start_as_an_earlier_one():
    graph = SerialGraph(tiny_spec("wnet_c"))
    like_component(graph.components[1], graph.components[0])
    theirs, ours = (c.unet.encoder.stages[0][0].weight for c in graph.components)
    assert torch.equal(ours[:, :3], theirs) and ours[:, 3:].abs().sum() == 0
    assert graph.components[1].head.weight.shape[0] == 1


def test_a_component_can_begin_with_one_that_saw_more_or_less():
    alone = SerialGraph(tiny_spec("unet")).component("depth")
    connected = SerialGraph(tiny_spec("wnet_c")).component("depth")
    begin_with(alone, connected.state_dict())
    theirs, ours = (c.unet.encoder.stages[0][0].weight for c in (connected, alone))
    assert torch.equal(ours, theirs[:, :3]) and torch.equal(alone.head.bias, connected.head.bias)
    connected_again = SerialGraph(tiny_spec("wnet_c")).component("depth")
    begin_with(connected_again, alone.state_dict())
    ours = connected_again.unet.encoder.stages[0][0].weight
    assert torch.equal(ours[:, :3], theirs[:, :3]) and ours[:, 3:].abs().sum() == 0


def test_beginning_with_another_backbone_is_refused():
    alone = SerialGraph(tiny_spec("unet")).component("depth")
    with pytest.raises(ConfigError, match="do not fit component `depth`"):
        begin_with(alone, {})
