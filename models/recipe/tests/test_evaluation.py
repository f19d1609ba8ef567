"""Evaluation: protocols, baselines and clips, on numbers worked out by hand."""

import json
from dataclasses import replace

import numpy as np
import pytest
from comparisons import a_pair, answering
from PIL import Image
from runs import TINY
from runs import evaluate_tiny as evaluate

from nunet_models.errors import DataError
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
from nunet_models.export.onnx_file import read_metadata
from nunet_models.export.onnx_file import run as run_file

RECURRENT = TINY.with_name("tiny_wnet_c_lstm.onnx")


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
