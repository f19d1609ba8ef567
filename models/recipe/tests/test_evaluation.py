"""Evaluation: protocols, baselines and the command, on numbers worked out by hand."""

import csv
import json
import shutil
from dataclasses import replace
from unittest.mock import ANY

import numpy as np
import pytest
from PIL import Image
from runs import TINY
from runs import evaluate_tiny as evaluate

from nunet_models.classes import labels13_from_labels40
from nunet_models.cli import main
from nunet_models.data.pairs import Pair
from nunet_models.errors import ConfigError, DataError
from nunet_models.evaluation.clip import clip_metrics
from nunet_models.evaluation.compare import (
    Prediction,
    compare,
    mean_image,
    mean_stretched_image,
    stretched,
)
from nunet_models.evaluation.predict import Predictor
from nunet_models.evaluation.protocol import EIGEN, FULL
from nunet_models.export.onnx_file import read_metadata, write_metadata
from nunet_models.export.onnx_file import run as run_file

RECURRENT = TINY.with_name("tiny_wnet_c_lstm.onnx")


def a_pair(depth, identity="0"):
    depth = np.array(depth, np.float32)
    return Pair(identity, np.zeros((*depth.shape, 3), np.uint8), depth, None)


def answering(depth):
    return lambda _: Prediction(np.array(depth, np.float32), None)


def test_eigen_s_crop_and_cap():
    depth = np.full((480, 640), 20.0, np.float32)
    depth[45, 41] = np.nan
    cropped = EIGEN.predicted(depth)
    assert cropped.shape == (426, 560)
    assert np.isnan(cropped[0, 0]) and cropped[1, 1] == 10.0
    assert np.isnan(EIGEN.truth(depth)).all(), "truth beyond the cap is no truth"
    assert EIGEN.truth(depth / 4)[1, 1] == 5.0


def test_eigen_s_crop_refuses_another_size():
    with pytest.raises(DataError, match=r"\(480, 640\); this one is \(96, 128\)"):
        EIGEN.truth(np.zeros((96, 128)))


def test_a_comparison_gives_meters_and_the_paper_s_stretched_error():
    found = compare(
        [a_pair([[1, 2], [3, 5]])],
        answering([[2, 2], [4, 4]]),
        protocol=FULL,
        metric=True,
        classes=0,
    ).values()
    assert found["metrics"]["mse"] == pytest.approx((1 + 0 + 1 + 1) / 4)
    # truth 0 .25 .5 1, prediction 0 0 1 1
    assert found["minmax"]["mse"] == pytest.approx((0 + 0.0625 + 0.25 + 0) / 4, rel=1e-5)


def test_truth_beyond_ten_meters_is_none_and_predictions_end_there():
    pairs = [a_pair([[9.0, 1.0, 1.0]]), a_pair([[12.0, 10.0, 1e-3]])]
    answers = iter([[[50.0, 0.0, np.nan]], [[2.0, 2.0, 2.0]]])
    comparison = compare(
        pairs, lambda _: answering(next(answers))(None), protocol=FULL, metric=True, classes=0
    )
    assert comparison.depth.values()["mse"] == pytest.approx((1 + 0.999**2) / 2, rel=1e-6)
    assert (comparison.depth.pixels, comparison.depth.missing) == (2, 1)


def test_what_is_compared_and_what_is_not_is_counted():
    truth = a_pair([[12.0, 10.0, 1e-3, np.nan, 2.0, 3.0, 4.0]])
    answer = answering([[1, 1, 1, 1, np.nan, 3, 4]])
    found = compare([truth] * 2, answer, protocol=FULL, metric=True, classes=0).values()
    assert (found["pixels"], found["pixels_without_prediction"]) == (4, 2)
    assert found["pixels_beyond"] == 6
    found = compare([truth], answer, protocol=FULL, metric=False, classes=0).values()
    assert (found["pixels"], found["pixels_without_prediction"]) == (5, 1)
    assert found["pixels_beyond"] == 0, "stretched depth has no cap"


def test_truth_beyond_counts_within_the_crop_alone():
    depth = np.full((480, 640), 20.0, np.float32)
    depth[45, 41:44] = 2.0, np.nan, 1e-4
    found = compare([a_pair(depth)], answering(depth), protocol=EIGEN, metric=True, classes=0)
    assert found.values()["pixels"] == 1
    assert found.values()["pixels_beyond"] == 426 * 560 - 2


@pytest.mark.parametrize(("far", "is_reported"), [(61, False), (62, True)])
def test_much_truth_beyond_the_cap_is_reported(dataset, capsys, far, is_reported):
    path = dataset / "depth" / "0004.png"
    values = np.full((96, 128), 2000, np.uint16)
    values.flat[: far * 10] = 10_000
    values.flat[-48:] = 0
    Image.fromarray(values).save(path)
    (dataset / "val.txt").write_text("0004\n")
    assert evaluate(dataset) == 0
    answer = capsys.readouterr()
    found = json.loads(answer.out)
    assert found["pixels_beyond"] == far * 10
    assert found["pixels"] == 96 * 128 - 48 - far * 10
    lines = [line for line in answer.err.splitlines() if "not compared" in line]
    assert len(lines) == is_reported
    if is_reported:
        assert "5.1 % of the true depth (620 of 12240 pixels)" in lines[0]
        assert lines[0].endswith("hint: `--depth-scale METERS` sets the unit of the depth images")


def test_truth_of_another_scale_is_reported():
    with pytest.raises(DataError, match=r"between 0\.001 and 10\.0 m") as raised:
        compare(
            [a_pair([[1250.0, 4000.0]])],
            answering([[1, 4]]),
            protocol=FULL,
            metric=True,
            classes=0,
        )
    assert "--depth-scale" in raised.value.hint


def test_the_mean_over_images_stands_beside_the_pooled_figures():
    pairs = [a_pair([[2.0, 2.0, 2.0]]), a_pair([[np.nan, np.nan, 1.0]]), a_pair([[np.nan] * 3])]
    answers = iter([[[3.0, 3.0, 3.0]], [[4.0, 4.0, 4.0]], [[4.0, 4.0, 4.0]]])
    found = compare(
        pairs, lambda _: answering(next(answers))(None), protocol=FULL, metric=True, classes=0
    ).values()
    assert found["metrics"]["mse"] == pytest.approx((3 * 1 + 9) / 4)
    assert found["image_mean"]["mse"] == pytest.approx((1 + 9) / 2)
    assert found["image_mean"]["rmse"] == pytest.approx((1 + 3) / 2)
    assert list(found["image_mean"]) == list(found["metrics"])


def test_a_minmax_network_is_not_stretched_again():
    found = compare(
        [a_pair([[1, 3]])], answering([[0.5, 0.5]]), protocol=FULL, metric=False, classes=0
    ).values()
    assert found["metrics"] == found["image_mean"] == {}
    assert found["minmax"]["mse"] == pytest.approx(0.25, rel=1e-5)


def test_stretching_keeps_unknown_pixels_unknown():
    depth = np.array([[1.0, 9.0, 3.0]])
    out = stretched(depth, np.array([[True, False, True]]))
    assert out[0, 0] == 0.0 and np.isnan(out[0, 1]) and out[0, 2] == 1.0


def test_the_mean_image_averages_what_is_known():
    pairs = [a_pair([[1.0, np.nan, np.nan]]), a_pair([[3.0, 4.0, np.nan]])]
    assert mean_image(pairs)[0].tolist() == [2.0, 4.0, pytest.approx(8 / 3)]
    assert mean_stretched_image(pairs)[0].tolist() == [0.0, 1.0, 0.5]


def test_a_clip_s_scale_and_flicker():
    frames = [a_pair(np.full((8, 8), 2.0)), a_pair(np.full((8, 8), 2.0))]
    answers = iter([np.full((8, 8), 1.0), np.full((8, 8), 1.1)])
    found = clip_metrics(frames, lambda _: Prediction(next(answers), None))
    assert found["abs_rel_median"] == pytest.approx((0.5 + 0.45) / 2)
    assert found["scale"] == pytest.approx((2 + 2 / 1.1) / 2)
    assert found["flicker_m"] == pytest.approx(0.1)


def test_focal_scaling_compares_cameras_at_one_size():
    predictor = Predictor(TINY)
    assert predictor.focal_scale(518.858, 640) == pytest.approx(1.0)
    assert predictor.focal_scale(518.858, 1280) == pytest.approx(0.5)


def test_a_image_of_another_size_is_answered_at_its_own():
    prediction = Predictor(TINY)(np.zeros((50, 70, 3), np.uint8))
    assert prediction.depth.shape == (50, 70) and prediction.labels.shape == (50, 70)


def frames(dataset, count):
    """The first images of the made dataset, uint8 `[96, 128, 3]` each, the tiny models' size."""
    return [np.array(Image.open(dataset / f"rgb/{index:04d}.png")) for index in range(count)]


def test_images_are_no_stream_and_the_frames_of_one_are(dataset):
    state = json.loads(read_metadata(RECURRENT)["nunet.state"])
    kept = {tensor["input"]: np.zeros(tensor["shape"], np.float32) for tensor in state}
    predictor = Predictor(RECURRENT)
    follow = predictor.stream()
    for index, rgb in enumerate(frames(dataset, 3)):
        given = {"rgb": rgb[None]}
        zeros = {name: np.zeros_like(values) for name, values in kept.items()}
        alone = run_file(RECURRENT, given | zeros)
        after = run_file(RECURRENT, given | kept)
        kept = {tensor["input"]: after[tensor["output"]] for tensor in state}
        np.testing.assert_array_equal(predictor(rgb).depth, alone["depth"][0, 0])
        np.testing.assert_array_equal(follow(rgb).depth, after["depth"][0, 0])
        assert (index > 0) == bool(np.abs(after["depth"] - alone["depth"]).max() > 0.01)


def test_a_stream_of_a_network_without_a_state_equals_its_images(dataset):
    predictor = Predictor(TINY)
    follow = predictor.stream()
    for rgb in frames(dataset, 2):
        np.testing.assert_array_equal(follow(rgb).depth, predictor(rgb).depth)


def test_only_a_clip_carries_the_state_of_a_network(dataset, tmp_path, capsys):
    def measured(*more):
        out = tmp_path / "rows.csv"
        assert evaluate(dataset, "--csv", str(out), *more, model=RECURRENT) == 0
        found = json.loads(capsys.readouterr().out)
        return out.read_text().splitlines()[1:], found

    (first, second), alone = measured()
    (also_first, followed), clip = measured("--clip")
    assert first == also_first and second != followed
    assert alone["metrics"] != clip["metrics"]
    assert measured("--clip")[1] == clip, "each pass over the frames resets the state"
    (dataset / "val.txt").write_text("0005\n0004\n")
    assert sorted(measured()[0]) == [first, second]

    pairs = [a_pair(np.array(Image.open(dataset / f"depth/000{i}.png")) / 1000) for i in (5, 4)]
    pairs = [replace(p, rgb=rgb) for p, rgb in zip(pairs, frames(dataset, 6)[:3:-1], strict=True)]
    assert measured("--clip")[1]["clip"] == clip_metrics(pairs, Predictor(RECURRENT).stream())


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
