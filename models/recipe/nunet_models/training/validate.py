"""Metrics of a graph on a validation set while it trains."""

from collections.abc import Iterator

import numpy as np
import torch
import torch.nn.functional as F

from nunet_models.data.augment import NO_AUGMENTATION
from nunet_models.data.batches import epoch_batches
from nunet_models.data.cache import Cached
from nunet_models.errors import ConfigError
from nunet_models.evaluation.compare import Comparison
from nunet_models.evaluation.protocol import EIGEN, FULL
from nunet_models.metrics import LabelMetrics
from nunet_models.zoo import GraphSpec, SerialGraph
from nunet_models.zoo.deploy import confidence_bytes, decode_depth, normalize


def validate(
    graph: SerialGraph, data: Cached, *, component: int, batch: int, bf16: bool, workers: int
) -> dict[str, float]:
    """Depth or label metrics of component `component` over `data`, at the images' own size.

    Metric depth is cropped as `EIGEN` where the size fits; labels, and stretched depth, are
    compared over the whole image.

    # Errors
    `ConfigError` if no pixel has both truth and a prediction.
    """
    spec = graph.spec
    segments = spec.components[component].task == "segmentation"
    labels = LabelMetrics(len(spec.classes))
    size = tuple(data.depth.shape[1:])
    depth = Comparison(EIGEN if size == EIGEN.size else FULL, spec.encoding == "metric")
    found = predictions(graph, data, component=component, batch=batch, bf16=bf16, workers=workers)
    for index, (image, confidence) in enumerate(found):
        if segments:
            labels.add(image, data.labels[index])
        else:
            depth.add_depth(image, data.depth_m(index), confidence)
    metrics = labels if segments else depth.depth if depth.metric else depth.minmax
    values = metrics.values()
    if depth.sparsity:
        values |= depth.sparsification()
    if not values:
        raise ConfigError(
            "no pixel of the validation images has both truth and a prediction",
            hint=f"of images of {EIGEN.size}, metric depth is compared within Eigen's crop alone",
        )
    return values


def predictions(
    graph: SerialGraph, data: Cached, *, component: int, batch: int, bf16: bool, workers: int
) -> Iterator[tuple[np.ndarray, np.ndarray | None]]:
    """The prediction of component `component` for each image in order, `[H, W]` at its own size.

    Labels uint8, or depth float32 in the graph's encoding, as the model file gives them; then the
    confidence uint8, None for other components than the last and for a graph without one.
    """
    spec = graph.spec
    size = tuple(data.depth.shape[1:])
    segments = spec.components[component].task == "segmentation"
    certain = graph.confidence is not None and component == len(graph.components) - 1
    batches = epoch_batches(
        data,
        NO_AUGMENTATION,
        size=spec.inner_size,
        batch=batch,
        seed=0,
        epoch=0,
        shuffle=False,
        workers=workers,
    )
    for samples in batches:
        image = normalize(samples.rgb).contiguous(memory_format=torch.channels_last)
        with torch.no_grad(), torch.autocast("cpu", torch.bfloat16, enabled=bf16):
            raw, log_error = run_components(graph, image, component)
        images = _at_size(raw.float(), spec, size, segments=segments)
        if not certain:
            yield from ((image, None) for image in images)
        else:
            yield from zip(images, confidence_bytes(log_error, size).numpy(), strict=True)


def run_components(
    graph: SerialGraph, image: torch.Tensor, component: int
) -> tuple[torch.Tensor, torch.Tensor | None]:
    """Raw numbers of component `component`, and the confidence head's of the last one, or None."""
    if graph.confidence is not None and component == len(graph.components) - 1:
        outputs, log_error = graph.with_confidence(image)
        return outputs[-1], log_error
    outputs: list[torch.Tensor] = []
    for module in graph.components[: component + 1]:
        outputs.append(module(graph.joint(image, outputs)))
    return outputs[-1], None


def _at_size(
    raw: torch.Tensor, spec: GraphSpec, size: tuple[int, int], *, segments: bool
) -> np.ndarray:
    """Raw inner numbers as the model file gives them at the images' size, `[B, H, W]`."""
    if segments:
        found = raw.argmax(1, keepdim=True).to(torch.uint8)
        return F.interpolate(found, size=size, mode="nearest")[:, 0].numpy()
    return F.interpolate(decode_depth(raw, spec), size=size, mode="bilinear")[:, 0].numpy()
