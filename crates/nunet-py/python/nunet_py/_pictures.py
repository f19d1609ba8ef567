"""Results in other packages' hands; those packages are extras."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from nunet_py import Cloud, Result


def plot(result: Result) -> Figure:
    """The picture, its depth with a scale, and its labels with their names, side by side."""
    try:
        from nunet_py._plot import plot
    except ModuleNotFoundError as error:
        raise ImportError("`plot` needs matplotlib\nhint: `pip install matplotlib`") from error
    return plot(result)


def to_open3d(cloud: Cloud) -> Any:
    """The valid points with their colours as an `open3d.geometry.PointCloud`."""
    try:
        # Not by name: it has neither types nor wheels for every Python.
        open3d: Any = import_module("open3d")
    except ModuleNotFoundError as error:
        raise ImportError("`to_open3d` needs open3d\nhint: `pip install open3d`") from error

    valid = np.isfinite(cloud.points[..., 2])
    points = open3d.geometry.PointCloud()
    points.points = open3d.utility.Vector3dVector(cloud.points[valid].astype(np.float64))
    points.colors = open3d.utility.Vector3dVector(cloud.colors[valid].astype(np.float64) / 255)
    return points
