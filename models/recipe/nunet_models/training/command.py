"""The subcommand `train`."""

import argparse
import sys
from dataclasses import fields
from pathlib import Path

import torch

from nunet_models.data.cache import Cached
from nunet_models.data.nyu_mat import MAT_LABELS, MAT_LABELS_HINT, MAT_SUFFIX
from nunet_models.data.options import (
    add_cache_option,
    add_data_options,
    add_sets_option,
    check_sets_or_data,
    open_cached,
)
from nunet_models.data.pairs import read_ids
from nunet_models.data.sets.mixture import open_dataset_list
from nunet_models.errors import ConfigError, OptionError, with_hint
from nunet_models.files import check_output_folder
from nunet_models.tasks.inner import truth_of
from nunet_models.training.feed import FolderFeed, SetsFeed
from nunet_models.training.graph import (
    add_graph_options,
    build_graph,
    require_shape,
)
from nunet_models.training.provenance import part_provenance, run_provenance
from nunet_models.training.schedule import SCHEDULES
from nunet_models.training.settings import AUGMENTATIONS, Settings
from nunet_models.training.trainer import OPTIMIZERS, Trainer, require_segmentation
from nunet_models.zoo import GraphSpec, SerialGraph
from nunet_models.zoo.checkpoint import Checkpoint, LoadCheckpoint
from nunet_models.zoo.confidence import CONFIDENCE

SHARED_SHOWN = 3  # of the ids that two lists share
CHOICES = {
    "augmentation": sorted(AUGMENTATIONS),
    "optimizer": sorted(OPTIMIZERS),
    "schedule": SCHEDULES,
}


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Register `train` and its options."""
    parser = subparsers.add_parser("train", help="train one component of a serial graph")
    parser.add_argument("--run", type=Path, required=True, dest="folder", help="the run's folder")
    parser.add_argument(
        "--resume",
        action="store_true",
        help="continue the run in the folder, with the options it was started with; other "
        "`--epochs`, `--threads`, `--workers` and `--validate-every` are taken as given now",
    )
    parser.add_argument(
        "--minutes", type=float, help="stop after this time; continue with `--resume`"
    )
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    add_data_options(parser, required=False)
    add_cache_option(parser)
    parser.add_argument("--train-ids", type=Path)
    parser.add_argument("--val-ids", type=Path)
    add_sets_option(parser)
    parser.add_argument(
        "--epoch-images",
        type=int,
        help="images that an epoch of `--sets` draws (default: as many as there are)",
    )
    parser.add_argument(
        "--show",
        type=Path,
        metavar="IMAGE",
        help="the image whose prediction each validation keeps (default: the first one of them)",
    )
    parser.add_argument(
        "--license",
        metavar="TEXT",
        help="license and attribution of the images, recorded for `export`; replaces that of a "
        "run that is resumed",
    )
    add_graph_options(parser)
    _add_settings(parser)
    parser.set_defaults(carry_out=run)


def _add_settings(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("settings")
    group.add_argument(
        "--component",
        required=True,
        help="the component to train, or `confidence` for the head that predicts depth's error",
    )
    group.add_argument(
        "--epochs",
        type=int,
        required=True,
        help="may be raised on `--resume`: the run follows the schedule of the new length",
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


def settings_of(options: argparse.Namespace) -> Settings:
    """The settings among the options; `OptionError` for an invalid one."""
    return Settings(**{s.name: getattr(options, s.name) for s in fields(Settings)})


def prepare(
    options: argparse.Namespace, load: LoadCheckpoint = Checkpoint.load
) -> tuple[Settings, SerialGraph, Checkpoint]:
    """Settings, graph, and the checkpoint that it continues: all that needs no decoded data.

    `load` reads the checkpoints that the options name.

    # Errors
    `ConfigError` for options that do not fit each other, the id lists or the checkpoints.
    """
    settings = settings_of(options)
    if options.minutes is not None and not options.minutes > 0.0:
        raise OptionError(
            f"`--minutes {options.minutes}`; expected more than 0", hint="no limit without it"
        )
    check_output_folder("--run", options.folder)
    last = options.folder / Trainer.LAST
    if last.exists() and not options.resume:
        raise ConfigError(f"`{last}` exists", hint="`--resume`, or another `--run`")
    check_sets_or_data(options, "cache", "train_ids", "val_ids")
    if options.sets is None:
        _check_ids(options)
    torch.manual_seed(settings.seed)
    graph, before = build_graph(options, load)
    require_segmentation(graph.spec, settings)
    if options.sets is None:
        _check_folder_options(options, graph.spec)
    before.provenance[settings.component] = part_provenance(options, graph.spec, before, load)
    return settings, graph, before


def run(options: argparse.Namespace) -> int:
    """Carry out `train`."""
    settings, graph, before = prepare(options)
    feed = _sets_feed(options) if options.sets else _folder_feed(options, graph.spec)
    last = options.folder / Trainer.LAST
    _print_assumed_camera(options, graph.spec, resuming=last.exists())
    before.provenance[settings.component] |= run_provenance(options, feed.provenance(options))
    trainer = Trainer(graph, settings, feed=feed, folder=options.folder, before=before)
    if options.resume and last.exists():
        trainer.resume()
    done = trainer.run(minutes=options.minutes, quiet=options.quiet)
    print(f"{last}: {'finished' if done else 'stopped in time, to be resumed'}")
    return 0


def _check_folder_options(options: argparse.Namespace, spec: GraphSpec) -> None:
    """Refuse options of `--sets`, and labels that `--data` cannot have."""
    if options.epoch_images is not None:
        raise OptionError(f"`--epoch-images {options.epoch_images}` is for `--sets`")
    if options.patch != 1.0:
        raise OptionError(f"`--patch {options.patch}` is for `--sets`")
    _check_labels(options, spec)


def _folder_feed(options: argparse.Namespace, spec: GraphSpec) -> FolderFeed:
    train, val = (open_cached(options, ids) for ids in (options.train_ids, options.val_ids))
    if options.intrinsics:
        require_shape(spec.camera, train)
    feed = FolderFeed(train, val, _show(options), options.frames)
    if options.frames > 1 and feed.images() < options.batch:
        raise ConfigError(
            f"`{options.train_ids}` has {feed.images()} windows of {options.frames} frames of one "
            f"video; expected at least `--batch {options.batch}` of them",
            hint="ids of one video differ in the number at their end alone, and are in order",
        )
    return feed


def _sets_feed(options: argparse.Namespace) -> SetsFeed:
    if options.frames > 1:
        raise OptionError(
            f"`--frames {options.frames}` is for the frames of `--data`, not for `--sets`"
        )
    train, val = open_dataset_list(options.sets)
    images = len(train) if options.epoch_images is None else options.epoch_images
    if images < options.batch:
        raise ConfigError(
            f"an epoch of `{options.sets}` has {images} images; expected at least "
            f"`--batch {options.batch}` of them"
        )
    return SetsFeed(train, val, images, _show(options))


def _show(options: argparse.Namespace) -> Cached | None:
    return Cached.of_image(options.show) if options.show else None


def _check_labels(options: argparse.Namespace, spec: GraphSpec) -> None:
    """Refuse to train on labels that the data cannot have, before it is decoded."""
    if options.component == CONFIDENCE:
        return
    component = spec.component(options.component)
    without = options.data.suffix == MAT_SUFFIX and options.class_map is None
    if truth_of(component.task) == "labels" and without:
        raise ConfigError(
            f"`{options.data}` has no labels of its own to train `{component.name}` on: "
            f"{MAT_LABELS}",
            hint=MAT_LABELS_HINT,
        )


def _print_assumed_camera(options: argparse.Namespace, spec: GraphSpec, *, resuming: bool) -> None:
    """Print the camera that is assumed if none was given: it sets the scale of depth."""
    given = options.intrinsics or options.start or options.sets or resuming
    if given or options.data.suffix == MAT_SUFFIX or spec.encoding != "metric":
        return
    camera = spec.camera
    print(
        with_hint(
            f"nunet_models: assumed NYU Depth V2's camera, fx {camera.fx} pixels "
            f"at {camera.width}x{camera.height}, by which nunetd will scale meters",
            "`--intrinsics fx,fy,cx,cy@WxH` states another camera",
        ),
        file=sys.stderr,
    )


def _check_ids(options: argparse.Namespace) -> None:
    """Refuse lists of ids that cannot be trained or validated on, before anything is decoded."""
    train, val = read_ids(options.train_ids), read_ids(options.val_ids)
    shared = sorted(set(train) & set(val))
    if shared:
        some = ", ".join(f"`{name}`" for name in shared[:SHARED_SHOWN])
        raise ConfigError(
            f"`{options.train_ids}` and `{options.val_ids}` share {len(shared)} ids: {some}"
            f"{' ...' if len(shared) > SHARED_SHOWN else ''}",
            hint="keep each id in one list only: validation needs images that were not trained on",
        )
    if len(train) < options.batch:
        raise ConfigError(
            f"`{options.train_ids}` names {len(train)} images; expected at least "
            f"`--batch {options.batch}` of them, as an epoch has whole batches only",
            hint=f"`--batch {len(train)}` or less",
        )
