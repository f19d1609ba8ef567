"""The inner tasks by name: each with its truth, its loss and its metrics."""

from typing import Protocol

import torch

from nunet_models.data.batches import Batch
from nunet_models.tasks.normals import Normals
from nunet_models.tasks.objectness import Objectness
from nunet_models.zoo.spec import GraphSpec, Task


class InnerMetrics(Protocol):
    """Metrics of a task, summed batch by batch."""

    def add(self, raw: torch.Tensor, batch: Batch) -> None:
        """Count a batch, given a component's raw numbers `[B, C, h, w]`."""
        ...

    def values(self) -> dict[str, float]:
        """Every metric by name; empty if no pixel had truth."""
        ...


class InnerTask(Protocol):
    """A task whose result stays inside of the model file, as features of the next component."""

    needs: str
    """The truth of a batch that it is derived from, "labels" or "depth"."""

    def loss(self, raw: torch.Tensor, batch: Batch, spec: GraphSpec) -> torch.Tensor:
        """Scalar loss of raw numbers `[B, C, h, w]`."""
        ...

    def metrics(self, spec: GraphSpec) -> InnerMetrics:
        """Metrics of nothing yet."""
        ...

    def score(self, metrics: dict[str, float]) -> float:
        """The metric that chooses the best checkpoint; more is better."""
        ...

    def shown(self, raw: torch.Tensor) -> torch.Tensor:
        """Raw numbers `[B, C, h, w]` as images of 0 to 1, float32 `[B, 1, h, w]`."""
        ...


INNER_TASKS: dict[str, InnerTask] = {"normals": Normals(), "objectness": Objectness()}
"""By the name that `train --tasks` takes."""


def truth_of(task: Task) -> str:
    """The truth that a component of this task is trained on, "labels" or "depth"."""
    if task in INNER_TASKS:
        return INNER_TASKS[task].needs
    return "labels" if task == "segmentation" else "depth"
