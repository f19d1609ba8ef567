"""Augmentation of an image together with its depth and labels."""

from dataclasses import dataclass, replace

import numpy as np
from PIL import Image

from nunet_models.classes import IGNORE

_LEAST = (-0.3, -0.25, -0.3, -0.5)
_MOST = (0.3, 0.25, 0.3, 0.4)
"""Natural logarithms of the least and the greatest gamma, gain, contrast and saturation."""

GRAY = 127  # what fills an image beyond its edge: zero after normalization


@dataclass(frozen=True)
class Augmentation:
    """How much an image is changed; 0 for every value (and `scale` 1, 1) changes nothing.

    `scale` is the range of the zoom, drawn uniformly in its logarithm with probability
    `scale_chance`, else 1. `rotation_deg` is the largest turn. `color` scales all color
    changes; `noise` is the largest standard deviation in gray levels; `blur`, `cutout` and `gray`
    are probabilities.
    """

    scale: tuple[float, float] = (1.0, 1.0)
    scale_chance: float = 1.0
    rotation_deg: float = 0.0
    flip: float = 0.0
    color: float = 0.0
    noise: float = 0.0
    blur: float = 0.0
    gray: float = 0.0
    cutout: float = 0.0


NO_AUGMENTATION = Augmentation()
STRONG = Augmentation(
    scale=(0.85, 1.6),
    scale_chance=0.75,
    rotation_deg=5.0,
    flip=0.5,
    color=1.0,
    noise=8.0,
    blur=0.25,
    gray=0.05,
    cutout=0.5,
)


BALANCED = replace(STRONG, scale=(0.8, 1.3), scale_chance=0.6)
"""Zooms in and out equally, so that far things are as frequent as in the images."""


@dataclass(frozen=True)
class Sample:
    """An image ready to train on: uint8 `[h, w, 3]`, float32 meters `[h, w]`, uint8 `[h, w]`."""

    rgb: np.ndarray
    depth_m: np.ndarray
    labels: np.ndarray

    def planes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What a batch stacks: uint8 `[3, h, w]`, float32 meters `[1, h, w]`, int64 `[h, w]`."""
        return self.rgb.transpose(2, 0, 1), self.depth_m[None], self.labels.astype(np.int64)


def augmented(
    sample: Sample,
    how: Augmentation,
    *,
    size: tuple[int, int],
    random: np.random.Generator,
) -> Sample:
    """Zoom, turn, mirror and recolor `sample`, and give it the inner `size` (h, w).

    Without augmentation this is the area downsampling that the model file does.
    """
    zoom = 1.0
    if random.random() < how.scale_chance:
        zoom = float(np.exp(random.uniform(*np.log(how.scale))))
    sample = zoomed(sample, zoom, size=size, corner=random.random(2))
    if how.rotation_deg:
        sample = _turned(sample, random.uniform(-how.rotation_deg, how.rotation_deg))
    if random.random() < how.flip:
        sample = Sample(
            sample.rgb[:, ::-1].copy(),
            sample.depth_m[:, ::-1].copy(),
            sample.labels[:, ::-1].copy(),
        )
    return Sample(recolored(sample.rgb, how, random), sample.depth_m, sample.labels)


def zoomed(sample: Sample, zoom: float, *, size: tuple[int, int], corner: np.ndarray) -> Sample:
    """Enlarge `sample` by `zoom` about a window whose place `corner` (two numbers 0..1) gives.

    A zoom multiplies the focal length in pixels. The network's depth is for the training camera's
    focal length, in whose image such an object would be `zoom` times nearer, so depth is divided by
    `zoom`. A zoom below 1 leaves a gray margin without truth. A window that fits into the part that
    has truth is placed there: otherwise no depth would be learned at an image's edge.
    """
    cut = _window(sample, zoom, corner)
    rgb = Image.fromarray(_cut(sample.rgb, cut, GRAY))
    shape = size[::-1]
    # At whole factors PIL's BOX equals the area downsampling of the model file.
    rgb = rgb.resize(shape, Image.Resampling.BOX if zoom <= 1.0 else Image.Resampling.BILINEAR)
    depth = Image.fromarray(_cut(sample.depth_m, cut, np.nan))
    labels = Image.fromarray(_cut(sample.labels, cut, IGNORE))
    nearest = Image.Resampling.NEAREST
    return Sample(
        np.array(rgb),
        np.array(depth.resize(shape, nearest)) / np.float32(zoom),
        np.array(labels.resize(shape, nearest)),
    )


def _window(sample: Sample, zoom: float, corner: np.ndarray) -> tuple[int, int, int, int]:
    """Top, left, height and width of the part of `sample` that a zoom shows."""
    known = np.isfinite(sample.depth_m) | (sample.labels != IGNORE)
    starts, sizes = [], []
    for axis, extent in enumerate(known.shape):
        size = round(extent / zoom)
        truth = np.flatnonzero(known.any(axis=1 - axis))
        first, end = (truth[0], truth[-1] + 1) if len(truth) else (0, extent)
        if size > end - first:
            first, end = 0, extent
        starts.append(round(first + (end - first - size) * float(corner[axis])))
        sizes.append(size)
    return starts[0], starts[1], sizes[0], sizes[1]


def _cut(array: np.ndarray, window: tuple[int, int, int, int], fill: float) -> np.ndarray:
    top, left, height, width = window
    bottom, right = top + height, left + width
    if top >= 0 and left >= 0 and bottom <= array.shape[0] and right <= array.shape[1]:
        return np.ascontiguousarray(array[top:bottom, left:right])
    out = np.full((height, width, *array.shape[2:]), fill, dtype=array.dtype)
    rows = slice(max(top, 0), min(bottom, array.shape[0]))
    columns = slice(max(left, 0), min(right, array.shape[1]))
    out[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left] = array[
        rows, columns
    ]
    return out


def _turned(sample: Sample, degrees: float) -> Sample:
    def turn(array: np.ndarray, how: Image.Resampling, fill: float | tuple) -> np.ndarray:
        return np.array(Image.fromarray(array).rotate(degrees, how, fillcolor=fill))

    nearest = Image.Resampling.NEAREST
    return Sample(
        turn(sample.rgb, Image.Resampling.BILINEAR, (GRAY, GRAY, GRAY)),
        turn(sample.depth_m, nearest, float("nan")),
        turn(sample.labels, nearest, IGNORE),
    )


def recolored(rgb: np.ndarray, how: Augmentation, random: np.random.Generator) -> np.ndarray:
    """Blur, other colors, noise and covered rectangles: uint8 `[h, w, 3]`, same shape and type."""
    if random.random() < how.blur:
        height, width = rgb.shape[:2]
        factor = random.uniform(1.2, 2.5)
        small = Image.fromarray(rgb).resize(
            (round(width / factor), round(height / factor)), Image.Resampling.BILINEAR
        )
        rgb = np.array(small.resize((width, height), Image.Resampling.BILINEAR))
    if not (how.color or how.noise or how.gray or how.cutout):
        return rgb
    x = _color_changed(rgb, how.color, random)
    if random.random() < how.gray:
        x = np.repeat(x.mean(axis=2, keepdims=True), 3, axis=2)
    if how.noise:
        x += random.standard_normal(x.shape, np.float32) * (random.random() * how.noise / 255.0)
    if random.random() < how.cutout:
        _cut_out(x, random)
    return (x.clip(0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)


def _color_changed(rgb: np.ndarray, amount: float, random: np.random.Generator) -> np.ndarray:
    """Gamma, gain per channel (white balance), contrast and saturation: bytes to float32 0..1.

    All but the saturation is one table of 256 entries per channel, ten times quicker than powers.
    """
    gamma, gain, contrast, saturation = np.exp(random.uniform(_LEAST, _MOST) * amount)
    gains = gain * np.exp(random.uniform(-0.12, 0.12, 3) * amount)
    levels = np.linspace(0.0, 1.0, 256)[:, None] ** gamma * gains
    center = (rgb.mean() / 255.0) ** gamma * gain
    table = ((levels - center) * contrast + center).astype(np.float32)
    x = np.stack([table[:, c][rgb[..., c]] for c in range(3)], axis=2)
    luma = x.mean(axis=2, keepdims=True)
    return luma + (x - luma) * np.float32(saturation)


def _cut_out(x: np.ndarray, random: np.random.Generator) -> None:
    """Cover one to four rectangles with one color each; the network must infer what is behind."""
    height, width = x.shape[:2]
    for _ in range(random.integers(1, 5)):
        h, w = random.integers(height // 16, height // 4), random.integers(width // 16, width // 4)
        top, left = random.integers(0, height - h), random.integers(0, width - w)
        x[top : top + h, left : left + w] = random.random(3)
