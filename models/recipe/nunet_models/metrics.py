"""Metrics: of depth and of labels, gathered picture by picture.

Depth figures are pooled over all pixels that have truth and prediction, so that a picture with
half its pixels weighs half. The code of AdaBins, BTS and FastDepth takes each picture's figures
alone and then their mean instead (`picture_mean`). Its RMSE is usually smaller, as a mean of
roots is: say which of the two a figure is.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

DELTA = 1.25

FIGURES = (
    *("mse", "rmse", "rmse_log", "log10", "abs_rel", "sq_rel", "silog"),
    *("delta1", "delta2", "delta3"),
)
"""Names of the figures of depth, in the order of every table."""


@dataclass
class DepthMetrics:
    """Sums over pixels from which the figures follow."""

    sums: dict[str, float] = field(default_factory=dict)
    pixels: int = 0
    missing: int = 0

    def add(self, predicted: np.ndarray, truth: np.ndarray) -> None:
        """Count one picture: float arrays of one shape and unit, positive, NaN = none.

        Pixels with truth but no prediction are counted in `missing` and in nothing else.
        """
        known = np.isfinite(truth)
        both = known & np.isfinite(predicted)
        self.missing += int(known.sum() - both.sum())
        p, t = predicted[both].astype(np.float64), truth[both].astype(np.float64)
        for name, value in _pixel_sums(p, t).items():
            self.sums[name] = self.sums.get(name, 0.0) + value
        self.pixels += p.size

    def merge(self, other: "DepthMetrics") -> None:
        """Count the pictures that `other` counted as well."""
        for name, value in other.sums.items():
            self.sums[name] = self.sums.get(name, 0.0) + value
        self.pixels += other.pixels
        self.missing += other.missing

    def figures(self) -> dict[str, float]:
        """Every metric by name; see the module's functions for the formulas.

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


def picture_mean(pictures: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Each figure's mean over pictures, given as each one's own figures of depth by name.

    Pictures weigh alike, whatever their number of pixels; those without a figure do not count.
    """
    measured = [figures for figures in pictures if FIGURES[0] in figures]
    if not measured:
        return {}
    return {name: float(np.mean([figures[name] for figures in measured])) for name in FIGURES}


class LabelMetrics:
    """Confusion of `classes` labels, from which accuracy and intersection over union follow.

    `confusion[truth, predicted]` has one column more than rows, for predictions that are none of
    the classes: they are wrong, and no class's.
    """

    def __init__(self, classes: int) -> None:
        self.confusion = np.zeros((classes, classes + 1), dtype=np.int64)

    def add(self, predicted: np.ndarray, truth: np.ndarray) -> None:
        """Count one picture: integer arrays of one shape.

        Pixels whose truth is none of the classes, as `classes.IGNORE` is, are skipped.
        """
        classes, columns = self.confusion.shape
        known = truth < classes
        guess = np.minimum(predicted[known].astype(np.int64), classes)
        index = truth[known].astype(np.int64) * columns + guess
        self.confusion += np.bincount(index, minlength=classes * columns).reshape(classes, columns)

    def figures(self) -> dict[str, float]:
        """`miou`: mean of `hit / (truth + predicted - hit)` over classes seen in the truth or
        predicted; `accuracy`: share of pixels that are right."""  # noqa: D205, D209
        hit = np.diag(self.confusion).astype(np.float64)
        union = self.confusion.sum(0)[:-1] + self.confusion.sum(1) - hit
        seen = union > 0
        total = self.confusion.sum()
        if not total:
            return {}
        return {
            "miou": float((hit[seen] / union[seen]).mean()),
            "accuracy": float(hit.sum() / total),
        }
