"""A convolutional LSTM at a U-Net's bottleneck, which carries a state from frame to frame."""

import torch
from torch import nn


class ConvLstm(nn.Module):
    """Shi et al., "Convolutional LSTM network", 2015, without peepholes, as a residual.

    Reads a map `[B, C, h, w]` and the state (hidden and cell, each `[B, units, h, w]`), and
    returns the map plus a projection of the hidden state. The projection starts at zero: an
    untrained LSTM changes nothing.
    """

    def __init__(self, channels: int, units: int) -> None:
        super().__init__()
        self.units = units
        self.narrow = nn.Conv2d(channels, units, 1)
        self.gates = nn.Conv2d(2 * units, 4 * units, 3, padding=1)
        self.widen = nn.Conv2d(units, channels, 1)
        nn.init.zeros_(self.widen.weight)
        nn.init.zeros_(self.widen.bias)

    def forward(
        self, x: torch.Tensor, hidden: torch.Tensor, cell: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Map, hidden, cell to the changed map and the next hidden and cell."""
        gates = self.gates(torch.cat([self.narrow(x), hidden], dim=1))
        take, keep, candidate, give = gates.chunk(4, dim=1)
        cell = keep.sigmoid() * cell + take.sigmoid() * candidate.tanh()
        hidden = give.sigmoid() * cell.tanh()
        return x + self.widen(hidden), hidden, cell
