"""Metrics of depth and labels, summed image by image.

Depth metrics are pooled over all pixels that have truth and prediction, so that an image with
half its pixels weighs half. The code of AdaBins, BTS and FastDepth averages the metrics of each
image instead (`image_mean`). That RMSE is usually smaller, because it is a mean of roots.
Always state which of the two a value is.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

DELTA = 1.25

METRICS = (
    *("mse", "rmse", "rmse_log", "log10", "abs_rel", "sq_rel", "silog"),
    *("delta1", "delta2", "delta3"),
)
"""Names of the metrics of depth, in the order of every table."""


@dataclass
class DepthMetrics:
    """Sums over pixels from which the metrics follow."""

    sums: dict[str, float] = field(default_factory=dict)
    pixels: int = 0
    missing: int = 0

    def add(self, predicted: np.ndarray, truth: np.ndarray) -> None:
        """Count one image: float arrays of one shape and unit, positive, NaN = none.

        Pixels with truth but no prediction are counted in `missing` only.
        """
        known = np.isfinite(truth)
        both = known & np.isfinite(predicted)
        self.missing += int(known.sum() - both.sum())
        p, t = predicted[both].astype(np.float64), truth[both].astype(np.float64)
        for name, value in _pixel_sums(p, t).items():
            self.sums[name] = self.sums.get(name, 0.0) + value
        self.pixels += p.size

    def merge(self, other: "DepthMetrics") -> None:
        """Count the images that `other` counted as well."""
        for name, value in other.sums.items():
            self.sums[name] = self.sums.get(name, 0.0) + value
        self.pixels += other.pixels
        self.missing += other.missing

    def values(self) -> dict[str, float]:
        """Every metric by name; empty if no pixel was compared.

        mse `mean((p-t)^2)`, rmse its root, rmse_log `sqrt(mean((ln p - ln t)^2))`, log10
        `mean(|log10 p - log10 t|)`, abs_rel `mean(|p-t|/t)`, sq_rel `mean((p-t)^2/t)`, silog
        `100 sqrt(mean(d^2) - mean(d)^2)` with `d = ln p - ln t`, delta k the share of pixels with
        `max(p/t, t/p) < 1.25^k` (Eigen et al. 2014; silog as KITTI's benchmark has it).
        """
        if not self.pixels:
            return {}
        mean = {name: value / self.pixels for name, value in self.sums.items()}
        variance = max(mean["d2"] - mean["d"] ** 2, 0.0)
        return {
            "mse": mean["e2"],
            "rmse": mean["e2"] ** 0.5,
            "rmse_log": mean["d2"] ** 0.5,
            "log10": mean["abs_d"] / float(np.log(10.0)),
            "abs_rel": mean["abs_rel"],
            "sq_rel": mean["sq_rel"],
            "silog": 100.0 * variance**0.5,
            "delta1": mean["delta1"],
            "delta2": mean["delta2"],
            "delta3": mean["delta3"],
        }


def _pixel_sums(p: np.ndarray, t: np.ndarray) -> dict[str, float]:
    e = p - t
    d = np.log(p) - np.log(t)
    ratio = np.exp(np.abs(d))
    return {
        "e2": float(np.square(e).sum()),
        "d": float(d.sum()),
        "d2": float(np.square(d).sum()),
        "abs_d": float(np.abs(d).sum()),
        "abs_rel": float((np.abs(e) / t).sum()),
        "sq_rel": float((np.square(e) / t).sum()),
        **{f"delta{k}": float((ratio < DELTA**k).sum()) for k in (1, 2, 3)},
    }


def image_mean(images: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """The mean over images of each metric, given the depth metrics of each image by name.

    Images weigh the same, however many pixels they have; those without metrics do not count.
    """
    measured = [metrics for metrics in images if METRICS[0] in metrics]
    if not measured:
        return {}
    return {name: float(np.mean([metrics[name] for metrics in measured])) for name in METRICS}


class LabelMetrics:
    """Confusion of `classes` labels, from which accuracy and intersection over union follow.

    `confusion[truth, predicted]` has an extra column for predictions that are not a class; they
    count as errors.
    """

    def __init__(self, classes: int) -> None:
        self.confusion = np.zeros((classes, classes + 1), dtype=np.int64)

    def add(self, predicted: np.ndarray, truth: np.ndarray) -> None:
        """Count one image: integer arrays of one shape.

        Pixels whose truth is not a class, such as `classes.IGNORE`, are skipped.
        """
        classes, columns = self.confusion.shape
        known = truth < classes
        guess = np.minimum(predicted[known].astype(np.int64), classes)
        index = truth[known].astype(np.int64) * columns + guess
        self.confusion += np.bincount(index, minlength=classes * columns).reshape(classes, columns)

    @property
    def pixels(self) -> int:
        """How many pixels were counted."""
        return int(self.confusion.sum())

    def values(self) -> dict[str, float]:
        """`miou`: mean of `hit / (truth + predicted - hit)` over classes seen in the truth or
        predicted; `accuracy`: share of pixels that are right."""  # noqa: D205, D209
        hit = np.diag(self.confusion).astype(np.float64)
        union = self.confusion.sum(0)[:-1] + self.confusion.sum(1) - hit
        seen = union > 0
        if not self.pixels:
            return {}
        return {
            "miou": float((hit[seen] / union[seen]).mean()),
            "accuracy": float(hit.sum() / self.pixels),
        }
