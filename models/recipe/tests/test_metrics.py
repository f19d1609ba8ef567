"""Metrics against values worked out by hand."""

import math

import numpy as np
import pytest

from nunet_models.classes import IGNORE
from nunet_models.metrics import METRICS, DepthMetrics, LabelMetrics, image_mean


def metrics(predicted, truth):
    metrics = DepthMetrics()
    metrics.add(np.array(predicted, dtype=np.float32), np.array(truth, dtype=np.float32))
    return metrics.values()


def test_every_depth_figure_of_two_pixels():
    found = metrics([2.0, 2.0], [1.0, 4.0])
    ln2 = math.log(2)
    assert found["mse"] == pytest.approx((1 + 4) / 2)
    assert found["rmse"] == pytest.approx(math.sqrt(2.5))
    assert found["rmse_log"] == pytest.approx(ln2)
    assert found["log10"] == pytest.approx(math.log10(2))
    assert found["abs_rel"] == pytest.approx((1 + 0.5) / 2)
    assert found["sq_rel"] == pytest.approx((1 + 1) / 2)
    assert found["silog"] == pytest.approx(100 * ln2)  # d = ln2, -ln2: the mean is 0
    assert found["delta1"] == 0.0
    assert found["delta2"] == 0.0  # 1.25^2 = 1.5625
    assert found["delta3"] == 0.0  # 1.25^3 = 1.953


def test_deltas_count_pixels_within_their_ratio():
    found = metrics([1.2, 1.5, 1.9, 2.1], [1.0, 1.0, 1.0, 1.0])
    assert (found["delta1"], found["delta2"], found["delta3"]) == (0.25, 0.5, 0.75)


def test_silog_is_zero_for_a_wrong_scale():
    assert metrics([2.0, 4.0], [1.0, 2.0])["silog"] == pytest.approx(0.0, abs=1e-4)


def test_figures_are_pooled_over_pixels_not_images():
    metrics = DepthMetrics()
    metrics.add(np.array([1.0, 1.0, 1.0]), np.array([2.0, 2.0, 2.0]))
    metrics.add(np.array([1.0]), np.array([1.0]))
    assert metrics.values()["mse"] == pytest.approx(3 / 4)


def test_images_weigh_alike_in_the_mean_over_images():
    alone = [metrics([1.0, 1.0, 1.0], [2.0, 2.0, 2.0]), metrics([4.0], [1.0]), {}]
    found = image_mean(alone)
    assert list(found) == list(METRICS)
    assert found["rmse"] == pytest.approx((1 + 3) / 2)
    assert found["mse"] == pytest.approx((1 + 9) / 2)
    assert found["abs_rel"] == pytest.approx((0.5 + 3) / 2)
    assert image_mean([{}]) == image_mean([]) == {}


def test_pixels_without_prediction_are_counted():
    metrics = DepthMetrics()
    metrics.add(np.array([1.0, np.nan, np.nan]), np.array([1.0, 2.0, np.nan]))
    assert (metrics.pixels, metrics.missing) == (1, 1)


def test_miou_and_accuracy_of_a_small_image():
    metrics = LabelMetrics(3)
    metrics.add(np.array([0, 0, 1, 1]), np.array([0, 1, 1, IGNORE]))
    found = metrics.values()
    # class 0: hit 1, union 2; class 1: hit 1, union 2; class 2 unseen
    assert found["miou"] == pytest.approx(0.5)
    assert found["accuracy"] == pytest.approx(2 / 3)


@pytest.mark.parametrize("beyond", [3, 4, 254, IGNORE])
def test_a_prediction_that_is_no_class_is_wrong_and_no_other_class_s(beyond):
    metrics = LabelMetrics(3)
    truth = np.array([0, 0, 1, 2], np.uint8)
    metrics.add(np.array([0, beyond, 1, beyond], np.uint8), truth)
    # class 0: hit 1, union 2; class 1: hit 1, union 1; class 2: hit 0, union 1
    assert metrics.values() == pytest.approx({"miou": (0.5 + 1 + 0) / 3, "accuracy": 0.5})


def test_truth_that_is_no_class_of_the_network_is_not_counted():
    metrics = LabelMetrics(3)
    metrics.add(np.array([0, 1, 2], np.uint8), np.array([0, 3, 12], np.uint8))
    assert metrics.values() == {"miou": 1.0, "accuracy": 1.0}
