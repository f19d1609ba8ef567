"""Backbones by name, through segmentation_models_pytorch and timm, and a tiny one for tests."""

import segmentation_models_pytorch as smp
import torch
from segmentation_models_pytorch.encoders._base import EncoderMixin
from torch import nn

from nunet_models.errors import ConfigError
from nunet_models.zoo.dense import DENSE

TINY = "tiny"
"""Backbone of the test models: five strided convolutions, some kilobytes."""

_TIMM_NAMES = {f"efficientnet_lite{n}": f"tu-tf_efficientnet_lite{n}" for n in range(5)}


class TinyEncoder(nn.Module, EncoderMixin):
    """Five 3x3 convolutions of stride 2, each with batch norm and ReLU.

    Gives six maps like every encoder of segmentation_models_pytorch: the input itself, then
    strides 2 to 32.
    """

    def __init__(self, in_channels: int = 3, depth: int = 5, **_: object) -> None:
        super().__init__()
        self._depth = depth
        self._in_channels = in_channels
        self._out_channels = [in_channels, 4, 6, 8, 8, 8][: depth + 1]
        self.stages = nn.ModuleList(
            nn.Sequential(
                nn.Conv2d(before, after, 3, stride=2, padding=1, bias=False),
                nn.BatchNorm2d(after),
                nn.ReLU(),
            )
            for before, after in zip(self._out_channels, self._out_channels[1:], strict=False)
        )

    def forward(self, x: torch.Tensor) -> list[torch.Tensor]:
        """`[B, C, h, w]` to maps at strides 1 (the input), 2, 4, 8, 16, 32."""
        maps = [x]
        for stage in self.stages:
            maps.append(stage(maps[-1]))
        return maps


def _register_tiny() -> None:
    smp.encoders.encoders[TINY] = {"encoder": TinyEncoder, "pretrained_settings": {}, "params": {}}


_register_tiny()


def library_name(backbone: str) -> str:
    """The name by which segmentation_models_pytorch knows `backbone`.

    Its own names come first (`resnet34`, `vgg16`, `densenet201`, `mobilenet_v2`), then timm's.
    """
    if backbone in _TIMM_NAMES:
        return _TIMM_NAMES[backbone]
    if backbone in smp.encoders.encoders or backbone.startswith("tu-"):
        return backbone
    import timm  # noqa: PLC0415  (its import takes seconds; most names never need the look-up)

    if timm.is_model(backbone):
        return f"tu-{backbone}"
    raise ConfigError(
        f"no backbone `{backbone}`",
        hint="names of segmentation_models_pytorch's encoders, "
        "`efficientnet_lite0`..`4`, or any timm model with feature maps",
    )


def check_drop_path(backbone: str) -> None:
    """Refuse stochastic depth where it would do nothing.

    # Errors
    `ConfigError` for a backbone that is not timm's.
    """
    if backbone in DENSE or not library_name(backbone).startswith("tu-"):
        raise ConfigError(
            f"backbone `{backbone}` has no drop path; expected one of timm's",
            hint="`efficientnet_lite0`..`4`, `tu-NAME` for another, or omit `--drop-path`",
        )


def build_unet(
    backbone: str,
    *,
    in_channels: int,
    out_channels: int,
    decoder_channels: tuple[int, ...],
    drop_path: float = 0.0,
) -> smp.Unet:
    """A U-Net with random weights and a linear head: `[B, in, h, w]` to `[B, out, h, w]`.

    `drop_path` is for timm's backbones (Huang et al., "Deep networks with stochastic depth",
    2016). segmentation_models_pytorch's own backbones ignore it, so that checkpoints that have one
    still load; `check_drop_path` refuses it for new ones.

    # Errors
    `ConfigError` for an unknown backbone, one that the library cannot build a U-Net of, or one of
    timm's without stochastic depth.
    """
    name = library_name(backbone)
    try:
        return smp.Unet(
            name,
            encoder_weights=None,
            drop_path_rate=drop_path or None,
            in_channels=in_channels,
            classes=out_channels,
            decoder_channels=decoder_channels,
        )
    except (ValueError, RuntimeError) as error:
        raise ConfigError(
            f"cannot build a U-Net from backbone `{backbone}`: {error}",
            hint="choose one with "
            "feature maps at strides 2 to 32, such as `efficientnet_lite0` or `resnet34`",
        ) from error
    except TypeError as error:
        if not drop_path:
            raise
        raise ConfigError(
            f"backbone `{backbone}` has no drop path: {error}", hint="omit `--drop-path`"
        ) from error
