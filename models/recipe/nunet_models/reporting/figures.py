"""Figures: loss curves, a picture evolving over epochs, networks side by side."""

import csv
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from nunet_models.errors import DataError

DPI = 120

Panel = tuple[str, np.ndarray]
"""A caption, and a picture: colour uint8 `[H, W, 3]`, or depth float `[H, W]` with NaN = none."""


def loss_curves(runs: list[Path], out: Path) -> None:
    """Training loss by step and the validation figure by epoch of every run, as one picture.

    # Errors
    `DataError` naming a folder without logs.
    """
    figure = Figure(figsize=(10, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    for run in runs:
        steps, epochs = _rows(run / "steps.csv"), _rows(run / "epochs.csv")
        left.plot([r["step"] for r in steps], [r["loss"] for r in steps], label=run.name, lw=1)
        name = "miou" if "miou" in epochs[0] else "rmse"
        values = [r[name] for r in epochs]
        right.plot([r["epoch"] for r in epochs], values, label=f"{run.name}: {name}", marker=".")
    left.set(xlabel="step", ylabel="training loss")
    right.set(xlabel="epoch", ylabel="validation")
    for axes in (left, right):
        axes.legend(fontsize="small")
        axes.grid(alpha=0.3)
    figure.savefig(out, dpi=DPI)


def side_by_side(rows: list[list[Panel]], out: Path) -> None:
    """Rows of panels as one picture; the depth panels of a row share one colour scale.

    The scale is the first depth panel's (the truth's): another for each network would hide an
    error of scale.
    """
    columns = max(len(row) for row in rows)
    figure = Figure(figsize=(2.6 * columns, 2.1 * len(rows)), layout="constrained")
    axes = figure.subplots(len(rows), columns, squeeze=False)
    for line, row in zip(axes, rows, strict=True):
        depths = [picture for _, picture in row if picture.ndim == 2]
        limits = (np.nanmin(depths[0]), np.nanmax(depths[0])) if depths else (0.0, 1.0)
        for place, (caption, picture) in zip(line, row, strict=False):
            if picture.ndim == 2:
                place.imshow(picture, cmap="turbo_r", vmin=limits[0], vmax=limits[1])
            else:
                place.imshow(picture)
            place.set_title(caption, fontsize="small")
        for place in line:
            place.axis("off")
    figure.savefig(out, dpi=DPI)


def _rows(path: Path) -> list[dict[str, float]]:
    """Rows of a log; of a step or epoch that a resumed run repeated, the later one."""
    if not path.is_file():
        raise DataError(f"no log `{path}`; hint: a run's folder has one after its first epoch")
    with path.open(newline="", encoding="utf-8") as file:
        rows = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]
    if not rows:
        raise DataError(f"`{path}` is empty")
    key = "step" if "step" in rows[0] else "epoch"
    return [row for _, row in sorted({row[key]: row for row in rows}.items())]
