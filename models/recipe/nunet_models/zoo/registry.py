"""Architectures by name."""

from collections.abc import Callable

from nunet_models.errors import ConfigError
from nunet_models.zoo.spec import LITE_DECODER, ComponentSpec, GraphSpec


def unet(backbone: str, decoder: tuple[int, ...] = LITE_DECODER) -> tuple[ComponentSpec, ...]:
    """One U-Net from image to depth."""
    return (ComponentSpec("depth", "depth", backbone, decoder_channels=decoder),)


def wnet(backbone: str, decoder: tuple[int, ...] = LITE_DECODER) -> tuple[ComponentSpec, ...]:
    """A segmentation U-Net whose logits alone feed a depth U-Net."""
    return _w(backbone, decoder, connected=False)


def wnet_c(backbone: str, decoder: tuple[int, ...] = LITE_DECODER) -> tuple[ComponentSpec, ...]:
    """W-Net Connected: the depth U-Net sees the image beside the logits."""
    return _w(backbone, decoder, connected=True)


def _w(backbone: str, decoder: tuple[int, ...], *, connected: bool) -> tuple[ComponentSpec, ...]:
    return (
        ComponentSpec("segmentation", "segmentation", backbone, decoder_channels=decoder),
        ComponentSpec("depth", "depth", backbone, connected, decoder),
    )


ARCHITECTURES: dict[str, Callable[..., tuple[ComponentSpec, ...]]] = {
    "unet": unet,
    "wnet": wnet,
    "wnet_c": wnet_c,
}


def graph_spec(
    architecture: str,
    *,
    backbone: str = "efficientnet_lite0",
    decoder: tuple[int, ...] = LITE_DECODER,
    **fields: object,
) -> GraphSpec:
    """The spec of a named architecture; `fields` overrides those of `GraphSpec`."""
    if architecture not in ARCHITECTURES:
        raise ConfigError(
            f"no architecture `{architecture}`; hint: one of {', '.join(ARCHITECTURES)}"
        )
    return GraphSpec(architecture, ARCHITECTURES[architecture](backbone, decoder), **fields)
