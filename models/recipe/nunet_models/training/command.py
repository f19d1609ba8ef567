"""The verb `train`."""

import argparse
from dataclasses import fields, replace
from pathlib import Path

import torch

from nunet_models.data.cache import Cached
from nunet_models.data.options import add_cache_option, add_data_options, open_cached
from nunet_models.data.pairs import read_ids
from nunet_models.errors import ConfigError
from nunet_models.training.checkpoint import Checkpoint
from nunet_models.training.provenance import run_provenance
from nunet_models.training.schedule import SCHEDULES
from nunet_models.training.settings import AUGMENTATIONS, Settings
from nunet_models.training.trainer import OPTIMISERS, Trainer
from nunet_models.zoo import (
    Component,
    GraphSpec,
    SerialGraph,
    architecture_names,
    graph_spec,
)
from nunet_models.zoo.backbones import check_drop_path
from nunet_models.zoo.spec import DECODERS, Camera
from nunet_models.zoo.weights import begin_with, imagenet_encoder, like_component

SHARED_SHOWN = 3  # of the ids that two lists share
CHOICES = {
    "augmentation": sorted(AUGMENTATIONS),
    "optimiser": sorted(OPTIMISERS),
    "schedule": SCHEDULES,
}


def add_parser(verbs: argparse._SubParsersAction) -> None:
    """Register `train` and its options."""
    parser = verbs.add_parser("train", help="train one component of a serial graph")
    parser.add_argument("--run", type=Path, required=True, dest="folder", help="the run's folder")
    parser.add_argument(
        "--resume",
        action="store_true",
        help="go on with the run in the folder, with the options it was started with; other "
        "`--epochs`, `--threads`, `--workers` and `--validate-every` are taken as given now",
    )
    parser.add_argument("--minutes", type=float, help="stop after so long, to be resumed")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    add_data_options(parser)
    add_cache_option(parser)
    parser.add_argument("--train-ids", type=Path, required=True)
    parser.add_argument("--val-ids", type=Path, required=True)
    parser.add_argument(
        "--show",
        type=Path,
        metavar="PICTURE",
        help="the picture whose prediction each validation keeps (default: the first one of them)",
    )
    _add_graph_options(parser)
    _add_settings(parser)
    parser.set_defaults(carry_out=run)


def _add_graph_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("graph")
    group.add_argument("--architecture", default="wnet_c", help=architecture_names())
    group.add_argument("--backbone", default="efficientnet_lite0", help="one, or a list by comma")
    group.add_argument("--decoder", choices=sorted(DECODERS), default="lite")
    group.add_argument(
        "--tasks",
        metavar="TASK,TASK...",
        help="one a component, `segmentation` or `depth`, instead of the architecture's own; a "
        "component whose task changes is called by task and place, such as `depth1`",
    )
    group.add_argument(
        "--sigmoid-joint",
        action="append",
        default=[],
        metavar="COMPONENT",
        help="keep the final sigmoid on what the next component reads, as the paper's code does",
    )
    group.add_argument("--inner-size", type=int, nargs=2, default=(240, 320), metavar=("H", "W"))
    group.add_argument("--encoding", choices=("metric", "minmax"), default="metric")
    group.add_argument(
        "--intrinsics",
        metavar="fx,fy,cx,cy@WxH",
        help="camera of the training pictures, for nunetd's focal scaling (default: that of "
        "`--start`, else NYU Depth V2's)",
    )
    group.add_argument("--dropout", type=float, default=0.0)
    group.add_argument("--drop-path", type=float, default=0.0, help="for timm's backbones alone")
    group.add_argument("--start", type=Path, help="checkpoint to take the whole graph from")
    group.add_argument(
        "--plug",
        action="append",
        default=[],
        metavar="COMPONENT=CHECKPOINT",
        help="take a component, trained in whatever graph, from a checkpoint",
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


def _add_settings(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("settings")
    group.add_argument("--component", required=True, help="the component to train")
    group.add_argument(
        "--epochs",
        type=int,
        required=True,
        help="a run resumed with more goes on along the schedule of the new length",
    )
    for setting in fields(Settings):
        if setting.name in {"component", "epochs"}:
            continue
        option = f"--{setting.name.replace('_', '-')}"
        shown = "default %(default)s"
        if isinstance(setting.default, bool):
            action = argparse.BooleanOptionalAction
            group.add_argument(option, action=action, default=setting.default, help=shown)
        else:
            group.add_argument(
                option,
                type=type(setting.default),
                default=setting.default,
                choices=CHOICES.get(setting.name),
                help=shown,
            )


def run(options: argparse.Namespace) -> int:
    """Carry out `train`."""
    settings = Settings(**{s.name: getattr(options, s.name) for s in fields(Settings)})
    last = options.folder / Trainer.LAST
    if last.exists() and not options.resume:
        raise ConfigError(f"`{last}` exists; hint: `--resume`, or another `--run`")
    _check_ids(options)
    torch.manual_seed(settings.seed)
    graph, before = _graph(options)
    train, val = (open_cached(options, ids) for ids in (options.train_ids, options.val_ids))
    if options.intrinsics:
        _require_shape(graph.spec.camera, train)
    before.provenance[settings.component] = run_provenance(options, train=train.ids, val=val.ids)
    trainer = Trainer(
        graph,
        settings,
        train=train,
        val=val,
        shown=Cached.of_picture(options.show) if options.show else None,
        folder=options.folder,
        before=before,
    )
    if options.resume and last.exists():
        trainer.resume()
    done = trainer.run(minutes=options.minutes, quiet=options.quiet)
    print(f"{last}: {'finished' if done else 'stopped in time, to be resumed'}")
    return 0


def _check_ids(options: argparse.Namespace) -> None:
    """Refuse lists of ids that cannot be trained or validated on, before anything is decoded."""
    train, val = read_ids(options.train_ids), read_ids(options.val_ids)
    shared = sorted(set(train) & set(val))
    if shared:
        some = ", ".join(f"`{name}`" for name in shared[:SHARED_SHOWN])
        raise ConfigError(
            f"`{options.train_ids}` and `{options.val_ids}` share {len(shared)} ids: {some}"
            f"{' ...' if len(shared) > SHARED_SHOWN else ''}; hint: what was trained on tells "
            "nothing in validation, so keep these in one list alone"
        )
    if options.batch < 1:
        raise ConfigError(f"`--batch {options.batch}`; expected at least 1")
    if len(train) < options.batch:
        raise ConfigError(
            f"`{options.train_ids}` names {len(train)} pictures; expected at least "
            f"`--batch {options.batch}` of them, as an epoch has whole batches only; "
            f"hint: `--batch {len(train)}` or less"
        )


def _graph_spec(options: argparse.Namespace, before: Checkpoint | None) -> GraphSpec:
    """The graph as the options and the checkpoint to start from say."""
    if options.start and (options.tasks or options.sigmoid_joint):
        raise ConfigError(
            "`--start` takes tasks and sigmoids from its checkpoint; hint: leave `--tasks` and "
            "`--sigmoid-joint` out, or `--plug` components into a graph that has them"
        )
    spec = before.spec if before is not None else _spec(options)
    if options.intrinsics:
        spec = replace(spec, camera=Camera.from_intrinsics(options.intrinsics))
    if options.component not in [c.name for c in spec.components]:
        raise ConfigError(f"components are {', '.join(c.name for c in spec.components)}")
    if options.drop_path and not (options.folder / Trainer.LAST).exists():
        # (a run to resume may be of a version that took it for any backbone)
        for component in spec.components:
            if component.name == options.component:
                check_drop_path(component.backbone)
    components = tuple(
        c.changed(dropout=options.dropout, drop_path=options.drop_path)
        if c.name == options.component
        else c
        for c in spec.components
    )
    return replace(spec, components=components)


def _graph(options: argparse.Namespace) -> tuple[SerialGraph, Checkpoint]:
    """The graph to train, and the checkpoint whose history goes on."""
    before = Checkpoint.load(options.start) if options.start else None
    graph = SerialGraph(_graph_spec(options, before))
    if before is not None:
        graph.load_state_dict(before.weights)
    before = before or Checkpoint(graph.spec, {})
    for plug in options.plug:
        name, _, path = plug.partition("=")
        other = Checkpoint.load(Path(path))
        graph.component(name).load_weights(other.component_weights(name))
        before.history[name] = other.history.get(name, [])
        before.settings[name] = other.settings.get(name, {})
        before.provenance[name] = other.provenance.get(name, {})
    component = graph.component(options.component)
    if options.begin_with:
        begin_with(
            component, Checkpoint.load(options.begin_with).component_weights(options.component)
        )
    if options.imagenet:
        imagenet_encoder(component)
    if options.like:
        like_component(component, _earlier(graph, options.like))
    return graph, before


def _earlier(graph: SerialGraph, like: str) -> Component:
    """The component that `--like` names."""
    name, _, path = like.partition("=")
    return (Checkpoint.load(Path(path)).graph() if path else graph).component(name)


def _require_shape(camera: Camera, train: Cached) -> None:
    """The camera's pictures and those of the data may differ in size, not in shape."""
    height, width = train.depth.shape[1:]
    if camera.width * height != camera.height * width:
        raise ConfigError(
            f"`--intrinsics` is of pictures of {camera.width}x{camera.height}; the training "
            f"pictures are {width}x{height}; hint: intrinsics at that size, scaled or cropped"
        )


def _spec(options: argparse.Namespace) -> GraphSpec:
    return graph_spec(
        options.architecture,
        backbone=options.backbone,
        decoder=DECODERS[options.decoder],
        inner_size=tuple(options.inner_size),
        encoding=options.encoding,
        tasks=options.tasks.split(",") if options.tasks else (),
        sigmoid_joints=options.sigmoid_joint,
    )
