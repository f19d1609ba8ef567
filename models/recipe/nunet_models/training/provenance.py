"""What a run was made from, as plain data kept in its checkpoints and in the model file."""

import argparse
import hashlib
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from nunet_models.data.pairs import MILLIMETER_M
from nunet_models.data.sets.mixture import Mixture, mixture_summary
from nunet_models.zoo import GraphSpec
from nunet_models.zoo.checkpoint import Checkpoint, LoadCheckpoint


def run_provenance(options: argparse.Namespace, data: dict[str, Any]) -> dict[str, Any]:
    """Data, initial weights and regularization of one component's run; its settings have the rest.

    `data` is the result of `folder_provenance` or `sets_provenance`. `origin` names the options
    that gave initial weights, with their files, and is empty for random weights. Files and folders
    are recorded by name, without their path, which differs between machines.
    """
    return {
        "data": data,
        "origin": _origin(options),
        "dropout": options.dropout,
        "drop_path": options.drop_path,
    }


def part_provenance(
    options: argparse.Namespace, spec: GraphSpec, before: Checkpoint, load: LoadCheckpoint
) -> dict[str, Any]:
    """Camera and license of the images, and the training of a decoder that was plugged in.

    `decoder` has the form of a component in `nunet.training`. It stays with the weights if a later
    run continues them, as what is known of a plugged component does.
    """
    found: dict[str, Any] = {"camera": asdict(spec.camera)}
    if options.license:
        found["license"] = options.license
    if options.plug_decoder:
        other = load(options.plug_decoder)
        last = other.spec.components[-1].name
        found["decoder"] = {"component": last, **other.training_of(last)}
    elif decoder := before.provenance.get(options.component, {}).get("decoder"):
        found["decoder"] = decoder
    return found


def folder_provenance(
    options: argparse.Namespace, *, train: Sequence[str], val: Sequence[str]
) -> dict[str, Any]:
    """The images of `--data`."""
    return {
        "name": options.data.resolve().name,
        "class_map": options.class_map and _file(options.class_map),
        "depth_scale": MILLIMETER_M if options.depth_scale is None else options.depth_scale,
        "depth_offset": options.depth_offset,
        "window": options.window,
        "train": list_of_ids(train),
        "val": list_of_ids(val),
    }


def sets_provenance(options: argparse.Namespace, *, train: Mixture, val: Mixture) -> dict[str, Any]:
    """The sets of `--sets`; a folder that still grows is listed as it was at the start."""
    return {
        "sets": options.sets.name,
        "epoch_images": options.epoch_images,
        "train_sets": mixture_summary(train),
        "val_sets": mixture_summary(val),
    }


def list_of_ids(ids: Sequence[str]) -> dict[str, Any]:
    """How many ids, and the SHA-256 of them in order, each followed by a newline."""
    text = "".join(f"{identity}\n" for identity in ids)
    return {"pictures": len(ids), "ids_sha256": hashlib.sha256(text.encode()).hexdigest()}


def _origin(options: argparse.Namespace) -> dict[str, Any]:
    plugs = dict(plug.split("=", 1) for plug in options.plug)
    origin = {
        "start": options.start and _file(options.start),
        "plug": {component: _file(Path(path)) for component, path in plugs.items()},
        "begin_with": options.begin_with and _file(options.begin_with),
        "imagenet": options.imagenet,
        "like": options.like and _like(options.like),
        "plug_decoder": options.plug_decoder and _file(options.plug_decoder),
        "freeze_decoder": options.freeze_decoder,
    }
    return {name: value for name, value in origin.items() if value}


def _like(like: str) -> str | dict[str, str]:
    name, _, path = like.partition("=")
    return {"component": name, **_file(Path(path))} if path else name


def _file(path: Path) -> dict[str, str]:
    with path.open("rb") as file:
        return {"file": path.name, "sha256": hashlib.file_digest(file, "sha256").hexdigest()}
