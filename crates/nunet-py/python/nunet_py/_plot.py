"""A result drawn with matplotlib, which is an extra."""

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

# Of more classes than that nobody tells the colours apart.
_MOST_NAMES = 20
# Where there is no depth: the grey of `colorize`.
_GREY = (0.59, 0.59, 0.59)


class _Shown(Figure):
    """A figure that a notebook shows, though no window and no pyplot knows it."""

    def _repr_png_(self) -> bytes:
        picture = io.BytesIO()
        self.savefig(picture, format="png")
        return picture.getvalue()


def plot(result: Result) -> Figure:
    """The picture, its depth with a scale, and its labels with their names, side by side."""
    count = 2 if result.labels is None else 3
    figure = _Shown(figsize=(5 * count, 4), layout="constrained")
    panels: list[Axes] = list(figure.subplots(1, count))
    for panel in panels:
        panel.set_axis_off()
    panels[0].imshow(result.rgb)
    panels[0].set_title("picture")
    _draw_depth(figure, panels[1], result)
    if result.labels is not None:
        _draw_labels(panels[2], result.labels, result.class_names)
    return figure


def _draw_depth(figure: Figure, panel: Axes, result: Result) -> None:
    valid = result.depth[np.isfinite(result.depth)]
    near, far = np.percentile(valid, [1, 99]) if valid.size else (0.0, 1.0)
    turbo = colormaps["turbo_r"].with_extremes(bad=_GREY)
    drawn = panel.imshow(result.depth, cmap=turbo, vmin=float(near), vmax=float(far))
    panel.set_title(f"depth ({result.scale_source})")
    figure.colorbar(drawn, ax=panel, label="metres" if result.units == "metre" else "relative")


def _draw_labels(panel: Axes, labels: np.typing.NDArray[np.uint8], names: tuple[str, ...]) -> None:
    colours = colormaps["tab20"]
    panel.imshow(colours(labels % _MOST_NAMES))
    panel.set_title("labels")
    classes = [int(index) for index in np.unique(labels)][:_MOST_NAMES]
    named = [names[index] if index < len(names) else str(index) for index in classes]
    patches = [
        Patch(color=colours(index % _MOST_NAMES), label=name) for index, name in zip(classes, named, strict=True)
    ]
    panel.legend(handles=patches, loc="upper left", bbox_to_anchor=(1, 1))
