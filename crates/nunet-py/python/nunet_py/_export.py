"""Results for matplotlib and Open3D, which are optional packages."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from nunet_py import Cloud, Result


def plot(result: Result) -> Figure:
    """Plot the image, its depth with a scale, and its labels with their names, side by side."""
    try:
        from nunet_py._plot import plot
    except ModuleNotFoundError as error:
        raise _missing("plot", "matplotlib") from error
    return plot(result)


def to_open3d(cloud: Cloud) -> Any:
    """Return the points that have depth, with their colors, as an `open3d.geometry.PointCloud`."""
    try:
        # Not imported by name: it has neither types nor wheels for every Python version.
        open3d: Any = import_module("open3d")
    except ModuleNotFoundError as error:
        raise _missing("to_open3d", "open3d") from error

    valid = np.isfinite(cloud.points[..., 2])
    points = open3d.geometry.PointCloud()
    points.points = open3d.utility.Vector3dVector(cloud.points[valid].astype(np.float64))
    points.colors = open3d.utility.Vector3dVector(cloud.colors[valid].astype(np.float64) / 255)
    return points


def _missing(function: str, package: str) -> ImportError:
    """The error for an optional package that is not installed."""
    hint = f"install it, `pip install {package}`"
    error = ImportError(f"`{function}` needs the package {package}\nhint: {hint}", name=package)
    error.hint = hint  # type: ignore[attr-defined]
    return error
