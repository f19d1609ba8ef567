"""Graphs with an inner task: trained component by component, exported, measured."""

import json

import numpy as np
import pytest
import torch
from runs import evaluate_tiny, rows, train

from nunet_models.cli import main
from nunet_models.export.onnx_file import read_metadata
from nunet_models.zoo.checkpoint import Checkpoint

INNER = {"normals": "angle_deg", "objectness": "box_miou"}


def graph(task):
    return "--architecture", "nunet3_c", "--tasks", f"segmentation,{task},depth"


@pytest.mark.parametrize("task", INNER)
def test_an_inner_component_is_trained_exported_and_measured(task, dataset, tmp_path, capsys):
    seg, middle, depth = (tmp_path / name for name in ("seg", "middle", "depth"))
    name, out = f"{task}2", tmp_path / f"{task}.onnx"
    assert train(dataset, seg, *graph(task), epochs=1) == 0
    plug = ("--plug", f"segmentation={seg / 'best.pt'}")
    assert train(dataset, middle, *graph(task), *plug, component=name, epochs=2) == 0
    assert INNER[task] in rows(middle, "epochs.csv")[0]
    shown = np.load(middle / "evolution" / "0001.npy")
    assert shown.dtype == np.float16 and shown.shape == (48, 64)
    assert shown.min() >= 0.0 and shown.max() <= 1.0

    start = ("--start", str(middle / "best.pt"))
    assert train(dataset, depth, *start, component="depth", epochs=1) == 0
    before, after = (Checkpoint.load(run / "best.pt") for run in (middle, depth))
    mine, its = (of.component_weights(name) for of in (after, before))
    assert all(mine[key].equal(its[key]) for key in its)
    export = ("export", "--checkpoint", str(depth / "best.pt"), "--out", str(out))
    assert main([*export, "--license", "test"]) == 0
    metadata = read_metadata(out)
    components = json.loads(metadata["nunet.components"])
    assert [c["task"] for c in components] == ["segmentation", task, "depth"]
    assert [c["name"] for c in components] == ["segmentation", name, "depth"]
    assert metadata["nunet.trained"] == "true" and name in json.loads(metadata["nunet.training"])
    capsys.readouterr()
    assert evaluate_tiny(dataset, model=out) == 0
    assert "abs_rel" in json.loads(capsys.readouterr().out)["metrics"]


@pytest.mark.parametrize("task", INNER)
def test_the_best_inner_component_is_chosen_by_its_own_metric(task, dataset, tmp_path):
    options = (*graph(task), "--lr", "3e-3", "--ema", "0.5")
    assert train(dataset, tmp_path, *options, component=f"{task}2", epochs=12) == 0
    found = [float(row[INNER[task]]) for row in rows(tmp_path, "epochs.csv")]
    best = min(found) if task == "normals" else max(found)
    assert best != found[0]
    kept = Checkpoint.load(tmp_path / "best.pt").history[f"{task}2"][-1]
    assert kept[INNER[task]] == pytest.approx(best)


def test_an_interrupted_inner_component_is_resumed_with_the_same_losses(dataset, tmp_path):
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    how = {"component": "objectness2", "epochs": 2}
    assert train(dataset, whole, *graph("objectness"), **how) == 0
    assert train(dataset, parts, *graph("objectness"), "--minutes", "0.0001", **how) == 0
    assert Checkpoint.load(parts / "last.pt").progress["step"] == 1
    assert train(dataset, parts, *graph("objectness"), "--resume", **how) == 0
    mine, its = (Checkpoint.load(run / "last.pt").weights for run in (parts, whole))
    assert all(torch.equal(mine[name], its[name]) for name in its)


def test_each_component_of_a_series_may_have_its_own_backbone(dataset, tmp_path):
    backbones = ("--backbone", "tiny,resnet18,tiny")
    options = (*graph("normals"), *backbones)
    assert train(dataset, tmp_path, *options, component="normals2", epochs=1) == 0
    spec = Checkpoint.load(tmp_path / "best.pt").spec
    assert [c.backbone for c in spec.components] == ["tiny", "resnet18", "tiny"]


def test_data_without_labels_trains_normals_but_no_objectness(dataset, tmp_path, capsys):
    for label in (dataset / "label40").iterdir():
        label.unlink()
    (dataset / "label40").rmdir()
    how = {"epochs": 1}
    assert train(dataset, tmp_path / "a", *graph("normals"), component="normals2", **how) == 0
    options = graph("objectness")
    assert train(dataset, tmp_path / "b", *options, component="objectness2", **how) == 1
    assert "the training data has no labels" in capsys.readouterr().err


def dataset_list(dataset):
    """The folder as two sets of one camera, each with labels."""
    camera = "110,110,63.5,47.5@128x96"
    text = "".join(
        f'[[set]]\nname = "rooms"\nroot = "rooms"\nids = "rooms/{ids}.txt"\n'
        f'intrinsics = "{camera}"\nuse = "{use}"\n'
        for ids, use in (("train", "train"), ("val", "val"))
    )
    path = dataset.parent / "list.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("task", INNER)
def test_an_inner_component_is_trained_on_sets_of_several_cameras(task, dataset, tmp_path):
    run = tmp_path / "run"
    options = ("--run", str(run), "--sets", str(dataset_list(dataset)), "--threads", "1")
    size = ("--backbone", "tiny", "--inner-size", "96", "128", "--batch", "2", "--quiet")
    how = ("--component", f"{task}2", "--epochs", "1", "--workers", "0")
    assert main(["train", *options, *size, *graph(task), *how]) == 0
    assert float(rows(run, "epochs.csv")[0][INNER[task]]) > 0.0
