"""What a run trains, and the loss of a batch: a component, or the confidence head alone."""

from functools import partial
from typing import Protocol

import numpy as np
import torch
from torch import nn

from nunet_models.classes import IGNORE
from nunet_models.data.batches import Batch
from nunet_models.data.encode import encoded_depth
from nunet_models.losses import cross_entropy, expected_error, parse_loss, weighted_depth_loss
from nunet_models.tasks.inner import INNER_TASKS, truth_of
from nunet_models.training.feed import Feed
from nunet_models.training.inputs import network_input
from nunet_models.training.settings import Settings
from nunet_models.zoo import SerialGraph
from nunet_models.zoo.confidence import CONFIDENCE
from nunet_models.zoo.deploy import normalize


class Objective(Protocol):
    """What a run trains. `needs` says which truth, "labels" or "depth"."""

    needs: str
    index: int
    """The component whose results are validated."""
    frozen: list[nn.Module]
    trained: list[nn.Module]

    def weigh_classes(self, feed: Feed) -> None:
        """Take from the data of `feed` how much each class counts, before the first batch."""
        ...

    def loss(self, batch: Batch, frozen: list, trained: list) -> torch.Tensor:
        """Loss of a batch; `frozen` and `trained` are the modules, compiled or not."""
        ...

    def score(self, metrics: dict[str, float], feed: Feed) -> float:
        """One number of a validation on `feed`; more is better."""
        ...


def objective(graph: SerialGraph, settings: Settings) -> Objective:
    """The objective that the settings name."""
    if settings.component == CONFIDENCE:
        return ConfidenceObjective(graph, settings)
    return ComponentObjective(graph, settings)


class ComponentObjective:
    """A component's raw numbers against labels or depth, the earlier components frozen or not."""

    def __init__(self, graph: SerialGraph, settings: Settings) -> None:
        self.graph, self.settings = graph, settings
        self.index = list(graph.components).index(graph.component(settings.component))
        self.segments = graph.spec.components[self.index].task == "segmentation"
        self.inner = INNER_TASKS.get(graph.spec.components[self.index].task)
        self.needs = truth_of(graph.spec.components[self.index].task)
        first = 0 if settings.unfrozen else self.index
        self.frozen: list[nn.Module] = list(graph.components[:first])
        self.trained: list[nn.Module] = list(graph.components[first : self.index + 1])
        self.loss_weights = parse_loss(settings.loss)
        self.class_weights: torch.Tensor | None = None

    def weigh_classes(self, feed: Feed) -> None:
        """Weigh the classes of a segmentation by how often they occur."""
        if self.segments or self.settings.label_loss > 0.0:
            self.class_weights = _class_weights(feed, self.graph, self.settings)

    def loss(self, batch: Batch, frozen: list, trained: list) -> torch.Tensor:
        """Cross-entropy of labels, the loss of depth that the settings name, or an inner task's."""
        image = network_input(self.graph.spec, batch, learning=True)
        with torch.autocast("cpu", torch.bfloat16, enabled=self.settings.bf16):
            with torch.no_grad():
                before = self.graph.run(image, frozen)
                if before and self.settings.joint_noise:
                    before[-1] = self._disturbed(before[-1])
            calls = [partial(self._raw, module) for module in trained]
            outputs = self.graph.run(image, calls, before=before)
        if self.segments:
            return self._label_loss(outputs[-1], batch)
        spec = self.graph.spec
        loss = self._own_loss(outputs[-1], batch)
        if self.settings.label_loss:
            for component, logits in zip(spec.components, outputs[:-1], strict=False):
                if component.task == "segmentation":
                    loss = loss + self.settings.label_loss * self._label_loss(logits, batch)
        return loss

    def _own_loss(self, raw: torch.Tensor, batch: Batch) -> torch.Tensor:
        """That of depth, or of the component's inner task."""
        spec = self.graph.spec
        if self.inner is not None:
            return self.inner.loss(raw, batch, spec)
        return weighted_depth_loss(
            raw,
            encoded_depth(batch.depth_m, spec.encoding),
            weights=self.loss_weights,
            log_network=spec.encoding == "metric",
        )

    def _raw(self, module: nn.Module, x: torch.Tensor) -> torch.Tensor:
        """Raw numbers of a component; with `frames` above 1, a recurrent one carries its state."""
        if self.settings.frames > 1 and module.spec.is_recurrent:
            return module.over_frames(x, self.settings.frames)
        return module(x)

    def _label_loss(self, logits: torch.Tensor, batch: Batch) -> torch.Tensor:
        return cross_entropy(
            logits, batch.labels, weights=self.class_weights, smoothing=self.settings.smoothing
        )

    def _disturbed(self, features: torch.Tensor) -> torch.Tensor:
        """Features scaled by 0.5..1.1 an image, and withheld from some: see `joint_noise`."""
        shape = (len(features), 1, 1, 1)
        scale = torch.empty(shape).uniform_(0.5, 1.1)
        kept = torch.rand(shape) >= self.settings.joint_noise
        return features * (scale * kept).to(features.dtype)

    def score(self, metrics: dict[str, float], feed: Feed) -> float:
        """MIoU of labels; the negative error of depth that `feed` names; an inner task's own."""
        if self.inner is not None:
            return self.inner.score(metrics)
        return metrics["miou"] if self.segments else -metrics[feed.depth_error]


class ConfidenceObjective:
    """The confidence head against the error of depth, all components frozen."""

    needs = "depth"

    def __init__(self, graph: SerialGraph, settings: Settings) -> None:
        self.graph, self.settings = graph, settings
        self.index = len(graph.components) - 1
        self.frozen: list[nn.Module] = list(graph.components)
        self.trained: list[nn.Module] = [graph.component(CONFIDENCE)]

    def weigh_classes(self, feed: Feed) -> None:
        """Nothing: there are no classes."""

    def loss(self, batch: Batch, frozen: list, trained: list) -> torch.Tensor:
        """`losses.expected_error` of the network as it is evaluated."""
        image = normalize(batch.rgb).contiguous(memory_format=torch.channels_last)
        with torch.autocast("cpu", torch.bfloat16, enabled=self.settings.bf16):
            with torch.no_grad():
                outputs, maps = self.graph.with_maps(image)
            log_error = self.graph.component(CONFIDENCE)(maps)
        return expected_error(log_error, outputs[-1], batch.depth_m)

    def score(self, metrics: dict[str, float], feed: Feed) -> float:
        """Negative area between the errors by confidence and by the oracle, after a median fit."""
        return -metrics["area_median"]


def _class_weights(feed: Feed, graph: SerialGraph, settings: Settings) -> torch.Tensor:
    """Frequency to the power `-class_power`, scaled to a mean of 1 over pixels; `[C]`."""
    counts = feed.label_counts()
    share = counts[: len(graph.spec.classes)] / max(1.0, counts[:IGNORE].sum())
    weights = np.maximum(share, 1e-3) ** -settings.class_power
    mean = (weights * share).sum() or 1.0  # 0 where no label is among those looked at
    return torch.tensor(weights / mean, dtype=torch.float32)
