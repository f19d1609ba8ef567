"""Table of the differences of networks that were measured on the same images."""

from collections.abc import Sequence
from pathlib import Path

from nunet_models.evaluation.differences import Scores, paired_difference, read_scores
from nunet_models.reporting.table import markdown

METRICS = ("rmse", "abs_rel", "delta1", "minmax_mse")
"""Means over images; those that neither network has are omitted."""


def difference_table(pairs: Sequence[tuple[str, str]], metrics: Sequence[str] = METRICS) -> str:
    """A row per metric of each pair of networks.

    Each network is a comma-separated list of files of `evaluate --csv`, one per seed, whose mean
    per image is compared.
    """
    rows = [("first", "second", "metric", "first", "second", "difference", "95 % of resamples")]
    for pair in pairs:
        files = [[Path(name) for name in text.split(",")] for text in pair]
        names = tuple(", ".join(path.stem for path in paths) for paths in files)
        for metric in metrics:
            first, second = (read_scores(paths, metric) for paths in files)
            if _any(first) or _any(second):
                rows.append((*names, metric, *_cells(first, second)))
    return markdown(rows)


def _any(scores: Scores) -> bool:
    return any(value is not None for value in scores.values())


def _cells(first: Scores, second: Scores) -> tuple[str, ...]:
    found = paired_difference(first, second)
    change = found.second - found.first
    interval = f"{found.low:+.4f} to {found.high:+.4f}"
    return f"{found.first:.4f}", f"{found.second:.4f}", f"{change:+.4f}", interval
