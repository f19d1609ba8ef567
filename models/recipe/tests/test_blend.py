"""Weights between two checkpoints, and another range of depth, in what `export` writes."""

import json

import pytest
import torch

from nunet_models.cli import main
from nunet_models.export.collections import tiny_spec
from nunet_models.export.onnx_file import read_metadata
from nunet_models.export.untrained import untrained_graph
from nunet_models.zoo.checkpoint import Checkpoint


@pytest.fixture
def checkpoints(tmp_path):
    def save(name, architecture, seed):
        graph = untrained_graph(tiny_spec(architecture), seed=seed)
        history = {c.name: [{"epoch": 1}] for c in graph.spec.components}
        settings = {c.name: {"lr": 0.1} for c in graph.spec.components}
        Checkpoint(graph.spec, graph.state_dict(), None, history, settings).save(tmp_path / name)
        return tmp_path / name

    return save("new.pt", "wnet_c", 1), save("old.pt", "wnet_c", 2), save("unet.pt", "unet", 3)


def export(checkpoint, out, *more):
    return main(["export", "--checkpoint", str(checkpoint), "--out", str(out), *more])


def test_a_blend_lies_between_both_weights(checkpoints, tmp_path):
    new, old, _ = checkpoints
    assert export(new, tmp_path / "mixed.pt", "--blend", f"{old}=0.25") == 0
    mixed, a, b = (Checkpoint.load(p) for p in (tmp_path / "mixed.pt", new, old))
    for key, value in mixed.weights.items():
        if value.is_floating_point():
            expected = 0.75 * a.weights[key] + 0.25 * b.weights[key]
            assert torch.allclose(value.float(), expected, atol=2e-3), key
    assert mixed.provenance["depth"]["blended_with"]["share"] == 0.25


def test_a_model_file_says_its_range_and_blend(checkpoints, tmp_path):
    new, old, _ = checkpoints
    out = tmp_path / "mixed.onnx"
    assert export(new, out, "--blend", f"{old}=0.5", "--depth-range", "0.2,15") == 0
    metadata = read_metadata(out)
    assert (metadata["nunet.depth.min_m"], metadata["nunet.depth.max_m"]) == ("0.2", "15.0")
    assert json.loads(metadata["nunet.training"])["depth"]["blended_with"]["share"] == 0.5


@pytest.mark.parametrize(
    "more",
    [
        ("--blend", "old.pt"),
        ("--blend", "old.pt=0"),
        ("--blend", "old.pt=1.5"),
        ("--blend", "=0.5"),
        ("--depth-range", "3"),
        ("--depth-range", "3,1"),
        ("--depth-range", "0,inf"),
        ("--depth-range", "nan,4"),
    ],
)
def test_a_bad_blend_or_range_is_refused(checkpoints, tmp_path, monkeypatch, capsys, more):
    monkeypatch.chdir(tmp_path)
    assert export(checkpoints[0], tmp_path / "bad.pt", *more) == 2
    assert "expected" in capsys.readouterr().err
    assert not (tmp_path / "bad.pt").exists()


def test_another_graph_is_not_blended(checkpoints, tmp_path, capsys):
    new, _, unet = checkpoints
    assert export(new, tmp_path / "bad.pt", "--blend", f"{unet}=0.5") == 1
    assert "other components" in capsys.readouterr().err


def test_the_key_of_the_optimizer_in_a_checkpoint_is_the_one_of_earlier_files(tmp_path):
    path = tmp_path / "run.pt"
    graph = untrained_graph(tiny_spec("unet"), seed=1)
    settings = {"depth": {"optimizer": "adam", "lr": 0.1}}
    Checkpoint(graph.spec, graph.state_dict(), settings=settings).save(path)
    in_file = torch.load(path, weights_only=True)["settings"]
    assert in_file == {"depth": {"optimiser": "adam", "lr": 0.1}}
    assert Checkpoint.load(path).settings == settings
