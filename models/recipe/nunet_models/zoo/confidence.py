"""Confidence of depth: a small head that predicts the relative error of each pixel's depth.

It reads the first maps of the last component's decoder, which are coarse and see most of the
image. Its own result is `s`, the logarithm of the expected relative error. A model file gives it as
a byte, `255 * exp(-2.3 * exp(s))`: 255 is certain; an error of 0.1 is 203, 0.3 is 128, 1 is 26.
"""

import torch
import torch.nn.functional as F
from torch import nn

from nunet_models.errors import ConfigError

CONFIDENCE = "confidence"
"""Its name among the components of `train`, and of the output in a model file."""

DECAY = 2.3
"""Confidence is `exp(-DECAY * error)`."""

MAPS = 3
"""Maps of the decoder that are read, the deepest first. On held-back images of eight sets they rank
pixels as well as all five maps do, and the last two alone hardly better than at random."""

HIDDEN = 32
LEAST, MOST = -5.0, 1.0  # of the logarithm: a relative error of 0.7 % to 270 %


class ConfidenceHead(nn.Module):
    """Maps of a decoder to the logarithm of the expected relative error, `[B, 1, h / 4, w / 4]`."""

    def __init__(self, decoder_channels: tuple[int, ...]) -> None:
        super().__init__()
        self.reads = nn.ModuleList(nn.Conv2d(c, HIDDEN, 1) for c in decoder_channels[:MAPS])
        self.head = nn.Conv2d(HIDDEN, 1, 1)
        nn.init.zeros_(self.head.weight)
        nn.init.constant_(self.head.bias, -2.0)  # about the error of a trained network everywhere

    def forward(self, maps: list[torch.Tensor]) -> torch.Tensor:
        """One linear map of each pixel's features at all sizes, a ReLU, and a linear map."""
        first, *others = zip(self.reads, maps, strict=False)  # there may be more maps
        hidden = first[0](first[1])
        for read, found in others:
            hidden = F.interpolate(hidden, size=found.shape[2:], mode="nearest") + read(found)
        return self.head(hidden.relu()).clamp(LEAST, MOST)

    def load_weights(self, weights: dict[str, torch.Tensor]) -> None:
        """Take weights trained elsewhere.

        # Errors
        `ConfigError` when they are of a decoder with other channels.
        """
        try:
            self.load_state_dict(weights)
        except RuntimeError as error:
            raise ConfigError(f"the weights do not fit the confidence head: {error}") from error


def confidence_of(log_error: torch.Tensor) -> torch.Tensor:
    """Logarithms of expected relative errors to confidence 0..1, same shape."""
    return (-DECAY * log_error.float().exp()).exp()
