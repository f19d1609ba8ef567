"""Metrics of a graph on a validation set while it trains."""

from collections.abc import Iterator, Sequence

import numpy as np
import torch
import torch.nn.functional as F

from nunet_models.data.augment import NO_AUGMENTATION
from nunet_models.data.batches import epoch_batches
from nunet_models.data.cache import Cached
from nunet_models.data.sequences import video_of
from nunet_models.errors import ConfigError
from nunet_models.evaluation.compare import Comparison
from nunet_models.evaluation.protocol import EIGEN, FULL
from nunet_models.metrics import LabelMetrics
from nunet_models.tasks.inner import INNER_TASKS
from nunet_models.training.inputs import network_input
from nunet_models.zoo import GraphSpec, SerialGraph
from nunet_models.zoo.deploy import confidence_bytes, decode_depth
from nunet_models.zoo.spec import Task


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

    Labels uint8, or depth float32 in the graph's encoding, as the model file gives them, or what an
    inner task shows; then the confidence uint8, None for other components than the last and for a
    graph without one. A recurrent component carries its state from frame to frame of a video.
    """
    spec = graph.spec
    if spec.components[component].is_recurrent:
        batch = 1
    size = tuple(data.depth.shape[1:])
    task = spec.components[component].task
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
    stream = _Stream(graph, component, data.ids)
    for samples in batches:
        image = network_input(spec, samples, learning=False)
        with torch.no_grad(), torch.autocast("cpu", torch.bfloat16, enabled=bf16):
            raw, log_error = stream(image)
        images = _at_size(raw.float(), spec, size, task=task)
        if not certain:
            yield from ((image, None) for image in images)
        else:
            yield from zip(images, confidence_bytes(log_error, size).numpy(), strict=True)


class _Stream:
    """Component `component` over the images of `ids` in order.

    A recurrent one gets one image at a time, and its state starts with each video.
    """

    def __init__(self, graph: SerialGraph, component: int, ids: Sequence[str]) -> None:
        self.graph, self.component = graph, component
        self.recurrent = graph.spec.components[component].is_recurrent
        self.videos, self.video = iter(map(video_of, ids)), None

    def __call__(self, image: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor | None]:
        """Raw numbers, and the confidence head's (see `run_components`)."""
        if not self.recurrent:
            return run_components(self.graph, image, self.component)
        video = next(self.videos)
        if video != self.video:
            self.video, self.state = video, self.graph.components[self.component].no_state()
        outputs, self.state = self.graph.with_state(image, self.state)
        return outputs[-1], None


def run_components(
    graph: SerialGraph, image: torch.Tensor, component: int
) -> tuple[torch.Tensor, torch.Tensor | None]:
    """Raw numbers of component `component`, and the confidence head's of the last one, or None."""
    if graph.confidence is not None and component == len(graph.components) - 1:
        outputs, log_error = graph.with_confidence(image)
        return outputs[-1], log_error
    return graph.run(image, graph.components[: component + 1])[-1], None


def _at_size(
    raw: torch.Tensor, spec: GraphSpec, size: tuple[int, int], *, task: Task
) -> np.ndarray:
    """Raw inner numbers as `predictions` gives them at the images' size, `[B, H, W]`."""
    if task == "segmentation":
        found = raw.argmax(1, keepdim=True).to(torch.uint8)
        return F.interpolate(found, size=size, mode="nearest")[:, 0].numpy()
    found = INNER_TASKS[task].shown(raw) if task in INNER_TASKS else decode_depth(raw, spec)
    return F.interpolate(found, size=size, mode="bilinear")[:, 0].numpy()
