"""The verb `annotate`: what is known of a finished model file, written into it."""

import argparse
import json
from pathlib import Path
from typing import Any, NoReturn

from nunet_models.errors import ConfigError
from nunet_models.export.metadata import to_json
from nunet_models.export.onnx_file import read_metadata, write_metadata


def add_parser(verbs: argparse._SubParsersAction) -> None:
    """Register `annotate` and its options."""
    parser = verbs.add_parser("annotate", help="write accuracy or licence into a model file")
    parser.add_argument("--model", type=Path, required=True, help="model file, .onnx")
    parser.add_argument("--accuracy", type=Path, help="answer of `evaluate` for this very file")
    parser.add_argument(
        "--license", metavar="TEXT", help="licence of the weights, attribution of their data"
    )
    parser.set_defaults(carry_out=run)


def run(options: argparse.Namespace) -> int:
    """Carry out `annotate`; prints the file written."""
    if not (options.accuracy or options.license):
        raise ConfigError("nothing to write; hint: `--accuracy FILE` or `--license TEXT`")
    values = read_metadata(options.model)
    if values.get("nunet.version") != "1":
        raise ConfigError(f"`{options.model}` is no nunet model file of version 1")
    if options.license:
        values["nunet.license"] = options.license
    if options.accuracy:
        values["nunet.accuracy"] = to_json(_accuracy_of(options.model, options.accuracy))
    write_metadata(options.model, values)
    print(options.model)
    return 0


def _accuracy_of(model: Path, path: Path) -> dict[str, Any]:
    """What was measured of this file and not of another one."""
    accuracy = read_accuracy(path)
    measured = accuracy.get("model", model.name)
    if measured != model.name:
        raise ConfigError(
            f"`{path}` is of the model `{measured}`; expected `{model.name}`; "
            f"hint: `evaluate --model {model}`"
        )
    return accuracy


def read_accuracy(path: Path) -> dict[str, Any]:
    """An answer of `evaluate`, or any JSON object.

    # Errors
    `ConfigError` naming a file that is none.
    """
    try:
        values = json.loads(path.read_text(encoding="utf-8"), parse_constant=_refused)
    except ValueError as error:  # of JSON or of UTF-8
        raise ConfigError(
            f"`{path}` is no JSON: {error}; hint: `evaluate ... > {path.name}` writes it"
        ) from error
    if not isinstance(values, dict):
        raise ConfigError(f"`{path}` is no JSON object; hint: an answer of `evaluate` is one")
    return values


def _refused(constant: str) -> NoReturn:
    raise ValueError(f"`{constant}` is no number that JSON knows")
