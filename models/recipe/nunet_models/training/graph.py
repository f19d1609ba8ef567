"""The graph to train: the options that say which, and where its initial weights come from."""

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import get_args

from nunet_models.data.cache import Cached
from nunet_models.errors import ConfigError, OptionError, with_hint
from nunet_models.training.autoencoder import (
    add_decoder_options,
    check_autoencoder_options,
    plug_decoder,
)
from nunet_models.training.same_run import difference, graph_options
from nunet_models.training.trainer import Trainer
from nunet_models.zoo import Component, GraphSpec, SerialGraph, architecture_names, graph_spec
from nunet_models.zoo.backbones import check_drop_path
from nunet_models.zoo.checkpoint import Checkpoint, LoadCheckpoint
from nunet_models.zoo.confidence import CONFIDENCE
from nunet_models.zoo.dense import DENSE
from nunet_models.zoo.spec import DECODERS, Camera, Task, decoder_channels, decoder_name
from nunet_models.zoo.weights import begin_with, imagenet_encoder, like_component


def add_graph_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that `build_graph` reads, all unset (None) unless they are given."""
    group = parser.add_argument_group("graph")
    group.add_argument("--architecture", help=f"{architecture_names()} (default wnet_c)")
    group.add_argument("--backbone", help="one, or a list by comma (default efficientnet_lite0)")
    group.add_argument(
        "--decoder",
        help=f"{', '.join(sorted(DECODERS))}, or the filters of its five stages by comma, the "
        "deepest first (default lite)",
    )
    group.add_argument(
        "--tasks",
        metavar="TASK,TASK...",
        help=f"one per component, of {', '.join(get_args(Task))}, instead of the architecture's "
        "own; a component whose task changes is called by task and place, such as `normals2`",
    )
    group.add_argument(
        "--sigmoid-joint",
        action="append",
        default=[],
        metavar="COMPONENT",
        help="keep the final sigmoid on what the next component reads, as the paper's code does",
    )
    group.add_argument(
        "--inner-size", type=int, nargs=2, metavar=("H", "W"), help="default 240 320"
    )
    group.add_argument("--encoding", choices=("metric", "minmax"), help="default metric")
    group.add_argument(
        "--intrinsics",
        metavar="fx,fy,cx,cy@WxH",
        help="camera of the training images, for nunetd's focal scaling (default: that of "
        "`--start`, else NYU Depth V2's)",
    )
    group.add_argument("--dropout", type=float, default=0.0)
    group.add_argument("--drop-path", type=float, default=0.0, help="for timm's backbones alone")
    _add_start_options(group)


def _add_start_options(group: argparse._ArgumentGroup) -> None:
    """Add the options that say which weights training starts from."""
    group.add_argument(
        "--start",
        type=Path,
        help="checkpoint to take the whole graph from, with architecture, backbones and sizes",
    )
    group.add_argument(
        "--plug",
        action="append",
        default=[],
        metavar="COMPONENT=CHECKPOINT",
        help="take a trained component from the checkpoint of any graph",
    )
    group.add_argument(
        "--begin-with",
        type=Path,
        metavar="CHECKPOINT",
        help="start from the component of this name in another graph",
    )
    group.add_argument("--imagenet", action="store_true", help="start the encoder from ImageNet")
    group.add_argument(
        "--like",
        metavar="COMPONENT[=CHECKPOINT]",
        help="start as an earlier component is, of this graph or of a checkpoint",
    )
    add_decoder_options(group)


def _graph_spec(options: argparse.Namespace, before: Checkpoint | None) -> GraphSpec:
    """The graph that the options and the checkpoint to start from describe."""
    if before is not None:
        _check_of_start(options, before.spec)
    spec = before.spec if before is not None else _spec(options)
    if options.intrinsics:
        spec = replace(spec, camera=Camera.from_intrinsics(options.intrinsics))
    if options.component == CONFIDENCE:
        return replace(spec, confidence=True)
    if options.component not in [c.name for c in spec.components]:
        raise ConfigError(f"components are {', '.join(c.name for c in spec.components)}")
    _check_frames(options, spec)
    check_autoencoder_options(options, spec)
    if options.drop_path and not (options.folder / Trainer.LAST).exists():
        # (a run to resume may be of a version that took it for any backbone)
        check_drop_path(spec.component(options.component).backbone)
    components = tuple(
        c.changed(dropout=options.dropout, drop_path=options.drop_path)
        if c.name == options.component
        else c
        for c in spec.components
    )
    return replace(spec, components=components)


def _check_frames(options: argparse.Namespace, spec: GraphSpec) -> None:
    """Refuse single images for a recurrent component, and windows for one without a state."""
    recurrent = spec.component(options.component).is_recurrent
    if recurrent and options.frames == 1:
        raise OptionError(
            f"`--component {options.component}` of `{spec.architecture}` is recurrent; single "
            "images leave the weights that read the state as they began",
            hint="`--frames 8` trains on 8 consecutive frames; `--architecture wnet_c` is the same "
            "network without a state",
        )
    if options.frames > 1 and not recurrent:
        raise OptionError(
            f"`--frames {options.frames}`: `--component {options.component}` of "
            f"`{spec.architecture}` has no state to carry from frame to frame",
            hint="`--architecture wnet_c_lstm` has one",
        )


def build_graph(
    options: argparse.Namespace, load: LoadCheckpoint = Checkpoint.load
) -> tuple[SerialGraph, Checkpoint]:
    """The graph to train, and the checkpoint whose history it continues.

    `load` reads the checkpoints that the options name.

    # Errors
    `ConfigError` for options that do not fit each other or the checkpoints that they name.
    """
    for name in ("dropout", "drop_path"):
        if not 0.0 <= (share := getattr(options, name)) < 1.0:
            raise OptionError(f"`--{name.replace('_', '-')} {share}`; expected 0 <= x < 1")
    _check_of_confidence(options)
    before = _started_from(options, load)
    graph = SerialGraph(_graph_spec(options, before))
    if before is not None:
        fresh = graph.state_dict() if graph.confidence is not None else {}  # its head may be new
        graph.load_state_dict({**fresh, **before.weights})
    before = before or Checkpoint(graph.spec, {})
    for plug in options.plug:
        name, _, path = plug.partition("=")
        other = load(Path(path))
        graph.component(name).load_weights(other.component_weights(name))
        before.history[name] = other.history.get(name, [])
        before.settings[name] = other.settings.get(name, {})
        before.provenance[name] = other.provenance.get(name, {})
    if options.component == CONFIDENCE:
        return graph, before
    component = graph.component(options.component)
    if options.begin_with:
        _begin_with(component, options, load)
    if options.imagenet:
        imagenet_encoder(component)
    if options.like:
        like_component(component, _earlier(graph, options, load))
    is_trained = bool(before.history.get(options.component) or options.begin_with)
    decoder = load(options.plug_decoder) if options.plug_decoder else None
    plug_decoder(component, graph.spec, options, decoder=decoder, is_trained=is_trained)
    return graph, before


def _begin_with(component: Component, options: argparse.Namespace, load: LoadCheckpoint) -> None:
    """Start a component from that of `--begin-with`, which reads and decodes the same.

    # Errors
    `ConfigError` for another decoder or input, whose weights may fit by chance.
    """
    other = load(options.begin_with)
    its, mine = other.spec.component(options.component), component.spec
    if (its.reads, its.latent) != (mine.reads, mine.latent):
        raise ConfigError(
            f"`--begin-with {options.begin_with}`: `{mine.name}` of `{other.spec.architecture}` "
            "has another input or decoder",
            hint="`--plug-decoder` takes the decoder of an autoencoder alone",
        )
    begin_with(component, other.component_weights(options.component))


def _started_from(options: argparse.Namespace, load: LoadCheckpoint) -> Checkpoint | None:
    """The checkpoint of `--start`; without its confidence head if a component changes under it."""
    if options.start is None:
        return None
    before = load(options.start)
    if options.component == CONFIDENCE or not before.spec.confidence:
        return before
    print(
        with_hint(
            f"nunet_models: the confidence head of `{options.start}` is dropped, because it knows "
            "the errors of the weights as they are",
            f"afterwards, `--component {CONFIDENCE}` trains another one",
        ),
        file=sys.stderr,
    )
    return before.without_confidence()


def _check_of_confidence(options: argparse.Namespace) -> None:
    """Refuse to train the head of an untrained network, and options that it does not have."""
    if options.component != CONFIDENCE:
        return
    if not options.start:
        raise OptionError(
            f"`--component {CONFIDENCE}` needs a trained network",
            hint="`--start CHECKPOINT` names its checkpoint",
        )
    of_components = (
        *("dropout", "drop_path", "label_loss", "unfrozen", "compile"),
        *("begin_with", "imagenet", "like", "plug_decoder", "freeze_decoder"),
    )
    given = [name for name in of_components if getattr(options, name)]
    given += ["frames"] * (options.frames > 1)
    if given:
        raise OptionError(
            f"`--{given[0].replace('_', '-')}` does not apply to `--component {CONFIDENCE}`",
            hint="only the head is trained",
        )


def _earlier(graph: SerialGraph, options: argparse.Namespace, load: LoadCheckpoint) -> Component:
    """The component that `--like` names."""
    name, _, path = options.like.partition("=")
    if path:
        return load(Path(path)).graph().component(name)
    if name == options.component:
        raise ConfigError(
            f"`--like {name}` names the component to train itself",
            hint=f"an earlier one, or `--like {name}=CHECKPOINT` for another graph's",
        )
    return graph.component(name)


def require_shape(camera: Camera, train: Cached) -> None:
    """Check that the camera's images and the data have the same aspect ratio."""
    height, width = train.depth.shape[1:]
    if camera.width * height != camera.height * width:
        raise ConfigError(
            f"`--intrinsics` is of images of {camera.width}x{camera.height}; the training "
            f"images are {width}x{height}",
            hint="intrinsics at that size, scaled or cropped",
        )


def _check_of_start(options: argparse.Namespace, spec: GraphSpec) -> None:
    """Refuse options that describe another graph than that of `--start`, which is used whole."""
    if options.tasks or options.sigmoid_joint:
        raise ConfigError(
            "`--start` takes tasks and sigmoids from its checkpoint",
            hint="leave `--tasks` and "
            "`--sigmoid-joint` out, or `--plug` components into a graph that has them",
        )
    its = graph_options(spec)
    other = [
        difference(option, its[option], given)
        for option, given in _asked(options, spec).items()
        if given != its[option]
    ]
    if other:
        raise ConfigError(
            f"`--start {options.start}` is a graph of {'; '.join(other)}",
            hint="leave such options "
            "out with `--start`, or `--plug` components into a graph that has them",
        )


def _asked(options: argparse.Namespace, spec: GraphSpec) -> dict[str, str]:
    """The options that were given of those that make a graph, as `graph_options` has them."""
    backbone = options.backbone
    if backbone and "," not in backbone:  # of every U-Net
        each = (c.backbone if c.backbone in DENSE else backbone for c in spec.components)
        backbone = ",".join(each)
    asked = {
        "--architecture": options.architecture,
        "--backbone": backbone,
        "--decoder": options.decoder and decoder_name(decoder_channels(options.decoder)),
        "--inner-size": options.inner_size and "{} {}".format(*options.inner_size),
        "--encoding": options.encoding,
    }
    return {option: given for option, given in asked.items() if given}


def _spec(options: argparse.Namespace) -> GraphSpec:
    """The graph of a new run; options that are not given are those of the shipped model."""
    return graph_spec(
        options.architecture or "wnet_c",
        backbone=options.backbone or "efficientnet_lite0",
        decoder=decoder_channels(options.decoder or "lite"),
        inner_size=tuple(options.inner_size or (240, 320)),
        encoding=options.encoding or "metric",
        tasks=options.tasks.split(",") if options.tasks else (),
        sigmoid_joints=options.sigmoid_joint,
    )
