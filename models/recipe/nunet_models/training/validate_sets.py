"""Metrics of a graph on the validation sets of a dataset list while it trains."""

import numpy as np
import torch
import torch.nn.functional as F
from PIL import Image

from nunet_models.data.sets.mixture import Mixture
from nunet_models.errors import ConfigError
from nunet_models.evaluation.compare import Predict, Prediction
from nunet_models.evaluation.sets import set_metrics
from nunet_models.evaluation.sparsification import METRICS as SPARSIFICATION
from nunet_models.metrics import LabelMetrics
from nunet_models.training.validate import run_components
from nunet_models.zoo import SerialGraph
from nunet_models.zoo.deploy import FromInner, ToInner, confidence_bytes

METRICS = ("abs_rel", "delta1", "abs_rel_median", "rmse")


def validate_sets(
    graph: SerialGraph, val: Mixture, *, component: int, bf16: bool
) -> dict[str, float]:
    """`abs_rel`, `delta1`, ... as the mean over sets, and `SET.abs_rel`, ... of each set.

    For a component that segments: `miou` and `accuracy` over all images with labels.

    # Errors
    `ConfigError` if no pixel has both truth and a prediction, and for stretched depth.
    """
    spec = graph.spec
    names = METRICS
    if graph.confidence is not None and component == len(graph.components) - 1:
        names += (*SPARSIFICATION, *(f"{name}_median" for name in SPARSIFICATION))
    if spec.components[component].task == "segmentation":
        return _label_figures(graph, val, component, bf16)
    if spec.encoding != "metric":
        raise ConfigError("a dataset list needs a graph with metric depth (`--encoding metric`)")
    predict = prediction_of(graph, component=component, bf16=bf16)
    by_set = {
        images.entry.name: set_metrics(images, predict, training=spec.camera) for images in val.sets
    }
    measured = {name: found for name, found in by_set.items() if "abs_rel" in found}
    if not measured:
        raise ConfigError("no pixel of the validation sets has both truth and a prediction")
    metrics = {k: float(np.mean([f[k] for f in measured.values()])) for k in names}
    for name, found in measured.items():
        metrics |= {f"{name}.{k}": found[k] for k in names}
    return metrics


def prediction_of(graph: SerialGraph, *, component: int, bf16: bool) -> Predict:
    """Runs the graph as a model file would: an image of any size to depth at that size."""
    spec = graph.spec
    to_inner, from_inner = ToInner(spec), FromInner(spec)

    def predict(rgb: np.ndarray) -> Prediction:
        shape = spec.input_size[::-1]
        given = np.array(Image.fromarray(rgb).resize(shape, Image.Resampling.BILINEAR))
        with torch.no_grad(), torch.autocast("cpu", torch.bfloat16, enabled=bf16):
            raw, log_error = _raw(graph, to_inner(torch.from_numpy(given)[None]), component)
        depth = from_inner.depth(raw.float())
        depth = F.interpolate(depth, size=rgb.shape[:2], mode="bilinear")[0, 0].numpy()
        sure = None if log_error is None else confidence_bytes(log_error, rgb.shape[:2])[0].numpy()
        return Prediction(depth, None, sure)

    return predict


def _raw(
    graph: SerialGraph, image: torch.Tensor, component: int
) -> tuple[torch.Tensor, torch.Tensor | None]:
    return run_components(graph, image.contiguous(memory_format=torch.channels_last), component)


def _label_figures(
    graph: SerialGraph, val: Mixture, component: int, bf16: bool
) -> dict[str, float]:
    spec = graph.spec
    to_inner = ToInner(spec)
    metrics = LabelMetrics(len(spec.classes))
    for place in range(len(val)):
        pair = val[place].pair
        if pair.labels is None:
            continue
        shape = spec.input_size[::-1]
        given = np.array(Image.fromarray(pair.rgb).resize(shape, Image.Resampling.BILINEAR))
        with torch.no_grad(), torch.autocast("cpu", torch.bfloat16, enabled=bf16):
            logits, _ = _raw(graph, to_inner(torch.from_numpy(given)[None]), component)
        found = logits.argmax(1, keepdim=True).to(torch.uint8)
        labels = F.interpolate(found, size=pair.labels.shape, mode="nearest")[0, 0].numpy()
        metrics.add(labels, pair.labels)
    values = metrics.values()
    if not values:
        raise ConfigError("no image of the validation sets has labels")
    return values
