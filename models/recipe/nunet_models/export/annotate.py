"""The verb `annotate`: what is measured of a finished model file, written into it."""

import argparse
import json
from pathlib import Path
from typing import Any, NoReturn

from nunet_models.errors import ConfigError
from nunet_models.export.metadata import to_json
from nunet_models.export.onnx_file import read_metadata, write_metadata


def add_parser(verbs: argparse._SubParsersAction) -> None:
    """Register `annotate` and its options."""
    parser = verbs.add_parser("annotate", help="write a model file's accuracy into it")
    parser.add_argument("--model", type=Path, required=True, help="model file, .onnx")
    parser.add_argument(
        "--accuracy", type=Path, required=True, help="answer of `evaluate` for this very file"
    )
    parser.set_defaults(carry_out=run)


def run(options: argparse.Namespace) -> int:
    """Carry out `annotate`; prints the file written."""
    if not options.model.is_file():
        raise ConfigError(f"no model file `{options.model}`")
    values = read_metadata(options.model)
    if values.get("nunet.version") != "1":
        raise ConfigError(f"`{options.model}` is no nunet model file of version 1")
    accuracy = read_accuracy(options.accuracy)
    measured = accuracy.get("model", options.model.name)
    if measured != options.model.name:
        raise ConfigError(
            f"`{options.accuracy}` is of the model `{measured}`; expected `{options.model.name}`; "
            f"hint: `evaluate --model {options.model}`"
        )
    write_metadata(options.model, {**values, "nunet.accuracy": to_json(accuracy)})
    print(options.model)
    return 0


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
