"""Which depth of a sensor can be trusted: range, edges, sparse measurements."""

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

EDGE_RATIO = 1.08
"""Depth that differs by this factor between neighbors is an edge between two surfaces; a floor seen
at a flat angle changes by less per pixel."""


def in_range(depth_m: np.ndarray, nearest: float, farthest: float) -> np.ndarray:
    """Depth `[H, W]` in meters, NaN outside `nearest..farthest`."""
    with np.errstate(invalid="ignore"):
        return np.where((depth_m >= nearest) & (depth_m <= farthest), depth_m, np.float32(np.nan))


def without_edges(depth_m: np.ndarray, pixels: int) -> np.ndarray:
    """Depth `[H, W]`, NaN within `pixels` of a depth edge: color and depth are misaligned there."""
    known = np.isfinite(depth_m)
    far = maximum_filter(np.where(known, depth_m, -np.inf), 3)
    near = minimum_filter(np.where(known, depth_m, np.inf), 3)
    edge = known & (far > EDGE_RATIO * near)
    if pixels > 1:
        edge = maximum_filter(edge, 2 * pixels - 1)
    return np.where(edge, np.float32(np.nan), depth_m)


def spread_sparse(depth_m: np.ndarray) -> np.ndarray:
    """Depth `[H, W]` in which each measurement also counts for its 8 neighbors without one.

    Where two measurements meet the nearer one counts: it hides the other.
    """
    known = np.isfinite(depth_m)
    near = minimum_filter(np.where(known, depth_m, np.inf), 3).astype(np.float32)
    near[~np.isfinite(near)] = np.nan
    return np.where(known, depth_m, near)
