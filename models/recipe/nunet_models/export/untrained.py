"""Networks with seeded random weights whose outputs still vary over an image.

Tests and benchmarks need them: constant depth could not detect a mirrored image.
"""

import math
from functools import partial

import torch
from torch import nn

from nunet_models.export.measure import image_of
from nunet_models.zoo import Component, GraphSpec, SerialGraph
from nunet_models.zoo.component import RecurrentComponent
from nunet_models.zoo.deploy import ToInner

MEAN_DEPTH_M = 2.7  # about the mean of indoor images
SPREAD = 0.35  # standard deviation of log depth, as indoor images have it
MEAN_ERROR, ERROR_SPREAD = 0.15, 0.5  # of depth, relative; the spread is that of its logarithm
STATE_SPREAD = 2.0  # of the weights that add the state: depth changes by centimeters


def untrained_graph(spec: GraphSpec, *, seed: int) -> SerialGraph:
    """A graph with weights drawn from `seed`, normalized on the self-test image.

    Batch-norm statistics are those of the image, so that no activation vanishes; heads
    are shifted and scaled so that every class occurs and depth covers the range of a room.
    """
    torch.manual_seed(seed)
    graph = SerialGraph(spec)
    image = ToInner(spec)(torch.from_numpy(image_of(spec)))
    with torch.no_grad():
        graph.run(image, [partial(_settled, component, spec) for component in graph.components])
        if graph.confidence is not None:
            _settle_confidence(graph, image)
    return graph


def _settled(component: Component, spec: GraphSpec, x: torch.Tensor) -> torch.Tensor:
    """Raw numbers of a component for `x`, on which its numbers are normalized first."""
    _randomize_state(component)
    _settle_batch_norm(component, x)
    _settle_head(component.head, component(x), spec)
    return component(x)


def _randomize_state(component: Component) -> None:
    """Make the state visible in the output.

    Training starts with a state that adds zero. No test could then tell a state that is carried
    from one that is lost.
    """
    if isinstance(component, RecurrentComponent):
        nn.init.normal_(component.memory.widen.weight, std=STATE_SPREAD)


def _settle_batch_norm(module: nn.Module, x: torch.Tensor) -> None:
    norms = [m for m in module.modules() if isinstance(m, nn.BatchNorm2d)]
    momenta = [norm.momentum for norm in norms]
    for norm in norms:
        norm.momentum = 1.0  # take the image's statistics as they are
    module.train()
    module(torch.cat([x, x.flip(3)]))  # two images: batch norm refuses one value per channel
    module.eval()
    for norm, momentum in zip(norms, momenta, strict=True):
        norm.momentum = momentum
        norm.running_var += norm.running_var.mean()  # small variances magnify rounding


def _settle_confidence(graph: SerialGraph, image: torch.Tensor) -> None:
    """Let the expected error vary over the image as that of a trained network does."""
    head = graph.confidence.head
    nn.init.normal_(head.weight, std=0.01)  # within the head's limits
    _, log_error = graph.with_confidence(image)
    scale = ERROR_SPREAD / log_error.std()
    head.weight *= scale
    head.bias.copy_((head.bias - log_error.mean()) * scale + math.log(MEAN_ERROR))


def _settle_head(head: nn.Conv2d | nn.Linear, raw: torch.Tensor, spec: GraphSpec) -> None:
    mean, spread = raw.mean(dim=(0, 2, 3)), raw.std(dim=(0, 2, 3))
    if raw.shape[1] == 1 and spec.encoding == "metric":
        wanted_mean, wanted_spread = math.log(MEAN_DEPTH_M), SPREAD
    elif raw.shape[1] == 1:
        wanted_mean, wanted_spread = 0.5, 0.15
    else:
        wanted_mean, wanted_spread = 0.0, 1.0
    scale = wanted_spread / spread
    head.weight *= scale.reshape(-1, *[1] * (head.weight.dim() - 1))
    head.bias.copy_((head.bias - mean) * scale + wanted_mean)
