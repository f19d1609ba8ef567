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
from nunet_models.zoo.deploy import decode_depth, normalize


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
    for index, image in enumerate(found):
        if segments:
            labels.add(image, data.labels[index])
        else:
            depth.add_depth(image, data.depth_m(index))
    metrics = labels if segments else depth.depth if depth.metric else depth.minmax
    values = metrics.values()
    if not values:
        raise ConfigError(
            "no pixel of the validation images has both truth and a prediction",
            hint=f"of images of {EIGEN.size}, metric depth is compared within Eigen's crop alone",
        )
    return values


def predictions(
    graph: SerialGraph, data: Cached, *, component: int, batch: int, bf16: bool, workers: int
) -> Iterator[np.ndarray]:
    """The prediction of component `component` for each image in order, `[H, W]` at its own size.

    Labels uint8, or depth float32 in the graph's encoding, as the model file gives them.
    """
    spec = graph.spec
    size = tuple(data.depth.shape[1:])
    segments = spec.components[component].task == "segmentation"
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
        outputs: list[torch.Tensor] = []
        with torch.no_grad(), torch.autocast("cpu", torch.bfloat16, enabled=bf16):
            for module in graph.components[: component + 1]:
                outputs.append(module(graph.joint(image, outputs)))
        yield from _at_size(outputs[-1].float(), spec, size, segments=segments)


def _at_size(
    raw: torch.Tensor, spec: GraphSpec, size: tuple[int, int], *, segments: bool
) -> np.ndarray:
    """Raw inner numbers as the model file gives them at the images' size, `[B, H, W]`."""
    if segments:
        found = raw.argmax(1, keepdim=True).to(torch.uint8)
        return F.interpolate(found, size=size, mode="nearest")[:, 0].numpy()
    return F.interpolate(decode_depth(raw, spec), size=size, mode="bilinear")[:, 0].numpy()
