"""Exponential moving average of weights."""

import copy

import torch
from torch import nn


class Averaged:
    """A copy of `module` whose weights and statistics follow it slowly.

    Polyak and Juditsky 1992; the decay starts low, `(1 + step) / (10 + step)`, so that the random
    initial weights soon count little (as TensorFlow's ExponentialMovingAverage does). With a decay
    of 0 the average is `module` itself, and no second set of weights passes through memory at each
    step.
    """

    def __init__(self, module: nn.Module, decay: float) -> None:
        self.decay = decay
        if not decay:
            self.module, self._floats, self._counts = module, [], []
            return
        self.module = copy.deepcopy(module).eval().requires_grad_(False)
        pairs = list(
            zip(self.module.state_dict().values(), module.state_dict().values(), strict=True)
        )
        self._floats = [(mine, live) for mine, live in pairs if mine.is_floating_point()]
        self._counts = [(mine, live) for mine, live in pairs if not mine.is_floating_point()]

    @torch.no_grad()
    def update(self, step: int) -> None:
        """Move a little toward the live module, after its optimizer's step number `step`."""
        if not self.decay:
            return
        keep = min(self.decay, (1 + step) / (10 + step))
        torch._foreach_lerp_([m for m, _ in self._floats], [x for _, x in self._floats], 1 - keep)
        for mine, live in self._counts:
            mine.copy_(live)
