"""The subcommand `evaluate`: what it prints, and what it refuses."""

import csv
import json
import shutil
from unittest.mock import ANY

import numpy as np
import pytest
from comparisons import a_pair, answering
from PIL import Image
from runs import TINY
from runs import evaluate_tiny as evaluate

from nunet_models.classes import labels13_from_labels40
from nunet_models.cli import main
from nunet_models.errors import ConfigError
from nunet_models.evaluation.clip import clip_metrics
from nunet_models.evaluation.compare import (
    compare,
)
from nunet_models.evaluation.predict import Predictor
from nunet_models.evaluation.protocol import FULL
from nunet_models.export.onnx_file import read_metadata, write_metadata


def test_a_file_that_is_no_model_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="no model file"):
        Predictor(tmp_path / "absent.onnx")


def test_the_command_prints_every_figure(dataset, tmp_path, capsys):
    rows = tmp_path / "rows.csv"
    code = main(
        [
            *("evaluate", "--model", str(TINY), "--data", str(dataset)),
            *("--ids", str(dataset / "val.txt"), "--baseline-ids", str(dataset / "train.txt")),
            *("--csv", str(rows), "--clip"),
        ]
    )
    found = json.loads(capsys.readouterr().out)
    assert code == 0
    assert found["protocol"] == "full", "as of `nunetd eval`"
    assert found["pictures"] == 2 and len(rows.read_text().splitlines()) == 3
    deltas = ["delta1", "delta2", "delta3"]
    errors = ["mse", "rmse", "rmse_log", "log10", "abs_rel", "sq_rel", "silog"]
    assert list(found["metrics"]) == list(found["image_mean"]) == errors + deltas
    assert list(found["baseline"]) == ["of", "metrics", "image_mean", "minmax"]
    assert found["baseline"]["of"] == "baseline-ids", "as of `nunetd eval`"
    assert found["baseline"]["image_mean"]["rmse"] < found["image_mean"]["rmse"]
    own = [float(row["rmse"]) for row in csv.DictReader(rows.open())]
    assert found["image_mean"]["rmse"] == pytest.approx(sum(own) / 2)
    assert set(found["labels"]) == {"miou", "accuracy", "pixels"}
    assert found["labels"]["pixels"] == 2 * 96 * 128
    assert found["baseline"]["metrics"]["rmse"] < found["metrics"]["rmse"]
    assert found["clip"]["flicker_m"] >= 0


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("cut.onnx", ("as an ONNX file", "hint: check that the file is complete")),
        (
            "tiny_wnet_c.toml",
            (
                "is a staged graph; expected an ONNX file; hint: the fused `.onnx`",
                "`export --out FILE.onnx`",
                "; `nunetd eval --model {path}` measures the stages themselves",
            ),
        ),
        (
            "tiny_wnet_c.segmentation.onnx",
            ("gives `logits`, `labels`; expected `rgb` and `depth`",),
        ),
        ("tiny_wnet_c.depth.onnx", ("takes `rgb`, `features` and gives `depth`; expected `rgb`",)),
    ],
)
def test_a_file_that_cannot_be_measured_is_named(dataset, tmp_path, capsys, name, words):
    path = TINY.with_name(name)
    if name == "cut.onnx":
        path = tmp_path / name
        path.write_bytes(TINY.read_bytes()[:-1000])
    assert evaluate(dataset, model=path) == 1
    stderr = capsys.readouterr().err
    assert f"`{path}`" in stderr and all(word.format(path=path) in stderr for word in words)


def test_labels_of_the_13_classes_give_the_figures_of_the_40(dataset, capsys):
    assert evaluate(dataset) == 0
    expected = json.loads(capsys.readouterr().out)["labels"]
    (dataset / "labels").mkdir()
    for path in (dataset / "label40").iterdir():
        own = labels13_from_labels40(np.array(Image.open(path)))
        Image.fromarray(own).save(dataset / "labels" / path.name)
        Image.fromarray(np.zeros_like(own)).save(path)  # `labels` comes first
    assert evaluate(dataset) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)["labels"] == expected
    assert "no label metrics" not in printed.err


def test_a_folder_without_labels_is_said_once(dataset, capsys):
    shutil.rmtree(dataset / "label40")
    assert evaluate(dataset) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)["labels"] == {}
    assert printed.err.count(f"no label metrics: `{dataset}` has no folder `labels`") == 1


def test_eigen_s_crop_names_the_image_of_another_size(dataset, capsys):
    assert evaluate(dataset, "--protocol", "eigen") == 1
    stderr = capsys.readouterr().err
    assert "image `0004`: protocol `eigen` is for images of (480, 640)" in stderr
    assert "hint: `--protocol full`" in stderr


def test_a_mean_image_of_another_size_is_said_before_the_network_runs(dataset, capsys, monkeypatch):
    monkeypatch.setattr(Predictor, "__call__", lambda *_: pytest.fail("the network has run"))
    for folder in ("rgb", "depth", "label40"):
        for number in range(4):
            path = dataset / folder / f"{number:04d}.png"
            Image.open(path).resize((64, 48), Image.Resampling.NEAREST).save(path)
    baseline = ("--baseline-ids", str(dataset / "train.txt"))
    assert evaluate(dataset, *baseline) == 1
    assert "image `0004` is (96, 128); expected (48, 64)" in capsys.readouterr().err
    (dataset / "train.txt").write_text("0000\n0005\n")
    assert evaluate(dataset, *baseline) == 1
    assert "image `0005` is (96, 128), the first one (48, 64)" in capsys.readouterr().err


def test_a_mean_image_is_kept_for_other_data(dataset, tmp_path, capsys):
    def baseline(*more):
        assert evaluate(dataset, *more) == 0
        return json.loads(capsys.readouterr().out)["baseline"]

    kept = tmp_path / "mean.npy"
    ids = ("--baseline-ids", str(dataset / "train.txt"))
    named = baseline(*ids, "--save-baseline", str(kept))
    assert named == baseline(*ids)
    depth = [np.array(Image.open(dataset / f"depth/{i:04d}.png")) / 1000 for i in range(4)]
    image = np.load(kept)
    assert image.dtype == np.float32 and np.allclose(image, np.mean(depth, axis=0))
    # `ids` and their data are not needed any more
    (dataset / "train.txt").unlink()
    found = baseline("--baseline", str(kept))
    assert found["of"] == "baseline-file"
    assert (found["metrics"], found["image_mean"]) == (named["metrics"], named["image_mean"])
    pairs = [a_pair(np.array(Image.open(dataset / f"depth/000{i}.png")) / 1000) for i in (4, 5)]
    own = compare(pairs, answering(image), protocol=FULL, metric=True, classes=0).values()
    assert found["minmax"] == pytest.approx(own["minmax"])


def test_a_mean_image_of_another_size_is_no_baseline(dataset, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(Predictor, "__call__", lambda *_: pytest.fail("the network has run"))
    np.save(tmp_path / "mean.npy", np.ones((48, 64), np.float32))
    assert evaluate(dataset, "--baseline", str(tmp_path / "mean.npy")) == 1
    assert "image `0004` is (96, 128); expected (48, 64)" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (None, "is missing; expected a mean image in meters, float32 [H, W]"),
        (b"\x93NUMPY no more", "is not a .npy file: "),
        (b"", "is not a .npy file: "),
        (np.array(["a"], object), "is not a .npy file: "),
        (np.ones((96, 128), np.uint16), "holds uint16 [96, 128]; expected a mean image"),
        (np.ones((1, 96, 128), np.float32), "holds float32 [1, 96, 128]; expected"),
        (np.full((96, 128), np.nan, np.float32), "has pixels without depth; expected"),
        (np.zeros((96, 128), np.float32), "has pixels without depth; expected"),
    ],
)
def test_a_file_that_is_no_mean_image_is_named(dataset, tmp_path, capsys, image, message):
    path = tmp_path / "mean.npy"
    if isinstance(image, bytes):
        path.write_bytes(image)
    elif image is not None:
        np.save(path, image, allow_pickle=True)
    assert evaluate(dataset, "--baseline", str(path)) == 1
    assert f"`{path}` {message}" in capsys.readouterr().err


def test_options_of_the_baseline_that_do_not_go_together_are_bad_arguments(dataset, capsys):
    assert evaluate(dataset, "--save-baseline", "mean.npy") == 2
    assert "hint: `--baseline-ids FILE` names training images" in capsys.readouterr().err
    with pytest.raises(SystemExit) as ended:
        evaluate(dataset, "--baseline", "mean.npy", "--baseline-ids", "train.txt")
    assert ended.value.code == 2


def test_a_row_of_a_image_without_depth_is_empty_and_the_others_are_not(dataset, tmp_path):
    Image.fromarray(np.zeros((96, 128), np.uint16)).save(dataset / "depth" / "0004.png")
    assert evaluate(dataset, "--csv", str(tmp_path / "rows.csv")) == 0
    head, empty, full = (tmp_path / "rows.csv").read_text().splitlines()
    assert head.startswith("id,mse,rmse,") and head.endswith(",delta3,minmax_mse,minmax_rmse")
    assert empty == "0004" + "," * head.count(",")
    assert all(float(cell) >= 0 for cell in full.split(",")[1:])


def test_a_stretched_network_s_rows_hold_the_stretched_error():
    compared = compare(
        [a_pair([[1, 3]])], answering([[0.5, 0.5]]), protocol=FULL, metric=False, classes=0
    )
    assert compared.per_image == [{"id": "0", "minmax_mse": ANY, "minmax_rmse": ANY}]
    assert compared.per_image[0]["minmax_rmse"] == pytest.approx(0.5, rel=1e-5)


def test_one_frame_is_no_clip(dataset, capsys):
    (dataset / "val.txt").write_text("0004\n")
    assert evaluate(dataset, "--clip") == 1
    assert "names one image; expected two frames or more" in capsys.readouterr().err


def test_frames_without_depth_have_no_clip_figures():
    frames = [a_pair(np.full((8, 8), np.nan))] * 2
    assert set(clip_metrics(frames, answering(np.ones((8, 8)))).values()) == {None}


@pytest.mark.parametrize("fx", ["0", "-500", "nan", "inf"])
def test_a_focal_length_that_is_none_is_a_bad_argument(dataset, capsys, fx):
    assert evaluate(dataset, f"--fx={fx}") == 2
    printed = capsys.readouterr()
    assert (
        f"`--fx {float(fx)}`; expected a focal length in pixels, more than 0; hint" in printed.err
    )
    assert not printed.out


@pytest.fixture
def stretching(tmp_path):
    """A model file whose numbers are taken for depth stretched to 0..1."""
    path = tmp_path / "stretching.onnx"
    shutil.copy(TINY, path)
    write_metadata(path, {**read_metadata(path), "nunet.depth.encoding": "minmax"})
    return path


def test_the_focal_length_scales_meters_and_nothing_else(dataset, stretching, capsys):
    def metrics(model, *more):
        assert evaluate(dataset, *more, model=model) == 0
        return json.loads(capsys.readouterr().out)

    fx = ("--fx", "1000")
    assert metrics(TINY, *fx)["metrics"] != metrics(TINY)["metrics"]
    assert metrics(stretching, *fx) == metrics(stretching)


@pytest.mark.parametrize(
    ("change", "more", "words"),
    [
        ({"nunet.camera": None}, ("--fx", "500"), "has no `nunet.camera` in its metadata"),
        ({"nunet.camera": '{"fx": 0}'}, ("--fx", "500"), "expected width, height, fx and fy"),
        ({"nunet.depth.max_m": None}, (), "has no `nunet.depth.max_m` in its metadata"),
        ({"nunet.depth.max_m": "far"}, (), "could not convert string to float: 'far'"),
        ({"nunet.depth.encoding": "inverse"}, (), "`inverse`; expected metric or minmax"),
    ],
)
def test_missing_and_wrong_metadata_is_named(dataset, tmp_path, capsys, change, more, words):
    path = tmp_path / "model.onnx"
    shutil.copy(TINY, path)
    values = {**read_metadata(path), **change}
    write_metadata(path, {key: value for key, value in values.items() if value is not None})
    assert evaluate(dataset, *more, model=path) == 1
    printed = capsys.readouterr()
    assert f"`{path}`" in printed.err and words in printed.err and not printed.out


def test_the_camera_is_needed_for_a_focal_length_only(dataset, tmp_path):
    path = tmp_path / "model.onnx"
    shutil.copy(TINY, path)
    values = read_metadata(path)
    del values["nunet.camera"]
    write_metadata(path, values)
    assert evaluate(dataset, model=path) == 0


def test_a_clip_of_a_network_without_meters_is_refused(dataset, stretching, capsys):
    assert evaluate(dataset, "--clip", model=stretching) == 1
    stderr = capsys.readouterr().err
    assert (
        f"`--clip` compares meters, but `{stretching}` outputs depth as `minmax`; hint: " in stderr
    )
