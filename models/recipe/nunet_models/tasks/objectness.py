"""Objectness: the boxes of things, derived from labels, as a detector would find them.

A box bounds a connected component of one thing's class. Labels know no instances: two chairs that
touch share a box.
"""

from collections.abc import Iterator, Sequence

import numpy as np
import torch
import torch.nn.functional as F
from scipy import ndimage

from nunet_models.classes import IGNORE
from nunet_models.data.batches import Batch
from nunet_models.metrics import LabelMetrics
from nunet_models.zoo.spec import GraphSpec

STUFF = frozenset({"ceiling", "floor", "wall", "window"})
"""Classes that surround things; all others are things."""

LEAST_SHARE = 0.002
"""Of an image's pixels: smaller components are strips at edges more often than things."""

SIGMAS = 6.0
"""Standard deviations of the heatmap along a side of a box."""

_WITH_CORNERS = np.ones((3, 3), dtype=bool)

Box = tuple[slice, slice]
"""Rows and columns."""


def boxes(labels: np.ndarray, things: Sequence[int]) -> Iterator[Box]:
    """Bounding boxes of the connected components of `things` in labels `[h, w]`."""
    least = LEAST_SHARE * labels.size
    for thing in things:
        numbered, _ = ndimage.label(labels == thing, _WITH_CORNERS)
        pixels = np.bincount(numbered.ravel())
        for number, box in enumerate(ndimage.find_objects(numbered), start=1):
            if pixels[number] >= least:
                yield box


def box_maps(labels: np.ndarray, things: Sequence[int]) -> np.ndarray:
    """Labels uint8 or int64 `[h, w]` to float32 `[2, h, w]` of 0 to 1, NaN = unknown.

    The first map is 1 inside of a box. The second one is a Gaussian about the center of each box
    (the largest value where boxes overlap), as wide and high as the box is: Zhou, Wang and
    Krähenbühl, "Objects as points", 2019, with the sides of Liu et al., "Training-time-friendly
    network for real-time object detection", 2020. Pixels without a label are known in boxes alone.
    """
    inside = np.zeros(labels.shape, np.float32)
    center = np.zeros(labels.shape, np.float32)
    for box in boxes(labels, things):
        rows, columns = (_gaussian(side) for side in box)
        inside[box] = 1.0
        center[box] = np.maximum(center[box], rows[:, None] * columns)
    maps = np.stack([inside, center])
    maps[:, (labels == IGNORE) & (inside == 0.0)] = np.nan
    return maps


def _gaussian(side: slice) -> np.ndarray:
    """A Gaussian over the pixels of a box's side, 1 in the middle, float32."""
    length = side.stop - side.start
    place = np.arange(length) - (length - 1) / 2
    return np.exp(-0.5 * np.square(place * SIGMAS / length)).astype(np.float32)


def _truth(batch: Batch, spec: GraphSpec) -> torch.Tensor:
    """Maps of a batch, `[B, 2, h, w]`, NaN = unknown."""
    things = [label for label, name in enumerate(spec.classes) if name not in STUFF]
    return torch.from_numpy(np.stack([box_maps(of, things) for of in batch.labels.numpy()]))


class Objectness:
    """The task `objectness`: logits of two channels, inside of a box and near its center."""

    needs = "labels"

    def loss(self, raw: torch.Tensor, batch: Batch, spec: GraphSpec) -> torch.Tensor:
        """Binary cross-entropy, mean over both maps and all pixels that are known."""
        truth = _truth(batch, spec)
        known = truth.isfinite()
        if not known.any():
            return raw.float().sum() * 0.0
        return F.binary_cross_entropy_with_logits(raw.float()[known], truth[known])

    def metrics(self, spec: GraphSpec) -> "ObjectnessMetrics":
        """Overlaps of nothing yet."""
        return ObjectnessMetrics(spec)

    def score(self, metrics: dict[str, float]) -> float:
        """Mean IoU of inside and outside of boxes."""
        return metrics["box_miou"]

    def shown(self, raw: torch.Tensor) -> torch.Tensor:
        """Probability of being inside of a box."""
        return raw.float()[:, :1].sigmoid()


class ObjectnessMetrics:
    """Pixels inside and outside of boxes, at a probability of 0.5, pooled over all images."""

    def __init__(self, spec: GraphSpec) -> None:
        self.spec = spec
        self.inside = LabelMetrics(2)

    def add(self, raw: torch.Tensor, batch: Batch) -> None:
        """Count a batch of logits `[B, 2, h, w]`."""
        truth = _truth(batch, self.spec)[:, 0].nan_to_num(float(IGNORE))
        self.inside.add((raw[:, 0] > 0.0).numpy(), truth.numpy().astype(np.uint8))

    def values(self) -> dict[str, float]:
        """`box_miou`: mean IoU of inside and outside; `box_iou`: of inside; `box_share`: the share
        of pixels that are inside, which is the `box_iou` of one box around each image."""  # noqa: D205, D209
        if not self.inside.pixels:
            return {}
        (_, _, _), (missed, hit, _) = self.inside.confusion
        wrong = self.inside.confusion[0, 1]
        return {
            "box_miou": self.inside.values()["miou"],
            "box_iou": float(hit / max(1, hit + missed + wrong)),
            "box_share": float((hit + missed) / self.inside.pixels),
        }
