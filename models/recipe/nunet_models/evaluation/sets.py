"""Accuracy over the sets of a dataset list: per set, focal-scaled and after a median fit.

A set's metric is the mean over its scenes of the mean over images, so that a near-static view of
many images weighs as one room. `predict` gives depth for the training camera's focal length at
the image's size; it is scaled here, as nunetd does. Where it gives a confidence as well, the
sparsification follows.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from nunet_models.data.sets.cameras import Pinhole
from nunet_models.data.sets.folder import CameraImage, CameraSet
from nunet_models.evaluation.compare import Predict
from nunet_models.evaluation.protocol import PROTOCOLS, Protocol
from nunet_models.evaluation.robustness import (
    border_errors,
    mean_change,
    noise_change,
    rolled_errors,
    roughness,
)
from nunet_models.evaluation.sparsification import of_depth
from nunet_models.metrics import DELTA
from nunet_models.zoo.spec import Camera

SIDES = ("left", "right", "top", "bottom")


@dataclass
class Means:
    """Metrics of images by scene."""

    scenes: dict[str, dict[str, list[float]]] = field(
        default_factory=lambda: defaultdict(lambda: defaultdict(list))
    )

    def add(self, scene: str, metrics: dict[str, float]) -> None:
        """Count the metrics of one image; NaN says that one was not measured."""
        for name, value in metrics.items():
            if np.isfinite(value):
                self.scenes[scene][name].append(value)

    def means(self) -> dict[str, float]:
        """Mean over scenes of the mean over images, by metric."""
        by_name: dict[str, list[float]] = defaultdict(list)
        for metrics in self.scenes.values():
            for name, values in metrics.items():
                by_name[name].append(float(np.mean(values)))
        return {name: float(np.mean(values)) for name, values in by_name.items()}


def focal_factor(camera: Pinhole, training: Camera) -> float:
    """Factor of depth for an image of `camera`, both focal lengths at one width."""
    return (camera.fx / camera.width) / (training.fx / training.width)


def errors(
    predicted: np.ndarray, truth: np.ndarray, confidence: np.ndarray | None = None
) -> dict[str, float]:
    """Metrics of one image, depths `[H, W]` in meters, NaN where nothing is known."""
    both = np.isfinite(predicted) & np.isfinite(truth) & (predicted > 0)
    if not both.any():
        return {}
    p, t = predicted[both].astype(np.float64), truth[both].astype(np.float64)
    fit = float(np.median(t) / np.median(p))
    found = {"factor": fit, "rmse": float(np.sqrt(np.square(p - t).mean()))}
    for name, scaled in (("", p), ("_median", p * fit)):
        found[f"abs_rel{name}"] = float((np.abs(scaled - t) / t).mean())
        found[f"delta1{name}"] = float((np.maximum(scaled / t, t / scaled) < DELTA).mean())
    if confidence is not None:
        found |= of_depth(p, t, confidence[both])
    return found


def set_metrics(
    images: CameraSet,
    predict: Predict,
    *,
    training: Camera,
    baseline_m: float | None = None,
    robustness: bool = False,
    progress: Callable[[Iterable[int]], Iterable[int]] = iter,
) -> dict[str, float]:
    """Metrics of one set.

    `baseline_m` is the trivial prediction, one depth for every pixel of the training camera; it is
    scaled by the focal length as well. `robustness` adds the border, noise, roughness and turns.
    """
    means = Means()
    protocol = PROTOCOLS[images.entry.protocol]
    for index in progress(range(len(images))):
        image = images[index]
        factor = focal_factor(image.camera, training)
        prediction = predict(image.pair.rgb)
        depth = prediction.depth * np.float32(factor)
        truth = protocol.truth(image.pair.depth_m)
        sure = prediction.confidence
        sure = None if sure is None else protocol.cropped(sure)
        found = errors(protocol.predicted(depth), truth, sure)
        if baseline_m is not None:
            trivial = errors(np.full(truth.shape, baseline_m * factor), truth)
            found |= {f"baseline_{k}": trivial[k] for k in ("abs_rel", "delta1") if trivial}
        means.add(image.room, found)
        if robustness:
            means.add(image.room, _robustness(image, predict, depth, factor, protocol, index))
    return {"images": len(images), "scenes": len(means.scenes), **_ratios(means.means())}


def _robustness(
    image: CameraImage,
    predict: Predict,
    depth: np.ndarray,
    factor: float,
    protocol: Protocol,
    index: int,
) -> dict[str, float]:
    noisy = predict(noise_change(image.pair.rgb, index)).depth * np.float32(factor)
    found = {
        "noise_mm": 1000.0 * mean_change(noisy, depth),
        "roughness_mm": 1000.0 * roughness(depth),
        **border_errors(depth, image.pair.depth_m),
    }

    def scaled(rgb: np.ndarray) -> np.ndarray:
        return predict(rgb).depth * factor

    for degrees in (0.0, 20.0):
        turned = rolled_errors(image, scaled, degrees, protocol.cap_m)
        found |= {f"turn{degrees:.0f}_{k}": v for k, v in turned.items()}
    return found


def _ratios(means: dict[str, float]) -> dict[str, float]:
    """Ratios of means, since those of single images scatter."""
    for side in SIDES:
        if f"border_{side}" in means and means.get(f"inside_{side}"):
            inside = means.pop(f"inside_{side}")
            means[f"border_{side}_ratio"] = means.pop(f"border_{side}") / inside
    if means.get("turn0_abs_rel_median") and "turn20_abs_rel_median" in means:
        upright = means["turn0_abs_rel_median"]
        means["turn20_ratio"] = means["turn20_abs_rel_median"] / upright
    return means
