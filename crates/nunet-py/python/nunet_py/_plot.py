"""A result as a figure of matplotlib, which is an optional package."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from matplotlib.patches import Patch

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from nunet_py import Result

# The number of colors of the color map; with more classes, colors repeat and the legend ends here.
_MAX_NAMES = 20
# Pixels without depth: the gray of `colorize`.
_GRAY = (0.59, 0.59, 0.59)


class _NotebookFigure(Figure):
    """A figure that a notebook shows, although it is not managed by pyplot."""

    def _repr_png_(self) -> bytes:
        png = io.BytesIO()
        self.savefig(png, format="png")
        return png.getvalue()


def plot(result: Result) -> Figure:
    """Plot the image, its depth with a scale, and its labels with their names, side by side."""
    count = 2 if result.labels is None else 3
    figure = _NotebookFigure(figsize=(5 * count, 4), layout="constrained")
    panels: list[Axes] = list(figure.subplots(1, count))
    for panel in panels:
        panel.set_axis_off()
    panels[0].imshow(result.rgb)
    panels[0].set_title("image")
    _draw_depth(figure, panels[1], result)
    if result.labels is not None:
        _draw_labels(panels[2], result.labels, result.class_names)
    return figure


def _draw_depth(figure: Figure, panel: Axes, result: Result) -> None:
    valid = result.depth[np.isfinite(result.depth)]
    near, far = np.percentile(valid, [1, 99]) if valid.size else (0.0, 1.0)
    turbo = colormaps["turbo_r"].with_extremes(bad=_GRAY)
    drawn = panel.imshow(result.depth, cmap=turbo, vmin=float(near), vmax=float(far))
    panel.set_title(f"depth ({result.scale_source})")
    figure.colorbar(drawn, ax=panel, label="meters" if result.units == "metre" else "relative")


def _draw_labels(panel: Axes, labels: np.typing.NDArray[np.uint8], names: tuple[str, ...]) -> None:
    colors = colormaps["tab20"]
    panel.imshow(colors(labels % _MAX_NAMES))
    panel.set_title("labels")
    classes = [int(index) for index in np.unique(labels)][:_MAX_NAMES]
    named = [names[index] if index < len(names) else str(index) for index in classes]
    patches = [
        Patch(color=colors(index % _MAX_NAMES), label=name)
        for index, name in zip(classes, named, strict=True)
    ]
    panel.legend(handles=patches, loc="upper left", bbox_to_anchor=(1, 1))
