"""Sparsification: the error of the pixels that a confidence ranks highest, per image.

A useful confidence puts the wrong pixels last, so that the error falls as fewer pixels are kept.
The oracle ranks pixels by their true error, which no confidence can beat. In a random order, each
share of the pixels has the error of all of them. (Ilg et al., "Uncertainty estimates and
multi-hypotheses networks for optical flow", 2018.)
"""

import numpy as np

KEPT = (90, 75, 50)
"""Percentages of the most certain pixels whose error is stated."""

CURVE = tuple(range(5, 101, 5))
"""Percentages whose mean distance from the oracle is the area."""

MEDIAN = "_median"
"""Suffix of metrics after a median fit of the image."""

METRICS: tuple[str, ...] = (
    *(f"certain_{percent}" for percent in KEPT),
    *(f"oracle_{percent}" for percent in KEPT),
    *("area", "area_random"),
)
"""Names of the metrics: AbsRel of the most certain pixels, and by the true error; then the mean
distance of both over `CURVE`, and that of a random order from the oracle. 0 is perfect, and an area
as large as `area_random` is useless."""


def of_depth(predicted: np.ndarray, truth: np.ndarray, confidence: np.ndarray) -> dict[str, float]:
    """AbsRel and `METRICS` of one image, all `[N]`; `NAME_median` is after a fit of the median.

    The fit removes the image's own error of scale, which no pixel's confidence can tell.
    """
    fit = np.median(truth) / np.median(predicted) if truth.size else 1.0
    found = {}
    for suffix, scaled in (("", predicted), (MEDIAN, predicted * fit)):
        error = np.abs(scaled - truth) / truth
        for name, value in sparsification(error, confidence).items():
            found[f"{name}{suffix}"] = value
        if error.size:
            found[f"abs_rel{suffix}"] = float(error.mean())
    return found


def sparsification(error: np.ndarray, confidence: np.ndarray) -> dict[str, float]:
    """`METRICS` of one image, from each pixel's error and its confidence 0..255; both `[N]`.

    Pixels of equal confidence count as if their order was random.
    """
    if not error.size:
        return {}
    kept = {percent: _kept(error.size, percent) for percent in CURVE}
    certain = _means_by_confidence(error, confidence, kept)
    oracle = np.cumsum(np.sort(error.astype(np.float64)))
    best = {percent: float(oracle[count - 1]) / count for percent, count in kept.items()}
    mean = best[100]
    return {
        **{f"certain_{percent}": certain[percent] for percent in KEPT},
        **{f"oracle_{percent}": best[percent] for percent in KEPT},
        "area": float(np.mean([certain[percent] - best[percent] for percent in CURVE])),
        "area_random": float(np.mean([mean - best[percent] for percent in CURVE])),
    }


def _kept(pixels: int, percent: int) -> int:
    """How many pixels a percentage is, rounded half up; at least one."""
    return max(1, (percent * pixels + 50) // 100)


def _means_by_confidence(
    error: np.ndarray, confidence: np.ndarray, kept: dict[int, int]
) -> dict[int, float]:
    """Mean error of so many of the most certain pixels, by percentage."""
    counts = np.bincount(confidence, minlength=256)[::-1]
    sums = np.bincount(confidence, weights=error.astype(np.float64), minlength=256)[::-1]
    pixels, errors = np.cumsum(counts), np.cumsum(sums)
    means = {}
    for percent, count in kept.items():
        level = int(np.searchsorted(pixels, count))  # the level that is kept in part
        above = count - (pixels[level] - counts[level])
        total = errors[level] - sums[level] + above * sums[level] / counts[level]
        means[percent] = float(total) / count
    return means
