"""Convolutional LSTM and GRU at a U-Net's bottleneck, which carry a state from frame to frame.

Each is a residual: it reads a map `[B, C, h, w]` and its state (tensors `[B, units, h, w]`, whose
names are in `state`), and returns the map plus a projection of the hidden state, then the next
state. The projection starts at zero: an untrained one changes nothing.
"""

import torch
from torch import nn


class _Residual(nn.Module):
    state: tuple[str, ...]
    gate_maps: int

    def __init__(self, channels: int, units: int) -> None:
        super().__init__()
        self.units = units
        self.narrow = nn.Conv2d(channels, units, 1)
        self.gates = nn.Conv2d(2 * units, self.gate_maps * units, 3, padding=1)
        self.widen = nn.Conv2d(units, channels, 1)
        nn.init.zeros_(self.widen.weight)
        nn.init.zeros_(self.widen.bias)


class ConvLstm(_Residual):
    """Shi et al., "Convolutional LSTM network", 2015, without peepholes."""

    state = ("hidden", "cell")
    gate_maps = 4

    def forward(
        self, x: torch.Tensor, hidden: torch.Tensor, cell: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Map, hidden, cell to the changed map and the next hidden and cell."""
        gates = self.gates(torch.cat([self.narrow(x), hidden], dim=1))
        take, keep, candidate, give = gates.chunk(4, dim=1)
        cell = keep.sigmoid() * cell + take.sigmoid() * candidate.tanh()
        hidden = give.sigmoid() * cell.tanh()
        return x + self.widen(hidden), hidden, cell


class ConvGru(_Residual):
    """Ballas et al., "Delving deeper into convolutional networks for videos", 2016, section 3.1."""

    state = ("hidden",)
    gate_maps = 2

    def __init__(self, channels: int, units: int) -> None:
        super().__init__(channels, units)
        self.candidate = nn.Conv2d(2 * units, units, 3, padding=1)

    def forward(self, x: torch.Tensor, hidden: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Map and hidden to the changed map and the next hidden."""
        narrow = self.narrow(x)
        gates = self.gates(torch.cat([narrow, hidden], dim=1)).sigmoid()
        update, reset = gates.chunk(2, dim=1)
        candidate = self.candidate(torch.cat([narrow, reset * hidden], dim=1)).tanh()
        hidden = hidden + update * (candidate - hidden)
        return x + self.widen(hidden), hidden


RECURRENT: dict[str, type[ConvLstm | ConvGru]] = {"lstm": ConvLstm, "gru": ConvGru}
"""By the name that a component's spec has."""
