"""Self-test of a model file: the image `nunet-selftest-1` and its expected output.

See docs/book/model-file.md.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

IMAGE = "nunet-selftest-1"
GRID_WIDTH = 8
GRID_HEIGHT = 6
CLOSE_CALL = 0.01  # a smaller lead, in shares of a cell, depends on the runtime


def selftest_image(width: int, height: int) -> np.ndarray:
    """The image `nunet-selftest-1`: uint8 `[height, width, 3]`, RGB, rows top to bottom.

    Integers only, so that every language computes the same bytes.
    """
    u, v = np.meshgrid(256 * np.arange(width) // width, 256 * np.arange(height) // height)
    t = (7 * u + 13 * v + u * v // 32) % 23
    check = ((u + v) // 24 + (v - 168) // 12) % 2
    everywhere = np.ones_like(u, dtype=bool)
    layers = (
        (everywhere, (150 - u // 4 + t, 130 - v // 4 + t, 100 + u // 8 + t)),
        (v >= 168, (90 + 40 * check + t, 70 + 30 * check + t, 50 + 10 * check + v // 8)),
        (
            (u >= 24) & (u < 92) & (v >= 88) & (v < 208),
            (170 - v // 4 + t, 40 + u // 4, 40 + t),
        ),
        (
            (u >= 168) & (u < 232) & (v >= 24) & (v < 104),
            (60 + t, 140 + v // 5, 200 + u // 8),
        ),
        ((u - 140) ** 2 + (v - 180) ** 2 < 28**2, (30 + t, 150 - u // 4, 40 + v // 4)),
    )
    image = np.zeros((height, width, 3), dtype=np.uint8)
    for where, channels in layers:
        for channel, value in enumerate(channels):
            image[..., channel][where] = value[where]
    return image


@dataclass(frozen=True)
class SelfTestGrid:
    """Grid of lower medians of decoded depth and, where there are any, of majority labels.

    `depth` is float64 `[6, 8]`, NaN where a cell has no finite depth; `labels` int `[6, 8]`;
    `close_calls` counts the cells whose label leads the next by under a hundredth of the pixels.
    """

    depth: np.ndarray
    labels: np.ndarray | None
    close_calls: int

    def distance(self, other: "SelfTestGrid") -> tuple[float, int]:
        """Largest difference of a depth cell, and how many cells differ in label.

        The distance is infinite if a cell has depth in one grid only.
        """
        gap = np.abs(self.depth - other.depth)
        both_empty = np.isnan(self.depth) & np.isnan(other.depth)
        worst = float(np.where(both_empty, 0.0, np.nan_to_num(gap, nan=np.inf)).max())
        if self.labels is None or other.labels is None:
            return worst, 0
        return worst, int((self.labels != other.labels).sum())

    def to_json(self, *, precision: str, tolerance: dict[str, dict[str, float]]) -> dict:
        """The value of `nunet.selftest`."""
        rows = [[None if np.isnan(z) else round(float(z), 6) for z in row] for row in self.depth]
        result: dict = {"version": 1, "picture": IMAGE, "precision": precision, "depth": rows}
        if self.labels is not None:
            result["labels"] = self.labels.tolist()
        return {**result, "tolerance": tolerance}


def grid_from_outputs(depth: np.ndarray, labels: np.ndarray | None) -> SelfTestGrid:
    """Summarize decoded depth `[1, 1, H, W]` (NaN = none) and labels `[1, H, W]` on the grid."""
    medians = [[_lower_median(cell) for cell in row] for row in _cells(depth[0, 0])]
    if labels is None:
        return SelfTestGrid(np.array(medians), labels=None, close_calls=0)
    votes = [[_majority(cell) for cell in row] for row in _cells(labels[0])]
    return SelfTestGrid(
        np.array(medians),
        labels=np.array([[label for label, _ in row] for row in votes]),
        close_calls=sum(lead < CLOSE_CALL for row in votes for _, lead in row),
    )


def _cells(image: np.ndarray) -> list[list[np.ndarray]]:
    height, width = image.shape
    tops = [i * height // GRID_HEIGHT for i in range(GRID_HEIGHT + 1)]
    lefts = [j * width // GRID_WIDTH for j in range(GRID_WIDTH + 1)]
    return [
        [image[top:bottom, left:right] for left, right in pairwise(lefts)]
        for top, bottom in pairwise(tops)
    ]


def _lower_median(cell: np.ndarray) -> float:
    finite = np.sort(cell[np.isfinite(cell)], axis=None)
    return float(finite[(finite.size - 1) // 2]) if finite.size else float("nan")


def _majority(cell: np.ndarray) -> tuple[int, float]:
    counts = np.bincount(cell.ravel(), minlength=2)
    second, first = np.sort(counts)[-2:]
    return int(counts.argmax()), float(first - second) / cell.size
