"""Figures: loss curves, an image evolving over epochs, networks side by side."""

import csv
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from nunet_models.errors import DataError
from nunet_models.evaluation.compare import stretched
from nunet_models.files import read_text
from nunet_models.training.log import EVOLUTION

DPI = 120
MANY = 10  # curves, from which on colors of ten would come twice
LOGGED = {"steps.csv": ("step", "loss"), "epochs.csv": ("epoch", "miou", "rmse")}
"""Of each log of a run: the column that numbers its rows, and those of which one is drawn."""
EPOCHS_SHOWN = 6  # as many as fit side by side on a page

Panel = tuple[str, np.ndarray]
"""A caption, and an image: color uint8 `[H, W, 3]`, or depth float `[H, W]` with NaN = none."""


@dataclass(frozen=True)
class NetworkDepth:
    """A network's depth `[H, W]`: meters if `metric`, else 0 (nearest) to 1 (farthest)."""

    caption: str
    depth: np.ndarray
    metric: bool


def loss_curves(runs: list[Path], out: Path) -> None:
    """Training loss by step and the validation metric by epoch of every run, as one image.

    # Errors
    `DataError` naming a folder without logs.
    """
    figure = Figure(figsize=(10, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    for axes in (left, right):
        axes.set_prop_cycle(color=colormaps["tab10" if len(runs) <= MANY else "tab20"].colors)
    for run in runs:
        _plot_run(run, left, right)
    # The first losses are ten times all others, which a linear scale would show as one flat line.
    left.set(xlabel="step", ylabel="training loss", yscale="log")
    right.set(xlabel="epoch", ylabel="validation")
    right.xaxis.set_major_locator(MaxNLocator(integer=True))
    for axes in (left, right):
        axes.legend(fontsize="small")
        axes.grid(alpha=0.3)
    figure.savefig(out, dpi=DPI)


def _plot_run(run: Path, left: Axes, right: Axes) -> None:
    """Plot one run: its loss on the left, its validation metric on the right."""
    steps, epochs = _rows(run / "steps.csv"), _rows(run / "epochs.csv")
    alone = "." if len(steps) == 1 else ""  # one point makes no line
    values = [r["loss"] for r in steps]
    left.plot([r["step"] for r in steps], values, label=run.name, lw=1, marker=alone)
    name = "miou" if "miou" in epochs[0] else "rmse"
    values = [r[name] for r in epochs]
    right.plot([r["epoch"] for r in epochs], values, label=f"{run.name}: {name}", marker=".")


def side_by_side(rows: list[list[Panel]], out: Path) -> None:
    """Rows of panels as one image; the depth panels of a row share one color scale.

    The scale is that of the row's first depth panel, the truth where there is one: another for
    each network would hide an error of scale. It ends at the panel's 1st and 99th percentile, since
    a network's few odd pixels at an image's edge would take all colors from the rest.
    """
    columns = max(len(row) for row in rows)
    figure = Figure(figsize=(2.6 * columns, 2.1 * len(rows)), layout="constrained")
    axes = figure.subplots(len(rows), columns, squeeze=False)
    for line, row in zip(axes, rows, strict=True):
        depths = [image for _, image in row if image.ndim == 2]
        limits = np.nanpercentile(depths[0], (1.0, 99.0)) if depths else (0.0, 1.0)
        for place, (caption, image) in zip(line, row, strict=False):
            if image.ndim == 2:
                place.imshow(image, cmap="turbo_r", vmin=limits[0], vmax=limits[1])
            else:
                place.imshow(image)
            place.set_title(caption, fontsize="small")
        for place in line:
            place.axis("off")
    figure.savefig(out, dpi=DPI)


def comparable_panels(truth_m: np.ndarray, outputs: list[NetworkDepth]) -> list[Panel]:
    """The truth and all outputs in one unit: meters, or all 0..1 if one of them is not metric.

    Metric depth is then stretched from its nearest to its farthest point, as in the paper.
    """
    if all(output.metric for output in outputs):
        return [("truth", truth_m)] + [(output.caption, output.depth) for output in outputs]
    known = np.isfinite(truth_m)
    panels: list[Panel] = [("truth, 0..1", stretched(truth_m, known))]
    for output in outputs:
        depth = stretched(output.depth, known) if output.metric else output.depth
        panels.append((output.caption, depth))
    return panels


def evolution(run: Path) -> list[Panel]:
    """The kept predictions of a run, at most `EPOCHS_SHOWN` of them, first and last included.

    Labels are shown as numbers, as depth is.
    """
    kept = sorted((run / EVOLUTION).glob("*.npy"))
    chosen = np.unique(np.linspace(0, len(kept) - 1, min(len(kept), EPOCHS_SHOWN)).round())
    paths = [kept[int(index)] for index in chosen]
    return [(f"{run.name} {int(p.stem)}", np.load(p).astype(np.float32)) for p in paths]


def _rows(path: Path) -> list[dict[str, float]]:
    """Rows of a log; of a step or epoch that a resumed run repeated, the later one."""
    if not path.is_file():
        raise DataError(f"no log `{path}`", hint="a run's folder has one after its first epoch")
    reader = csv.DictReader(io.StringIO(read_text(path, "a log")))
    try:
        rows = [{k: float(v) for k, v in row.items()} for row in reader]
    except (TypeError, ValueError) as error:  # also too few or too many values
        raise DataError(f"`{path}`, line {reader.line_num}: {error}") from error
    if not rows:
        raise DataError(f"`{path}` is empty")
    key, *metrics = LOGGED[path.name]
    if key not in rows[0] or not rows[0].keys() & set(metrics):
        raise DataError(f"`{path}` has no columns `{key}` and `{'` or `'.join(metrics)}`")
    return [row for _, row in sorted({row[key]: row for row in rows}.items())]
