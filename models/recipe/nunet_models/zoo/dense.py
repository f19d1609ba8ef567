"""The paper's CNN and RCNN: few convolutions, then dense layers that output every pixel.

Layer for layer the paper's published Keras code (convolutions without padding), scaled by
`width` only for tests. Unlike a U-Net they work at one image size only.
"""

from collections.abc import Callable
from functools import partial

import torch
from torch import nn

from nunet_models.errors import ConfigError

DROPOUT = 0.5


def _scaled(units: int, width: float) -> int:
    return max(1, round(units * width))


class Cnn(nn.Module):
    """`[B, in, h, w]` to `[B, out, h, w]` through two convolutions and six dense layers."""

    def __init__(
        self, *, in_channels: int, out_channels: int, size: tuple[int, int], width: float = 1.0
    ) -> None:
        super().__init__()
        self.shape = (out_channels, *size)
        first, second = _scaled(30, width), _scaled(15, width)
        self.features = nn.Sequential(
            nn.Conv2d(in_channels, first, 5),
            nn.ReLU(),
            nn.MaxPool2d(2),
            nn.Conv2d(first, second, 3),
            nn.ReLU(),
            nn.MaxPool2d(2),
            nn.Dropout(DROPOUT),
            nn.Flatten(),
        )
        units = _features_of(self.features, in_channels, size)[1]
        layers: list[nn.Module] = []
        for wanted in (128, 128, 128, 64, 64):
            layers += [nn.Linear(units, _scaled(wanted, width)), nn.ReLU(), nn.Dropout(DROPOUT)]
            units = _scaled(wanted, width)
        self.hidden = nn.Sequential(*layers)
        self.head = nn.Linear(units, out_channels * size[0] * size[1])

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Features, hidden layers, one number per pixel."""
        return self.head(self.hidden(self.features(x))).unflatten(1, self.shape)


class Rcnn(nn.Module):
    """`[B, in, h, w]` to `[B, out, h, w]`: rows of a feature map read in turn by LSTMs.

    One (`lstms`) as in the paper's figure 4, or two with a dense layer between them as in its code.
    """

    def __init__(
        self,
        *,
        in_channels: int,
        out_channels: int,
        size: tuple[int, int],
        width: float = 1.0,
        lstms: int = 2,
    ) -> None:
        super().__init__()
        self.shape = (out_channels, *size)
        first, second = _scaled(30, width), _scaled(15, width)
        self.features = nn.Sequential(
            nn.Conv2d(in_channels, first, 10),
            nn.ReLU(),
            nn.MaxPool2d(4),
            nn.Dropout(DROPOUT),
            nn.Conv2d(first, second, 6),
            nn.ReLU(),
            nn.MaxPool2d(4),
            nn.Dropout(DROPOUT),
        )
        channels, _, columns = _features_of(self.features, in_channels, size)[1:]
        units, narrow = _scaled(512, width), _scaled(128, width)
        self.rows = RowLstm(channels * columns, units)
        self.lstms = lstms
        if lstms == 2:
            self.between = nn.Linear(units, units)
            self.summary = RowLstm(units, units)
        self.narrow = nn.Linear(units, narrow)
        self.head = nn.Linear(narrow, out_channels * size[0] * size[1])

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Rows of the map as a sequence, the last LSTM's last answer, one number per pixel."""
        rows = self.features(x).permute(0, 2, 3, 1).flatten(2)  # [B, rows, columns * channels]
        sequence = self.rows(rows)
        if self.lstms == 2:
            sequence = self.summary(self.between(sequence).relu())
        return self.head(self.narrow(sequence[:, -1]).relu()).unflatten(1, self.shape)


class RowLstm(nn.Module):
    """An LSTM over `[B, T, in]` to `[B, T, units]` with one bias, as Keras has it.

    torch's own LSTM has two biases, so its parameter count could not match the paper's.
    """

    def __init__(self, in_features: int, units: int) -> None:
        super().__init__()
        self.units = units
        self.from_input = nn.Linear(in_features, 4 * units)
        self.from_hidden = nn.Linear(units, 4 * units, bias=False)

    def forward(self, sequence: torch.Tensor) -> torch.Tensor:
        """Gates in the order input, forget, candidate, output (Hochreiter, Schmidhuber 1997)."""
        gates_from_input = self.from_input(sequence)
        hidden = sequence.new_zeros(len(sequence), self.units)
        cell = hidden
        steps = []
        for step in range(sequence.shape[1]):
            gates = gates_from_input[:, step] + self.from_hidden(hidden)
            take, keep, candidate, give = gates.chunk(4, dim=1)
            cell = keep.sigmoid() * cell + take.sigmoid() * candidate.tanh()
            hidden = give.sigmoid() * cell.tanh()
            steps.append(hidden)
        return torch.stack(steps, dim=1)


def _features_of(features: nn.Module, in_channels: int, size: tuple[int, int]) -> torch.Size:
    try:
        with torch.no_grad():
            return features.eval()(torch.zeros(1, in_channels, *size)).shape
    except RuntimeError as error:
        raise ConfigError(f"images of {size} are too small for the unpadded layers") from error


DENSE: dict[str, Callable[..., nn.Module]] = {
    "cnn": Cnn,
    "rcnn": Rcnn,
    "rcnn1": partial(Rcnn, lstms=1),
}
"""Systems that can be named instead of a backbone in a component's spec."""
