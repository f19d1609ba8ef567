"""The depth autoencoder, and its decoder in a network that reads images."""

import json
import math
from dataclasses import replace

import pytest
import torch
from conftest import write_dataset
from runs import rows, train

from nunet_models.cli import main
from nunet_models.data.batches import Batch
from nunet_models.errors import ConfigError
from nunet_models.export.collections import tiny_spec
from nunet_models.export.metadata import DATA_LICENSE
from nunet_models.export.model_file import Provenance, export_fused
from nunet_models.export.onnx_file import read_metadata
from nunet_models.export.untrained import untrained_graph
from nunet_models.training.inputs import network_input
from nunet_models.zoo import SerialGraph, graph_spec
from nunet_models.zoo.autoencoder import depth_planes, with_holes
from nunet_models.zoo.checkpoint import Checkpoint
from nunet_models.zoo.weights import imagenet_encoder, take_decoder

AUTO = ("--architecture", "autoencoder", "--no-bf16")
WNET = ("--architecture", "wnet_c_auto", "--no-bf16")
DECODER = ("unet.decoder.", "unet.segmentation_head.")


@pytest.fixture(scope="module")
def auto(tmp_path_factory):
    """A dataset, and the run of an autoencoder that was trained on it."""
    folder = tmp_path_factory.mktemp("auto")
    write_dataset(folder / "rooms")
    monkeypatch = pytest.MonkeyPatch()
    monkeypatch.setattr("nunet_models.training.trainer.LOG_EVERY", 1)
    how = (*AUTO, "--ema", "0.5", "--validate-every", "20", "--lr", "0.003")
    done = train(folder / "rooms", folder / "run", *how, component="depth", epochs=40)
    monkeypatch.undo()
    assert done == 0
    return folder / "rooms", folder / "run"


def decoder_of(weights):
    return {name: weight for name, weight in weights.items() if name.startswith(DECODER)}


# the network


def test_the_autoencoder_reads_the_logarithm_of_depth_and_where_it_is_known():
    depth_m = torch.tensor([math.e, 1.0, math.nan, 0.0]).reshape(1, 1, 1, 4)
    value, known = depth_planes(depth_m)[0]
    assert value.tolist() == [[pytest.approx(0.0, abs=1e-6), -1.0, 0.0, 0.0]]
    assert known.tolist() == [[1.0, 1.0, 0.0, 0.0]]


def test_holes_are_of_another_share_in_each_image_and_change_no_depth():
    torch.manual_seed(1)
    depth_m = torch.rand(40, 1, 120, 160) + 1.0
    seen = with_holes(depth_m)
    known = seen.isfinite()
    assert torch.equal(seen[known], depth_m[known])
    shares = 1.0 - known.float().mean(dim=(1, 2, 3))
    assert shares.min() < 0.1 and 0.35 < shares.max() < 0.7


def test_only_learning_hides_depth():
    torch.manual_seed(1)
    depth_m = torch.rand(2, 1, 96, 128) + 1.0
    batch = Batch(torch.zeros(2, 3, 96, 128), depth_m, torch.zeros(2, 96, 128))
    spec = tiny_spec("autoencoder")
    whole = network_input(spec, batch, learning=False)
    assert torch.equal(whole, depth_planes(depth_m))
    assert network_input(spec, batch, learning=True)[:, 1].mean() < 1.0
    image = network_input(tiny_spec("unet"), batch, learning=True)
    assert image.shape == (2, 3, 96, 128)


def test_the_decoder_sees_the_latent_map_alone():
    component = SerialGraph(tiny_spec("wnet_c_auto")).eval().component("depth")
    maps = list(component.unet.encoder(torch.rand(1, 16, 96, 128)))
    others = [torch.rand_like(found) for found in maps[:-1]]
    raw = component._decoded(maps)
    assert raw.shape == (1, 1, 96, 128)
    assert torch.equal(raw, component._decoded([*others, maps[-1]]))
    assert not torch.equal(raw, component._decoded([*maps[:-1], maps[-1] + 1.0]))


def test_a_confidence_head_reads_the_decoder_s_maps():
    graph = untrained_graph(replace(tiny_spec("wnet_c_auto"), confidence=True), seed=1)
    image = torch.rand(1, 3, 96, 128)
    outputs, log_error = graph.with_confidence(image)
    assert torch.equal(outputs[-1], graph(image)[-1])
    assert log_error.std() > 0.0
    with pytest.raises(ConfigError, match="cannot have a confidence head"):
        replace(tiny_spec("autoencoder"), confidence=True)


def test_depth_is_read_by_a_single_component_only():
    spec = tiny_spec("wnet_c_auto")
    second = spec.components[1].changed(reads="depth")
    with pytest.raises(ConfigError, match="only a single component can read depth"):
        replace(spec, components=(spec.components[0], second))


def test_the_encoder_of_depth_can_start_from_imagenet():
    components = [
        SerialGraph(graph_spec(name)).component("depth") for name in ("autoencoder", "unet")
    ]
    for component in components:
        imagenet_encoder(component)
    depth, image = (c.unet.encoder.model.conv_stem.weight for c in components)
    assert torch.equal(depth, image[:, :2])


# training


def test_the_autoencoder_learns_to_return_depth(auto):
    _, run = auto
    losses = [float(row["loss"]) for row in rows(run, "steps.csv")]
    assert sum(losses[-4:]) < 0.5 * sum(losses[:4])
    first, last = (float(row["rmse"]) for row in rows(run, "epochs.csv"))
    assert last < 0.5, "0.87 m is the standard deviation of its depth"
    best = min(first, last)
    assert Checkpoint.load(run / "best.pt").history["depth"][-1]["rmse"] == pytest.approx(best)


@pytest.mark.parametrize("frozen", [True, False])
def test_its_decoder_is_plugged_in_and_kept_or_trained_on(auto, tmp_path, frozen):
    dataset, run = auto
    plug = ("--plug-decoder", str(run / "best.pt"), *["--freeze-decoder"] * frozen)
    assert train(dataset, tmp_path, *WNET, *plug, component="depth", epochs=1) == 0
    checkpoint = Checkpoint.load(tmp_path / "best.pt")
    its = decoder_of(Checkpoint.load(run / "best.pt").component_weights("depth"))
    mine = checkpoint.component_weights("depth")
    assert any(name.endswith("running_mean") for name in its)
    unchanged = [torch.equal(mine[name], weight) for name, weight in its.items()]
    assert all(unchanged) if frozen else sum(unchanged) < len(unchanged) / 2
    origin = checkpoint.provenance["depth"]["origin"]
    assert origin["plug_decoder"]["file"] == "best.pt"
    assert origin.get("freeze_decoder", False) is frozen


def test_encoder_and_adapter_learn_before_a_frozen_decoder():
    torch.manual_seed(2)
    component = SerialGraph(tiny_spec("wnet_c_auto")).component("depth")
    component.freeze_decoder()
    component.train()
    means = component.unet.decoder.blocks[0].conv1[1].running_mean.clone()
    component(torch.rand(2, 16, 96, 128)).square().sum().backward()
    learning = {name for name, p in component.named_parameters() if p.grad is not None}
    assert "adapter.0.weight" in learning and "unet.encoder.stages.0.0.weight" in learning
    assert not any(name.startswith(DECODER) for name in learning)
    assert torch.equal(component.unet.decoder.blocks[0].conv1[1].running_mean, means)
    assert component.adapter.training and component.unet.encoder.training


def test_a_run_with_a_frozen_decoder_resumes_to_the_same_losses(auto, tmp_path, every_step_logged):
    dataset, run = auto
    whole, halved = tmp_path / "whole", tmp_path / "halved"
    how = (*WNET, "--plug-decoder", str(run / "best.pt"), "--freeze-decoder")
    assert train(dataset, whole, *how, component="depth", epochs=1) == 0
    assert train(dataset, halved, *how, "--minutes", "1e-9", component="depth", epochs=1) == 0
    assert train(dataset, halved, *how, "--resume", component="depth", epochs=1) == 0
    losses = [[row["loss"] for row in rows(of, "steps.csv")] for of in (whole, halved)]
    assert losses[0] == losses[1] and len(losses[0]) == 2


def test_a_run_is_not_resumed_with_another_decoder(auto, tmp_path, capsys):
    dataset, run = auto
    how = (*WNET, "--plug-decoder", str(run / "best.pt"))
    assert train(dataset, tmp_path, *how, "--minutes", "1e-9", component="depth", epochs=1) == 0
    resumed = ("--resume", *WNET)
    assert train(dataset, tmp_path, *resumed, component="depth", epochs=1) == 1
    assert "was started with `--plug-decoder best.pt` (SHA-256 " in capsys.readouterr().err
    kept = (*how, "--resume", "--freeze-decoder")
    assert train(dataset, tmp_path, *kept, component="depth", epochs=1) == 1
    stderr = capsys.readouterr().err
    assert "was started with no `--freeze-decoder`, given `--freeze-decoder`" in stderr


@pytest.mark.parametrize(
    ("options", "status", "message"),
    [
        (
            ("--architecture", "wnet_c", "--plug-decoder", "{auto}"),
            2,
            "`--plug-decoder`: `depth` of `wnet_c` cannot take the decoder of an autoencoder",
        ),
        (
            (*AUTO, "--freeze-decoder"),
            2,
            "`--freeze-decoder`: `depth` of `autoencoder` cannot take the decoder",
        ),
        ((*WNET, "--freeze-decoder"), 2, "`--freeze-decoder` would keep random weights; hint: "),
        (
            (*WNET, "--plug-decoder", "{auto}", "--decoder", "8,8,8,6,4"),
            1,
            "has a decoder `lite` of 64 latent channels for metric depth; "
            "expected a decoder `8,8,8,6,4` of 64",
        ),
        (
            (*WNET, "--plug-decoder", "{auto}", "--encoding", "minmax"),
            1,
            "latent channels for metric depth; expected a decoder `lite` of 64 latent channels for "
            "minmax depth",
        ),
        ((*AUTO, "--show", "{rooms}/rgb/0000.png"), 2, "`--show` shows images to the network; "),
    ],
)
def test_what_does_not_fit_is_refused(auto, tmp_path, capsys, options, status, message):
    dataset, run = auto
    options = [o.format(auto=run / "best.pt", rooms=dataset) for o in options]
    assert train(dataset, tmp_path, *options, component="depth", epochs=1) == status
    assert message in capsys.readouterr().err
    assert not (tmp_path / "last.pt").exists()


def test_an_autoencoder_is_not_trained_on_a_dataset_list(tmp_path, capsys):
    (tmp_path / "sets.toml").write_text("")
    run = ("--run", str(tmp_path / "run"), "--component", "depth", "--epochs", "1")
    assert main(["train", *run, *AUTO, "--sets", str(tmp_path / "sets.toml")]) == 2
    assert "`--sets` shows images to the network; `autoencoder` reads depth" in (
        capsys.readouterr().err
    )


def test_the_decoder_of_a_u_net_is_refused(auto, tmp_path, capsys):
    dataset, _ = auto
    unet = tmp_path / "unet"
    assert train(dataset, unet, "--architecture", "unet", component="depth", epochs=1) == 0
    how = (*WNET, "--plug-decoder", str(unet / "best.pt"))
    assert train(dataset, tmp_path / "run", *how, component="depth", epochs=1) == 1
    assert "has a decoder `lite` of skip connections for metric depth; expected" in (
        capsys.readouterr().err
    )


def test_a_decoder_that_nobody_trained_is_neither_plugged_in_nor_kept(auto, tmp_path, capsys):
    dataset, _ = auto
    first = tmp_path / "first"
    assert train(dataset, first, *WNET, component="segmentation", epochs=1) == 0
    best, run = str(first / "best.pt"), tmp_path / "run"
    plug = (*WNET, "--plug-decoder", best)
    assert train(dataset, run, *plug, component="depth", epochs=1) == 1
    assert "its `depth` was not trained; hint: " in capsys.readouterr().err
    start = ("--no-bf16", "--start", best, "--freeze-decoder")
    assert train(dataset, run, *start, component="depth", epochs=1) == 2
    assert "`--freeze-decoder` would keep random weights" in capsys.readouterr().err


def test_a_network_with_another_input_or_decoder_is_not_begun_with(auto, tmp_path, capsys):
    dataset, run = auto
    for name in ("unet", "wnet_c_auto"):
        how = ("--architecture", name, "--begin-with", str(run / "best.pt"))
        assert train(dataset, tmp_path, *how, component="depth", epochs=1) == 1
        assert "`depth` of `autoencoder` has another input or decoder" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["autoencoder", "wnet_c_auto"])
def test_a_backbone_without_a_decoder_is_refused(name):
    with pytest.raises(ConfigError, match="has no U-Net decoder with backbone `cnn`"):
        graph_spec(name, backbone="cnn")


def test_weights_of_another_decoder_are_not_taken():
    component = SerialGraph(tiny_spec("wnet_c_auto")).component("depth")
    with pytest.raises(ConfigError, match="do not fit component `depth`"):
        take_decoder(component, SerialGraph(tiny_spec("unet")).component("depth").state_dict())


# model files


def test_a_network_with_the_decoder_is_exported_and_the_autoencoder_is_not(auto, tmp_path, capsys):
    export_fused(
        untrained_graph(tiny_spec("wnet_c_auto"), seed=1), tmp_path / "w.onnx", Provenance()
    )
    assert read_metadata(tmp_path / "w.onnx")["nunet.architecture"] == "wnet_c_auto"
    _, run = auto
    out = ("--out", str(tmp_path / "auto.onnx"))
    for source in (("--checkpoint", str(run / "best.pt")), ("--untrained", "autoencoder")):
        assert main(["export", *source, *out]) == 1
        assert "`autoencoder` reads depth, and a model file reads an image; hint: " in (
            capsys.readouterr().err
        )
    assert not (tmp_path / "auto.onnx").exists()


def test_a_file_names_data_and_license_of_a_decoder_that_was_plugged_in(auto, tmp_path, capsys):
    dataset, _ = auto
    owner, seg, depth, onward = (tmp_path / name for name in ("auto", "seg", "depth", "on"))
    camera = ("--intrinsics", "600,600,320,240@640x480")
    how = (*AUTO, *camera, "--license", "CC0, our rooms")
    assert train(dataset, owner, *how, component="depth", epochs=1) == 0
    assert train(dataset, seg, *WNET, component="segmentation", epochs=1) == 0
    plug = (*WNET, "--plug", f"segmentation={seg / 'best.pt'}")
    decoder = ("--plug-decoder", str(owner / "best.pt"))
    assert train(dataset, depth, *plug, *decoder, component="depth", epochs=1) == 0
    start = ("--start", str(depth / "best.pt"), "--no-bf16")
    assert train(dataset, onward, *start, component="depth", epochs=1) == 0

    its = Checkpoint.load(owner / "best.pt").provenance["depth"]
    for of in (depth, onward):
        capsys.readouterr()
        export = ["export", "--checkpoint", str(of / "best.pt"), "--out", str(tmp_path / "w.onnx")]
        assert main(export) == 0
        values = read_metadata(tmp_path / "w.onnx")
        known = json.loads(values["nunet.training"])["depth"]["decoder"]
        assert known["data"] == its["data"] and known["data"]["name"] == "rooms"
        assert known["license"] == "CC0, our rooms" and known["camera"]["fx"] == 600.0
        assert (known["component"], known["epochs_done"]) == ("depth", 1)
        assert values["nunet.license"] == (
            f"`segmentation`, `depth`: {DATA_LICENSE}; the decoder of `depth`: CC0, our rooms"
        )
        assert f"the license is `{values['nunet.license']}`" in capsys.readouterr().err


def test_a_decoder_of_another_camera_needs_a_license(auto, tmp_path, capsys):
    dataset, _ = auto
    owner, depth = tmp_path / "auto", tmp_path / "depth"
    camera = ("--intrinsics", "600,600,320,240@640x480")
    assert train(dataset, owner, *AUTO, *camera, component="depth", epochs=1) == 0
    how = (*WNET, "--unfrozen", "--plug-decoder", str(owner / "best.pt"))
    assert train(dataset, depth, *how, component="depth", epochs=1) == 0
    export = ["export", "--checkpoint", str(depth / "best.pt"), "--out", str(tmp_path / "w.onnx")]
    assert main(export) == 1
    assert "the decoder of `depth` of `" in capsys.readouterr().err
    assert main([*export, "--license", "CC BY 4.0"]) == 0
    assert read_metadata(tmp_path / "w.onnx")["nunet.license"] == "CC BY 4.0"
