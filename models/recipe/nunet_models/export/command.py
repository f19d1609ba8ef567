"""The subcommand `export`."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from nunet_models.errors import ConfigError, with_hint
from nunet_models.export.annotate import read_accuracy
from nunet_models.export.blend import blended, with_range
from nunet_models.export.collections import export_paper, export_tiny
from nunet_models.export.license import license_of, with_license
from nunet_models.export.model_file import Provenance, export_fused, export_staged
from nunet_models.export.split import split
from nunet_models.export.untrained import untrained_graph
from nunet_models.files import check_output_file
from nunet_models.results import by_name
from nunet_models.zoo import GraphSpec, SerialGraph, architecture_names, graph_spec
from nunet_models.zoo.checkpoint import Checkpoint


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Register `export` and its options."""
    parser = subparsers.add_parser("export", help="write model files that nunetd runs")
    _add_source_options(parser)
    parser.add_argument(
        "--out",
        type=Path,
        help="NAME.onnx for one file, NAME.toml for stages, NAME.pt for weights to fine-tune",
    )
    parser.add_argument(
        "--backbone", default="efficientnet_lite0", help="one, or a comma-separated list"
    )
    parser.add_argument(
        "--seed", type=int, default=0, help="seed of random weights (default %(default)s)"
    )
    parser.add_argument(
        "--accuracy", type=Path, help="output of `evaluate`, stored in the file's metadata"
    )
    parser.add_argument(
        "--license",
        metavar="TEXT",
        help="license of the weights and attribution of their data, for the metadata (default: "
        "what `train --license` stated, else that of NYU Depth V2)",
    )
    parser.add_argument(
        "--blend",
        metavar="FILE=SHARE",
        help="with `--checkpoint`: mix in this share of another checkpoint's weights",
    )
    parser.add_argument(
        "--depth-range",
        metavar="NEAR,FAR",
        help="with `--checkpoint`: range of valid depth in meters; depth outside counts as none",
    )
    parser.add_argument(
        "--random",
        action="append",
        default=[],
        metavar="COMPONENT",
        help="with `--checkpoint`: export this component though its weights are random, for an "
        "experiment; the file counts as untrained",
    )
    parser.set_defaults(carry_out=run)


def _add_source_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that say what is exported; one of them is required."""
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument(
        "--untrained",
        metavar="ARCHITECTURE",
        help=f"export an architecture with seeded random weights: {architecture_names()}",
    )
    what.add_argument("--checkpoint", type=Path, help="export a trained run's `best.pt`")
    what.add_argument(
        "--tiny", type=Path, metavar="FOLDER", help="write the small test models into FOLDER"
    )
    what.add_argument(
        "--paper",
        type=Path,
        metavar="FOLDER",
        help="write the paper's networks (ResNet-34, 480x640, random weights) into FOLDER",
    )
    what.add_argument(
        "--split",
        type=Path,
        metavar="FUSED",
        help="split the fused file of a connected graph into stages with the same results",
    )


def run(options: argparse.Namespace) -> int:
    """Carry out `export`; prints the files written."""
    check_output_file("--out", options.out, makes_folders=True)
    if options.tiny:
        written = export_tiny(options.tiny)
    elif options.paper:
        written = export_paper(options.paper)
    elif options.split:
        written = [_split(options)]
    else:
        written = [_export_one(options)]
    for path in written:
        print(path)
    return 0


def _split(options: argparse.Namespace) -> Path:
    out: Path | None = options.out
    if out is None or out.suffix != ".toml":
        raise ConfigError("`--split` needs `--out NAME.toml`")
    split(options.split, out)
    return out


def _export_one(options: argparse.Namespace) -> Path:
    out: Path | None = options.out
    if out is not None and out.suffix == ".pt" and options.checkpoint:
        out.parent.mkdir(parents=True, exist_ok=True)
        checkpoint = _checkpoint(options)
        if options.license:
            checkpoint = with_license(checkpoint, options.license)
        checkpoint.halved().save(out)
        return out
    if out is None or out.suffix not in {".onnx", ".toml"}:
        raise ConfigError(
            "`--out` must name a file that ends in `.onnx` or `.toml`, or `.pt` of a checkpoint"
        )
    graph, provenance = _trained(options) if options.checkpoint else _untrained(options)
    out.parent.mkdir(parents=True, exist_ok=True)
    write = export_fused if out.suffix == ".onnx" else export_staged
    write(graph, out, provenance)
    return out


def _untrained(options: argparse.Namespace) -> tuple[SerialGraph, Provenance]:
    spec = graph_spec(options.untrained, backbone=options.backbone)
    _require_image(spec)
    return untrained_graph(spec, seed=options.seed), Provenance(license_text=options.license)


def _checkpoint(options: argparse.Namespace) -> Checkpoint:
    checkpoint = Checkpoint.load(options.checkpoint)
    if options.blend:
        checkpoint = blended(checkpoint, options.blend)
    return with_range(checkpoint, options.depth_range) if options.depth_range else checkpoint


def _trained(options: argparse.Namespace) -> tuple[SerialGraph, Provenance]:
    checkpoint = _checkpoint(options)
    license_text = require_exportable(
        checkpoint, options.checkpoint, random=options.random, license_text=options.license
    )
    if not options.license:
        print(
            with_hint(
                f"nunet_models: the license is `{license_text}`",
                "`--license TEXT` for another one",
            ),
            file=sys.stderr,
        )
    accuracy = by_name(read_accuracy(options.accuracy)) if options.accuracy else {}
    training = {
        component: checkpoint.training_of(component)
        for component in checkpoint.settings
        if checkpoint.history.get(component)
    }
    return checkpoint.graph(), Provenance(
        trained=not options.random,
        training=training,
        accuracy=accuracy,
        license_text=license_text,
    )


def require_exportable(
    checkpoint: Checkpoint, path: Path, *, random: Sequence[str], license_text: str | None
) -> str:
    """The license of a checkpoint that can become a model file; `path` is for messages.

    # Errors
    `ConfigError` for a network that reads no image or is untrained, and for one of unknown data.
    """
    _require_image(checkpoint.spec)
    _require_trained(checkpoint, path, random=random)
    return license_text or license_of(checkpoint, path)


def _require_image(spec: GraphSpec) -> None:
    if spec.reads_depth:
        raise ConfigError(
            f"`{spec.architecture}` reads depth, and a model file reads an image",
            hint="`train --architecture wnet_c_auto --plug-decoder CHECKPOINT` uses its decoder",
        )


def _require_trained(checkpoint: Checkpoint, path: Path, *, random: Sequence[str]) -> None:
    for name in random:
        checkpoint.spec.component(name)  # an error lists the components
        if checkpoint.history.get(name):
            raise ConfigError(f"`--random {name}`: component `{name}` of `{path}` was trained")
    untrained = checkpoint.untrained_component(besides=random)
    if untrained is None:
        return
    if checkpoint.settings.get(untrained):
        raise ConfigError(
            f"component `{untrained}` of `{path}` has no validated epoch yet",
            hint="continue with "
            "`--resume` until the next validation (`--validate-every`), then export `best.pt`",
        )
    raise ConfigError(
        f"component `{untrained}` of `{path}` is untrained, its weights are random",
        hint=f"`train --component {untrained} --start {path}`, then export that run's `best.pt`",
    )
