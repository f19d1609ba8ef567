"""Robustness: borders, noise, roughness, a rolled camera."""

from collections.abc import Callable

import numpy as np
from scipy.ndimage import median_filter, minimum_filter

from nunet_models.data.sets.folder import CameraImage
from nunet_models.data.sets.view import View, seen

BORDER_PX = 2
INSIDE_PX = 10
"""A border is compared with the pixels just inside of it, which show nearly the same scene."""
NOISE_LEVELS = 1


def noise_change(rgb: np.ndarray, seed: int) -> np.ndarray:
    """`rgb` with -1, 0 or 1 gray level added to each value."""
    noise = np.random.default_rng(seed).integers(-NOISE_LEVELS, NOISE_LEVELS + 1, rgb.shape)
    return (rgb.astype(np.int16) + noise).clip(0, 255).astype(np.uint8)


def mean_change(first: np.ndarray, second: np.ndarray) -> float:
    """Mean absolute difference of two depth maps `[H, W]` where both have depth, else NaN."""
    change = np.abs(first - second)
    known = np.isfinite(change)
    return float(change[known].mean()) if known.any() else np.nan


def roughness(depth: np.ndarray) -> float:
    """Mean absolute difference between depth `[H, W]` and its median of 5x5 pixels.

    Pixels with a pixel without depth among these 25 do not count; NaN if all have one.
    """
    known = np.isfinite(depth)
    smooth = median_filter(np.where(known, depth, 0.0), 5)
    return mean_change(depth, np.where(minimum_filter(known, 5), smooth, np.nan))


def border_errors(depth: np.ndarray, truth: np.ndarray) -> dict[str, float]:
    """Mean relative error of the outermost pixels of each side, and of those just inside.

    NaN where a side has no truth.
    """
    relative = np.abs(depth - truth) / truth
    sides = {
        "left": relative.T,
        "right": relative.T[::-1],
        "top": relative,
        "bottom": relative[::-1],
    }
    found = {}
    for side, rows in sides.items():
        border, inside = rows[:BORDER_PX], rows[INSIDE_PX : 2 * INSIDE_PX]
        known = np.isfinite(border).any() and np.isfinite(inside).any()
        found[f"border_{side}"] = float(np.nanmean(border)) if known else np.nan
        found[f"inside_{side}"] = float(np.nanmean(inside)) if known else np.nan
    return found


def rolled_errors(
    image: CameraImage, predict: Callable[[np.ndarray], np.ndarray], degrees: float, cap_m: float
) -> dict[str, float]:
    """Metrics for the image that a camera rolled by `degrees` would take, gray beyond its edge."""
    height, width = image.pair.depth_m.shape
    turned = seen(image, View((0, 0, width, height), roll=degrees), size=(height, width))
    truth = np.where(turned.depth_m < cap_m, turned.depth_m, np.float32(np.nan))
    depth = predict(turned.rgb)
    both = np.isfinite(depth) & np.isfinite(truth)
    if not both.any():
        return {}
    p, t = depth[both], truth[both]
    p = p * (np.median(t) / np.median(p))
    return {"abs_rel_median": float((np.abs(p - t) / t).mean())}
