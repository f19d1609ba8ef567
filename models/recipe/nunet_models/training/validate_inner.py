"""Metrics of a component whose result stays inside of the model file, while it trains."""

from collections.abc import Iterable, Iterator

import numpy as np
import torch

from nunet_models.data.augment import NO_AUGMENTATION
from nunet_models.data.batches import Batch, epoch_batches
from nunet_models.data.cache import Cached
from nunet_models.data.sets.draw import WHOLE, Shapes, sample
from nunet_models.data.sets.mixture import Mixture
from nunet_models.errors import ConfigError
from nunet_models.tasks.inner import INNER_TASKS
from nunet_models.training.validate import run_components
from nunet_models.zoo import GraphSpec, SerialGraph
from nunet_models.zoo.deploy import normalize


def validate_inner(
    graph: SerialGraph, batches: Iterable[Batch], *, component: int, bf16: bool
) -> dict[str, float]:
    """Metrics of component `component`, of one of `INNER_TASKS`, at the inner size.

    They are pooled over the pixels of all images, as those of labels are, also of the images of a
    dataset list. `evaluate` measures depth there, and averages it over scenes; it does not see
    what stays inside of the model file, so that no number of it can be compared with these.

    # Errors
    `ConfigError` if no pixel has truth.
    """
    task = graph.spec.components[component].task
    metrics = INNER_TASKS[task].metrics(graph.spec)
    for batch in batches:
        image = normalize(batch.rgb).contiguous(memory_format=torch.channels_last)
        with torch.no_grad(), torch.autocast("cpu", torch.bfloat16, enabled=bf16):
            raw, _ = run_components(graph, image, component)
        metrics.add(raw.float(), batch)
    values = metrics.values()
    if not values:
        raise ConfigError(f"no pixel of the validation images has truth for the task `{task}`")
    return values


def whole_images(data: Cached, spec: GraphSpec, *, batch: int, workers: int) -> Iterator[Batch]:
    """The images of a folder in order, at the inner size."""
    return epoch_batches(
        data,
        NO_AUGMENTATION,
        size=spec.inner_size,
        batch=batch,
        seed=0,
        epoch=0,
        shuffle=False,
        workers=workers,
    )


def whole_views(val: Mixture, spec: GraphSpec) -> Iterator[Batch]:
    """The images of a dataset list in order, one at a time, depth for the training camera."""
    how = Shapes.of_part(spec.inner_size, 1.0, spec.camera)
    for place in range(len(val)):
        whole = sample(val[place], WHOLE, how=how, random=np.random.default_rng(0))
        rgb, depth_m, labels = (torch.from_numpy(plane[None]) for plane in whole.planes())
        yield Batch(rgb, depth_m, labels)
