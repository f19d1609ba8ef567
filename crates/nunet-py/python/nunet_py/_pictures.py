"""Results for people's eyes, with packages that are extras."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from nunet_py import Cloud, Result

# Of more classes than that nobody tells the colours apart.
_MOST_NAMES = 20


def plot(result: Result) -> Figure:
    """The picture, its depth with a scale, and its labels with their names, side by side."""
    try:
        from matplotlib import colormaps
        from matplotlib.figure import Figure
        from matplotlib.patches import Patch
    except ModuleNotFoundError as error:
        raise ImportError("`plot` needs matplotlib\nhint: `pip install matplotlib`") from error

    count = 2 if result.labels is None else 3
    figure = Figure(figsize=(5 * count, 4), layout="constrained")
    panels = figure.subplots(1, count)
    panels[0].imshow(result.rgb)
    panels[0].set_title("picture")
    metric = result.units == "metre"
    # The colours of `colorize`: near is red, far is blue, no depth is grey.
    turbo = colormaps["turbo_r"].with_extremes(bad=(0.59, 0.59, 0.59))
    valid = result.depth[np.isfinite(result.depth)]
    near, far = np.percentile(valid, [1, 99]) if valid.size else (0.0, 1.0)
    drawn = panels[1].imshow(result.depth, cmap=turbo, vmin=float(near), vmax=float(far))
    panels[1].set_title(f"depth ({result.scale_source})")
    figure.colorbar(drawn, ax=panels[1], label="metres" if metric else "relative")
    if result.labels is not None:
        classes = np.unique(result.labels)
        colours = colormaps["tab20"]
        panels[2].imshow(colours(result.labels % _MOST_NAMES))
        panels[2].set_title("labels")
        names = dict(enumerate(result.class_names))
        patches = [
            Patch(color=colours(int(index) % _MOST_NAMES), label=names.get(int(index), str(index)))
            for index in classes[:_MOST_NAMES]
        ]
        panels[2].legend(handles=patches, loc="upper left", bbox_to_anchor=(1, 1))
    for panel in panels:
        panel.set_axis_off()
    return figure


def to_open3d(cloud: Cloud) -> Any:
    """The valid points with their colours as an `open3d.geometry.PointCloud`."""
    try:
        import open3d
    except ModuleNotFoundError as error:
        raise ImportError("`to_open3d` needs open3d\nhint: `pip install open3d`") from error

    valid = np.isfinite(cloud.points[..., 2])
    points = open3d.geometry.PointCloud()
    points.points = open3d.utility.Vector3dVector(cloud.points[valid].astype(np.float64))
    points.colors = open3d.utility.Vector3dVector(cloud.colors[valid].astype(np.float64) / 255)
    return points
