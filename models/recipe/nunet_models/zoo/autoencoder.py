"""Depth autoencoder: a decoder that has learned what depth maps look like.

Its component (architecture `autoencoder`) reads true depth and returns it through a narrow latent
map, without skip connections, so that the decoder learns depth maps alone. The same decoder can
then replace that of a network that reads images (`wnet_c_auto`): an encoder with an adapter
predicts the latent map.
"""

import torch
import torch.nn.functional as F
from segmentation_models_pytorch.base.initialization import initialize_decoder
from segmentation_models_pytorch.decoders.unet.decoder import UnetDecoderBlock
from torch import nn

LATENT = 64
"""Channels of the latent map, at stride 32. An image of 120x160 becomes 4 x 5 x 64 numbers."""

DEPTH_PLANES = 2  # what a component that reads depth reads: see `depth_planes`
_CENTER = 1.0  # of the logarithm of indoor depth in meters: 2.7 m
_BLOCKS = (7, 9)  # rows and columns in which depth is hidden; unlike those of the latent map
_MOST_HIDDEN = 0.5  # of the blocks of an image


def depth_planes(depth_m: torch.Tensor) -> torch.Tensor:
    """Depth `[B, 1, h, w]` in meters (NaN = none) to what the autoencoder reads, `[B, 2, h, w]`.

    The logarithm of depth around zero (none is zero), and 1 where depth is known, else 0.
    """
    log_depth = depth_m.log()
    known = log_depth.isfinite()
    return torch.cat([(log_depth - _CENTER).where(known, 0.0), known.float()], dim=1)


def with_holes(depth_m: torch.Tensor) -> torch.Tensor:
    """Depth `[B, 1, h, w]` with up to half of its blocks hidden (NaN), the share drawn by image.

    The autoencoder has to fill them, so that it cannot copy and learns to work with sparse depth.
    """
    count = len(depth_m)
    share = _MOST_HIDDEN * torch.rand(count, 1, 1, 1)
    hidden = (torch.rand(count, 1, *_BLOCKS) < share).float()
    return depth_m.masked_fill(F.interpolate(hidden, size=depth_m.shape[2:]) > 0.0, torch.nan)


def adapter(channels: int, latent: int) -> nn.Sequential:
    """An encoder's deepest map to the latent map.

    Every latent channel is normalized, so that the decoder sees the same range from all encoders.
    """
    return nn.Sequential(
        nn.Conv2d(channels, latent, 1, bias=False), nn.BatchNorm2d(latent, affine=False)
    )


class SkiplessDecoder(nn.Module):
    """A U-Net's decoder without skip connections: it reads the latent map alone."""

    def __init__(self, latent: int, channels: tuple[int, ...]) -> None:
        super().__init__()
        self.center = nn.Identity()  # as in the U-Net's decoder
        before = (latent, *channels)
        self.blocks = nn.ModuleList(
            UnetDecoderBlock(one, 0, other) for one, other in zip(before, channels, strict=False)
        )
        initialize_decoder(self)

    def forward(self, maps: list[torch.Tensor]) -> torch.Tensor:
        """The latent map is the last of `maps`; of the others only the sizes are used."""
        found = maps[-1]
        for larger, block in zip(maps[-2::-1], self.blocks, strict=True):
            height, width = larger.shape[2:]
            found = block(found, height, width)
        return found
