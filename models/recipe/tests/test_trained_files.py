"""What trained runs become: model files, and components of other graphs."""

import hashlib
import json
import shutil

import pytest
import torch
from runs import rows, train

from nunet_models.cli import main
from nunet_models.export.collections import tiny_spec
from nunet_models.export.onnx_file import read_metadata
from nunet_models.zoo.checkpoint import Checkpoint


def test_a_trained_run_becomes_a_file_that_says_how_it_was_trained(dataset, tmp_path, capsys):
    run, model = tmp_path / "run", tmp_path / "model.onnx"
    accuracy = tmp_path / "accuracy.json"
    accuracy.write_text('{"metrics": {"rmse": 0.6}}', encoding="utf-8-sig")
    assert train(dataset, run, "--architecture", "unet", component="depth", epochs=1) == 0
    export = ["export", "--checkpoint", str(run / "best.pt"), "--accuracy", str(accuracy)]
    whole = accuracy.read_text()
    for text, word in ((whole[:-1], "is not JSON: "), ("[]", "is not a JSON object")):
        accuracy.write_text(text)
        assert main([*export, "--out", str(model)]) == 1
        assert f"`{accuracy}` {word}" in capsys.readouterr().err and not model.exists()
    accuracy.write_text(whole)
    assert main([*export, "--out", str(model)]) == 0
    values = read_metadata(model)
    assert values["nunet.trained"] == "true"
    training = json.loads(values["nunet.training"])["depth"]
    assert training["epochs_done"] == 1
    ids = "0000\n0001\n0002\n0003\n"
    assert training["data"]["train"] == {
        "pictures": 4,
        "ids_sha256": hashlib.sha256(ids.encode()).hexdigest(),
    }
    assert (training["data"]["name"], training["data"]["depth_scale"]) == ("rooms", 0.001)
    assert (training["dropout"], training["origin"]) == (0.0, {})
    assert json.loads(values["nunet.accuracy"]) == {"metrics": {"rmse": 0.6}}


def test_a_graph_with_an_untrained_component_is_not_exported_as_trained(dataset, tmp_path, capsys):
    run, model = tmp_path / "run", tmp_path / "model.onnx"
    assert train(dataset, run, epochs=1) == 0
    assert main(["export", "--checkpoint", str(run / "best.pt"), "--out", str(model)]) == 1
    stderr = capsys.readouterr().err
    assert "component `depth` of" in stderr and "is untrained, its weights are random" in stderr
    assert f"hint: `train --component depth --start {run / 'best.pt'}`" in stderr
    assert not model.exists()


def test_a_run_without_a_validated_epoch_is_not_exported(dataset, tmp_path, capsys):
    run, model = tmp_path / "run", tmp_path / "model.onnx"
    unet = ("--architecture", "unet", "--minutes", "1e-9")
    assert train(dataset, run, *unet, component="depth") == 0
    assert main(["export", "--checkpoint", str(run / "last.pt"), "--out", str(model)]) == 1
    assert "component `depth` of" in (stderr := capsys.readouterr().err)
    assert "has no validated epoch yet; hint: continue with `--resume`" in stderr


def test_what_learned_along_with_a_later_component_counts_as_trained():
    spec = tiny_spec("wnet_c")
    history = {"depth": [{"epoch": 1}]}
    alone = Checkpoint(spec, {}, history=history, settings={"depth": {"unfrozen": False}})
    along = Checkpoint(spec, {}, history=history, settings={"depth": {"unfrozen": True}})
    assert alone.untrained_component() == "segmentation"
    assert along.untrained_component() is None


def test_the_paper_s_stretched_target_trains_and_is_measured_on_its_own_scale(dataset, tmp_path):
    paper = ("--encoding", "minmax", "--loss", "mse", "--ema", "0", "--schedule", "constant")
    options = ("--architecture", "unet", "--optimizer", "adam", *paper)
    assert train(dataset, tmp_path, *options, component="depth", epochs=1) == 0
    assert 0.0 < float(rows(tmp_path, "epochs.csv")[0]["rmse"]) < 1.0


def test_the_paper_s_own_w_net_trains_as_a_whole_and_is_exported(dataset, tmp_path, capsys):
    """One channel, its sigmoid kept, crosses the joint; the loss of the second U-Net alone."""
    run, model = tmp_path / "run", tmp_path / "model.onnx"
    paper = ("--tasks", "depth,depth", "--sigmoid-joint", "depth1", "--encoding", "minmax")
    options = ("--architecture", "wnet", *paper, "--loss", "mse", "--unfrozen")
    assert train(dataset, run, *options, component="depth", epochs=1) == 0
    spec = Checkpoint.load(run / "best.pt").spec
    assert [(c.name, c.task, c.sigmoid_joint) for c in spec.components] == [
        ("depth1", "depth", True),
        ("depth", "depth", False),
    ]
    assert main(["export", "--checkpoint", str(run / "best.pt"), "--out", str(model)]) == 0
    values = read_metadata(model)
    assert values["nunet.trained"] == "true" and "nunet.classes" not in values
    onward = ("--start", str(run / "best.pt"), "--sigmoid-joint", "depth1")
    assert train(dataset, tmp_path / "on", *onward, component="depth") == 1
    assert "`--start` takes tasks and sigmoids from its checkpoint" in capsys.readouterr().err


def test_a_trained_component_is_plugged_into_another_graph(dataset, tmp_path, capsys):
    seg, depth = tmp_path / "seg", tmp_path / "depth"
    assert train(dataset, seg, "--architecture", "wnet", epochs=1) == 0
    plug = ("--architecture", "wnet_c", "--plug", f"segmentation={seg / 'best.pt'}")
    assert train(dataset, depth, *plug, component="depth", epochs=1) == 0
    theirs, ours = (Checkpoint.load(run / "best.pt") for run in (seg, depth))
    one, other = (c.component_weights("segmentation") for c in (theirs, ours))
    assert all(torch.equal(one[name], other[name]) for name in one)
    assert ours.history["segmentation"] == theirs.history["segmentation"]
    assert ours.provenance["segmentation"] == theirs.provenance["segmentation"]
    plugged = ours.provenance["depth"]["origin"]["plug"]["segmentation"]
    digest = hashlib.sha256((seg / "best.pt").read_bytes()).hexdigest()
    assert plugged == {"file": "best.pt", "sha256": digest}
    wrong = ("--architecture", "wnet_c", "--plug", f"depth={seg / 'best.pt'}")
    assert train(dataset, tmp_path / "wrong", *wrong, component="depth", epochs=1) == 1
    assert "do not fit component `depth`" in capsys.readouterr().err


def test_a_network_of_another_camera_says_so_and_whose_images_they_are(dataset, tmp_path, capsys):
    run, onward, model = tmp_path / "run", tmp_path / "onward", tmp_path / "model.onnx"
    camera = ("--intrinsics", "600,601.5,320,240@640x480")
    assert train(dataset, run, "--architecture", "unet", *camera, component="depth", epochs=1) == 0
    export = ["export", "--checkpoint", str(run / "best.pt"), "--out", str(model)]
    assert main(export) == 1
    assert "hint: `--license TEXT` names the license of the images" in capsys.readouterr().err
    assert main([*export, "--license", "CC0, our own images"]) == 0
    values = read_metadata(model)
    known = {"width": 640, "height": 480, "fx": 600.0, "fy": 601.5}
    assert json.loads(values["nunet.camera"]) == known
    assert values["nunet.license"] == "CC0, our own images"
    best = str(run / "best.pt")
    small = tmp_path / "small.pt"
    stated = ("--out", str(small), "--license", "CC BY 4.0, theirs")
    assert main(["export", "--checkpoint", best, *stated]) == 0
    assert main(["export", "--checkpoint", str(small), "--out", str(model)]) == 0
    assert read_metadata(model)["nunet.license"] == "CC BY 4.0, theirs"
    for more, fx in (((), 600.0), (("--intrinsics", "300,300,160,120@320x240"), 300.0)):
        shutil.rmtree(onward, ignore_errors=True)
        assert train(dataset, onward, "--start", best, *more, component="depth", epochs=1) == 0
        assert Checkpoint.load(onward / "best.pt").spec.camera.fx == fx


def test_defaults_of_camera_and_license_are_printed(dataset, tmp_path, capsys):
    run, model = tmp_path / "run", tmp_path / "model.onnx"
    unet = ("--architecture", "unet")
    camera = "assumed NYU Depth V2's camera, fx 518.858 pixels at 640x480"
    assert train(dataset, run, *unet, component="depth", epochs=1) == 0
    assert capsys.readouterr().err.count(camera) == 1
    known = (
        (run, ("--resume", *unet)),
        (tmp_path / "on", ("--start", str(run / "best.pt"))),
        (tmp_path / "own", ("--intrinsics", "60,60,64,48@128x96", *unet)),
        (tmp_path / "paper", ("--encoding", "minmax", "--loss", "mse", *unet)),
    )
    for folder, options in known:
        assert train(dataset, folder, *options, component="depth", epochs=1) == 0
        assert "camera" not in capsys.readouterr().err
    export = ["export", "--checkpoint", str(run / "best.pt"), "--out", str(model)]
    assert main(export) == 0
    license = read_metadata(model)["nunet.license"]
    assert f"the license is `{license}`; hint: `--license TEXT`" in capsys.readouterr().err
    assert main([*export, "--license", "CC0"]) == 0
    assert "license" not in capsys.readouterr().err


def test_the_license_of_a_plugged_component_s_images_is_carried_into_the_file(dataset, tmp_path):
    seg, depth, model = tmp_path / "seg", tmp_path / "depth", tmp_path / "model.onnx"
    assert train(dataset, seg, "--license", "CC BY 4.0, A", epochs=1) == 0
    plug = ("--plug", f"segmentation={seg / 'best.pt'}")
    export = ["export", "--checkpoint", str(depth / "best.pt"), "--out", str(model)]
    for text, expected in (
        ("CC0", "`segmentation`: CC BY 4.0, A; `depth`: CC0"),
        ("CC BY 4.0, A", "CC BY 4.0, A"),
    ):
        shutil.rmtree(depth, ignore_errors=True)
        assert train(dataset, depth, *plug, "--license", text, component="depth", epochs=1) == 0
        assert main(export) == 0
        values = read_metadata(model)
        assert values["nunet.license"] == expected
        assert json.loads(values["nunet.training"])["segmentation"]["license"] == "CC BY 4.0, A"


@pytest.mark.parametrize(
    ("text", "code", "word"),
    [
        ("600,600,320,240", 2, "expected fx,fy,cx,cy@WxH in pixels; hint: NYU's are"),
        ("0,600,320,240@640x480", 2, "expected fx,fy,cx,cy@WxH in pixels"),
        ("600,600,320,180@640x360", 1, "of 640x360; the training images are 128x96; hint:"),
    ],
)
def test_intrinsics_that_cannot_be_are_refused(dataset, tmp_path, capsys, text, code, word):
    assert train(dataset, tmp_path, "--intrinsics", text, epochs=1) == code
    assert word in capsys.readouterr().err
    assert not (tmp_path / "last.pt").exists()
