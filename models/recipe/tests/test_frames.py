"""Training on frames of videos: windows, the state across them, and what is refused."""

import json

import numpy as np
import pytest
import torch
from runs import evaluate_tiny as evaluate
from runs import rows, train

from nunet_models.cli import main
from nunet_models.data.augment import NO_AUGMENTATION, Augmentation
from nunet_models.data.cache import Cached
from nunet_models.data.sequences import sequence_batches, video_of, window_starts
from nunet_models.export.collections import TINY_DECODER, tiny_spec
from nunet_models.export.onnx_file import read_metadata
from nunet_models.training.validate import predictions
from nunet_models.zoo import SerialGraph
from nunet_models.zoo.checkpoint import Checkpoint
from nunet_models.zoo.component import build_component
from nunet_models.zoo.recurrent import RECURRENT
from nunet_models.zoo.spec import ComponentSpec
from nunet_models.zoo.weights import begin_with

LSTM = ("--architecture", "wnet_c_lstm", "--no-bf16", "--augmentation", "none")
SIZE = (32, 64)


def video(ids):
    """Frame `k` is of gray level `k`, its right half brighter, at `k + 1` meters."""
    levels = np.arange(len(ids), dtype=np.uint8)[:, None, None]
    rgb = np.repeat((levels + np.zeros((1, *SIZE), np.uint8))[..., None], 3, axis=3)
    rgb[:, :, SIZE[1] // 2 :] += 100
    depth = ((levels.astype(np.uint16) + 1) * 5000) + np.zeros((1, *SIZE), np.uint16)
    return Cached(tuple(ids), rgb, depth, np.zeros((len(ids), *SIZE), np.uint8))


def batches(data, how=NO_AUGMENTATION, **more):
    options = {"frames": 3, "batch": 2, "seed": 0, "epoch": 0, "workers": 0}
    return list(sequence_batches(data, how, size=SIZE, **{**options, **more}))


def test_a_window_has_frames_of_one_video():
    ids = ["hall_08", "hall_09", "hall_10", "office_0", "office_1", "pan7"]
    assert [video_of(identity) for identity in ids] == ["hall_"] * 3 + ["office_"] * 2 + ["pan"]
    assert window_starts(ids, 2) == [0, 1, 3]
    assert window_starts(ids, 3) == [0]
    assert window_starts(ids, 7) == []


def test_a_batch_has_the_first_frame_of_every_window_then_the_second_ones():
    found = batches(video([f"{k:03d}" for k in range(6)]))
    assert [tuple(batch.rgb.shape) for batch in found] == [(6, 3, *SIZE)] * 2
    first = [batch.rgb[:2, 0, 0, 0].tolist() for batch in found]
    assert sorted(first[0] + first[1]) == [0, 1, 2, 3], "each window once"
    for batch in found:
        levels = batch.rgb[:, 0, 0, 0].reshape(3, 2)
        assert (levels.diff(dim=0) == 1).all()
        assert (batch.depth_m[:, 0, 0, 0].reshape(3, 2) == levels + 1).all()


def test_all_frames_of_a_window_are_mirrored_or_none():
    found = batches(video([str(k) for k in range(10)]), Augmentation(flip=0.5))
    mirrored = torch.stack([b.rgb[:, 0, 0, 0] > b.rgb[:, 0, 0, -1] for b in found]).reshape(
        -1, 3, 2
    )
    assert (mirrored == mirrored[:, :1]).all()
    assert mirrored.any() and not mirrored.all()


def test_a_resumed_epoch_continues_with_the_batches_that_are_left():
    data = video([str(k) for k in range(9)])
    whole, rest = batches(data), batches(data, first=2)
    assert len(whole) == 3 and len(rest) == 1
    assert torch.equal(whole[2].rgb, rest[0].rgb)


def recurrent(recurrence, size=SIZE):
    torch.manual_seed(0)
    spec = ComponentSpec("depth", "depth", "tiny", decoder_channels=TINY_DECODER)
    spec = spec.changed(state_units=8, recurrence=recurrence)
    return build_component(spec, in_channels=3, out_channels=1, size=size)


@pytest.mark.parametrize("recurrence", ["lstm", "gru"])
def test_frames_at_once_are_frames_one_after_another(recurrence):
    component = recurrent(recurrence).eval()
    torch.nn.init.ones_(component.memory.widen.weight)
    frames = torch.randn(3, 2, 3, *SIZE)
    state, expected = component.no_state(2), []
    with torch.no_grad():
        for frame in frames:
            raw, state = component.with_state(frame, state)
            expected.append(raw)
        found = component.over_frames(frames.flatten(0, 1), 3)
        torch.testing.assert_close(found, torch.cat(expected))
        assert not torch.allclose(found[2:], component(frames[1:].flatten(0, 1)))


def test_batch_norm_has_the_statistics_of_all_frames_of_a_step():
    component = recurrent("lstm").train()
    norms = [m for m in component.modules() if isinstance(m, torch.nn.BatchNorm2d)]
    component.over_frames(torch.randn(6, 3, *SIZE), 3)
    assert norms
    assert {int(norm.num_batches_tracked) for norm in norms} == {1}


@pytest.mark.parametrize("recurrence", ["lstm", "gru"])
def test_what_only_the_first_frame_shows_is_learned_for_the_later_ones(recurrence):
    torch.manual_seed(0)
    layer = RECURRENT[recurrence](2, 8)
    optimizer = torch.optim.Adam(layer.parameters(), lr=2e-2)
    losses = []
    for _ in range(200):
        level = torch.randint(0, 2, (32, 1, 1, 1)) * 2.0 - 1.0
        state = tuple(torch.zeros(32, 8, 1, 1) for _ in layer.state)
        _, *state = layer(level.expand(32, 2, 1, 1), *state)
        error = 0.0
        for noise in 0.3 * torch.randn(2, 32, 2, 1, 1):
            answer, *state = layer(noise, *state)
            error = error + (answer - noise - level).square().mean() / 2
        optimizer.zero_grad()
        error.backward()
        optimizer.step()
        losses.append(error.item())
    assert losses[0] == pytest.approx(1.0), "the error without a state"
    assert np.mean(losses[-20:]) < 0.1


def test_validation_starts_each_video_without_a_state():
    torch.manual_seed(0)
    graph = SerialGraph(tiny_spec("wnet_c_lstm")).eval()
    torch.nn.init.ones_(graph.components[-1].memory.widen.weight)
    how = {"component": 1, "batch": 8, "bf16": False, "workers": 0}

    def depth(ids):
        same = video(ids)
        same.rgb[:] = same.rgb[0]
        return [image for image, _ in predictions(graph, same, **how)]

    one, two = depth(["a0", "a1", "a2"]), depth(["a0", "b0", "b1"])
    assert np.array_equal(one[0], two[0]) and np.array_equal(two[0], two[1])
    assert not np.allclose(one[0], one[1]) and np.array_equal(one[1], two[2])


def test_a_recurrent_network_can_begin_with_one_that_has_no_state():
    plain = SerialGraph(tiny_spec("wnet_c")).eval()
    graph = SerialGraph(tiny_spec("wnet_c_lstm")).eval()
    graph.components[0].load_state_dict(plain.components[0].state_dict())
    begin_with(graph.component("depth"), plain.component("depth").state_dict())
    image = torch.randn(1, 3, 96, 128)
    assert torch.equal(graph(image)[-1], plain(image)[-1])


def test_a_gru_s_file_has_one_state_tensor(dataset, tmp_path):
    run, model = tmp_path / "run", tmp_path / "model.onnx"
    gru = ("--architecture", "wnet_c_gru", "--frames", "2", "--batch", "1")
    assert train(dataset, run, *gru, component="depth", epochs=1) == 0
    export = ["export", "--checkpoint", str(run / "best.pt"), "--random", "segmentation"]
    assert main([*export, "--out", str(model)]) == 0
    (hidden,) = json.loads(read_metadata(model)["nunet.state"])
    assert (hidden["input"], hidden["output"]) == ("hidden_in", "hidden_out")
    assert hidden["shape"] == [1, 64, 3, 4]
    assert evaluate(dataset, "--clip", model=model) == 0


def test_frames_train_the_state_resume_and_are_exported(dataset, tmp_path, capsys):
    whole, halved, model = tmp_path / "whole", tmp_path / "halved", tmp_path / "model.onnx"
    options = (*LSTM, "--frames", "3", "--batch", "1")
    depth = {"component": "depth", "epochs": 2}
    assert train(dataset, whole, *options, **depth) == 0
    assert train(dataset, halved, "--minutes", "1e-9", *options, **depth) == 0
    assert train(dataset, halved, "--resume", *options, **depth) == 0
    one, other = (Checkpoint.load(run / "last.pt") for run in (whole, halved))
    assert all(torch.equal(one.weights[name], other.weights[name]) for name in one.weights)
    assert one.weights["components.1.memory.widen.weight"].abs().sum() > 0
    assert [row["step"] for row in rows(whole, "steps.csv")] == ["2", "4"], "two windows per epoch"
    export = ["export", "--checkpoint", str(whole / "best.pt"), "--random", "segmentation"]
    assert main([*export, "--out", str(model)]) == 0
    assert evaluate(dataset, "--clip", model=model) == 0
    assert '"flicker_m"' in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "code", "word"),
    [
        (
            ("--architecture", "wnet_c_lstm"),
            2,
            "is recurrent; single images leave the weights that read the state as they began; "
            "hint: `--frames 8`",
        ),
        (
            ("--architecture", "wnet_c", "--frames", "3"),
            2,
            "`--frames 3`: `--component depth` of `wnet_c` has no state to carry",
        ),
        (
            (*LSTM, "--frames", "4"),
            1,
            "train.txt` has 1 windows of 4 frames of one video; expected at least `--batch 2`",
        ),
        (("--frames", "0"), 2, "`--frames 0`; expected at least 1"),
    ],
)
def test_frames_that_cannot_be_are_refused(dataset, tmp_path, capsys, options, code, word):
    assert train(dataset, tmp_path, *options, component="depth") == code
    assert word in capsys.readouterr().err
    assert not (tmp_path / "last.pt").exists()
