"""Whether two networks differ on the same images, by a paired bootstrap over the images."""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nunet_models.errors import DataError
from nunet_models.evaluation.compare import ROW
from nunet_models.files import finite, read_text

RESAMPLES = 10_000
COVERAGE = 0.95
SHOWN = 3  # of the images that only one list has

Scores = Mapping[str, float | None]
"""A metric by image; None where it could not be measured."""


@dataclass(frozen=True)
class Difference:
    """Means of a metric over images, and an interval of `second - first`.

    In 95 % of the resamples the difference lies from `low` to `high`. They are of the images
    alone: how much another training of the same network would differ is not in them.
    """

    first: float
    second: float
    low: float
    high: float
    images: int

    @property
    def certain(self) -> bool:
        """Whether the interval excludes 0."""
        return self.low > 0.0 or self.high < 0.0


def paired_difference(
    first: Scores, second: Scores, *, resamples: int = RESAMPLES, seed: int = 0
) -> Difference:
    """The difference of two networks' mean over the images that both were measured on.

    Each resample draws as many images as there are, with replacement, and both networks get the
    same ones (Efron and Tibshirani, "An introduction to the bootstrap", 1993, percentile interval).
    How hard an image is thus cancels out.

    # Errors
    `DataError` if the images are not the same, or fewer than two have the metric.
    """
    other = sorted(first.keys() ^ second.keys())
    if other:
        some = ", ".join(f"`{name}`" for name in other[:SHOWN])
        raise DataError(
            f"{len(other)} images are in one list only: {some}",
            hint="measure both networks on the same images",
        )
    pairs = [(first[name], second[name]) for name in first]
    known = np.array([pair for pair in pairs if None not in pair], np.float64).reshape(-1, 2)
    if len(known) < 2:
        raise DataError(f"{len(known)} images have the metric; expected 2 or more")
    change = known[:, 1] - known[:, 0]
    random = np.random.default_rng(seed)
    means = [
        change[random.integers(len(change), size=len(change))].mean() for _ in range(resamples)
    ]
    low, high = np.quantile(means, [(1.0 - COVERAGE) / 2.0, (1.0 + COVERAGE) / 2.0])
    mean = known.mean(0)
    return Difference(float(mean[0]), float(mean[1]), float(low), float(high), len(known))


def read_scores(paths: Sequence[Path], metric: str) -> dict[str, float | None]:
    """A metric by image from the rows of `evaluate --csv`, mean over the files (several seeds).

    # Errors
    `DataError` naming a file without such rows, or with other images than the first one.
    """
    tables = [_column(path, metric) for path in paths]
    for path, table in zip(paths, tables, strict=True):
        if table.keys() != tables[0].keys():
            raise DataError(
                f"`{path}` is of other images than `{paths[0]}`",
                hint="measure all seeds on the same images",
            )
    return {name: _mean([table[name] for table in tables]) for name in tables[0]}


def _column(path: Path, metric: str) -> dict[str, float | None]:
    rows = csv.DictReader(io.StringIO(read_text(path, "a table")))
    if not {"id", metric} <= set(rows.fieldnames or ()):
        raise DataError(
            f"`{path}` has no columns `id` and `{metric}`",
            hint=f"`evaluate --csv` writes {', '.join(ROW[:3])}, ...",
        )
    found: dict[str, float | None] = {}
    for row in rows:
        found[row["id"]] = _number(row[metric], path, rows.line_num)
    return found


def _number(text: str | None, path: Path, line: int) -> float | None:
    """A metric; None where it could not be measured, which is an empty cell."""
    if not text:
        return None
    number = finite(text)
    if number is None:
        raise DataError(f"`{path}`, line {line}: `{text}` is not a number")
    return number


def _mean(values: list[float | None]) -> float | None:
    return None if None in values else float(np.mean(values))
