"""Architectures by name."""

import re
from collections.abc import Callable, Sequence
from typing import get_args

from nunet_models.errors import ConfigError
from nunet_models.zoo.autoencoder import LATENT
from nunet_models.zoo.spec import LITE_DECODER, ComponentSpec, GraphSpec, Task

STATE_UNITS = 64  # of W-Net Connected's convolutional LSTM or GRU


def _unet(name: str, task: Task, backbone: str, *, connected: bool = True) -> ComponentSpec:
    return ComponentSpec(name, task, backbone, connected=connected)


def _segmentation(backbone: str) -> ComponentSpec:
    return _unet("segmentation", "segmentation", backbone)


ARCHITECTURES: dict[str, Callable[[str], tuple[ComponentSpec, ...]]] = {
    # the paper's systems without a U-Net in front
    "cnn": lambda _: (ComponentSpec("depth", "depth", "cnn"),),
    "rcnn1": lambda _: (ComponentSpec("depth", "depth", "rcnn1"),),
    "rcnn": lambda _: (ComponentSpec("depth", "depth", "rcnn"),),
    "unet": lambda b: (_unet("depth", "depth", b),),
    # a segmentation U-Net, then a depth system that sees its logits alone
    "unet_cnn": lambda b: (_segmentation(b), ComponentSpec("depth", "depth", "cnn", False)),
    "unet_rcnn": lambda b: (_segmentation(b), ComponentSpec("depth", "depth", "rcnn", False)),
    "wnet": lambda b: (_segmentation(b), _unet("depth", "depth", b, connected=False)),
    # W-Net Connected: the depth U-Net sees the image and the logits
    "wnet_c": lambda b: (_segmentation(b), _unet("depth", "depth", b)),
    "wnet_c_lstm": lambda b: (
        _segmentation(b),
        ComponentSpec("depth", "depth", b, state_units=STATE_UNITS),
    ),
    "wnet_c_gru": lambda b: (
        _segmentation(b),
        ComponentSpec("depth", "depth", b, state_units=STATE_UNITS, recurrence="gru"),
    ),
    # true depth to itself, and W-Net Connected whose second decoder is that of this autoencoder
    "autoencoder": lambda b: (ComponentSpec("depth", "depth", b, latent=LATENT, reads="depth"),),
    "wnet_c_auto": lambda b: (_segmentation(b), ComponentSpec("depth", "depth", b, latent=LATENT)),
}
"""Each from the name of its backbone; `nunetN` and `nunetN_c` exist for any N as well."""

_SERIES = re.compile(r"nunet(?P<count>[1-9]\d?)(?P<connected>_c)?")


def architecture_names() -> str:
    """Names of architectures, for help and errors."""
    return "one of " + ", ".join([*ARCHITECTURES, "nunetN", "nunetN_c"])


def graph_spec(
    architecture: str,
    *,
    backbone: str = "efficientnet_lite0",
    decoder: tuple[int, ...] = LITE_DECODER,
    tasks: Sequence[str] = (),
    sigmoid_joints: Sequence[str] = (),
    **fields: object,
) -> GraphSpec:
    """The spec of a named architecture; `fields` overrides those of `GraphSpec`.

    `backbone` may name one for each component, separated by commas. `nunetN` is a segmentation
    U-Net and N - 1 depth U-Nets, each refining the one before (N = 1: one depth U-Net);
    `nunetN_c` shows the image to all of them. `tasks` gives every component its own instead; one
    whose task changes is named by task and place, such as `depth1`. `sigmoid_joints` names the
    components whose final sigmoid the next one reads, as in the paper's code.

    # Errors
    `ConfigError` for an unknown name, or another number of backbones or tasks.
    """
    backbones = backbone.split(",")
    series = _SERIES.fullmatch(architecture)
    if series:
        components = _series(int(series["count"]), series["connected"] is not None, backbones[0])
    elif architecture in ARCHITECTURES:
        components = ARCHITECTURES[architecture](backbones[0])
    else:
        raise ConfigError(f"no architecture `{architecture}`", hint=f"{architecture_names()}")
    if len(backbones) not in {1, len(components)}:
        raise ConfigError(
            f"`{backbone}` names {len(backbones)} backbones; `{architecture}` has "
            f"{len(components)} components",
            hint="name one for all, or one per component, separated by commas",
        )
    if len(backbones) > 1:
        pairs = zip(components, backbones, strict=True)
        components = tuple(c.changed(backbone=b) for c, b in pairs)
    if tasks:
        components = _with_tasks(architecture, components, tasks)
    joints = [c.name for c in components[:-1]]
    for name in sigmoid_joints:
        if name not in joints:
            raise ConfigError(
                f"`{architecture}` has no component `{name}` whose numbers another one reads",
                hint=f"{', '.join(joints) or 'it has a single component'}",
            )
    components = tuple(
        c.changed(decoder_channels=decoder, sigmoid_joint=c.name in sigmoid_joints)
        for c in components
    )
    return GraphSpec(architecture, components, **fields)


def _with_tasks(
    architecture: str, components: tuple[ComponentSpec, ...], tasks: Sequence[str]
) -> tuple[ComponentSpec, ...]:
    if len(tasks) != len(components) or not set(tasks) <= set(get_args(Task)):
        *names, last = get_args(Task)
        raise ConfigError(
            f"tasks `{','.join(tasks)}` do not fit `{architecture}` of {len(components)} "
            f"components",
            hint=f"a comma-separated list of {', '.join(names)} or {last}, one per component",
        )
    return tuple(
        c if c.task == task else c.changed(task=task, name=f"{task}{place}")
        for place, (c, task) in enumerate(zip(components, tasks, strict=True), start=1)
    )


def _series(count: int, connected: bool, backbone: str) -> tuple[ComponentSpec, ...]:
    if count == 1:
        return ARCHITECTURES["unet"](backbone)
    refining = tuple(
        _unet(f"coarse{k}", "depth", backbone, connected=connected) for k in range(1, count - 1)
    )
    last = _unet("depth", "depth", backbone, connected=connected)
    return (_segmentation(backbone), *refining, last)
