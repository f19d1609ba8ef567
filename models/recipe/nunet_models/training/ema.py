"""Exponential moving average of weights."""

import copy

import torch
from torch import nn


class Averaged:
    """A copy of `module` whose weights and statistics follow it slowly.

    Polyak and Juditsky 1992; the decay starts low, `(1 + step) / (10 + step)`, so that the random
    beginning is forgotten (as TensorFlow's ExponentialMovingAverage does).
    """

    def __init__(self, module: nn.Module, decay: float) -> None:
        self.module = copy.deepcopy(module).eval().requires_grad_(False)
        self.decay = decay
        pairs = list(
            zip(self.module.state_dict().values(), module.state_dict().values(), strict=True)
        )
        self._floats = [(mine, live) for mine, live in pairs if mine.is_floating_point()]
        self._counts = [(mine, live) for mine, live in pairs if not mine.is_floating_point()]

    @torch.no_grad()
    def update(self, step: int) -> None:
        """Move a little towards the live module, after its optimiser's step number `step`."""
        keep = min(self.decay, (1 + step) / (10 + step))
        torch._foreach_lerp_([m for m, _ in self._floats], [x for _, x in self._floats], 1 - keep)
        for mine, live in self._counts:
            mine.copy_(live)
