"""The subcommand `annotate`: writes accuracy and license into a finished model file."""

import argparse
import hashlib
import json
from pathlib import Path
from typing import Any, NoReturn

from nunet_models.errors import ConfigError
from nunet_models.export.metadata import to_json
from nunet_models.export.onnx_file import read_metadata, write_metadata
from nunet_models.results import Measured, by_name, measured


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Register `annotate` and its options."""
    parser = subparsers.add_parser("annotate", help="write accuracy or license into a model file")
    parser.add_argument("--model", type=Path, required=True, help="model file, .onnx")
    parser.add_argument(
        "--accuracy",
        type=Path,
        help="result of `evaluate` or `nunetd eval --json` for exactly this file",
    )
    parser.add_argument(
        "--license", metavar="TEXT", help="license of the weights, attribution of their data"
    )
    parser.set_defaults(carry_out=run)


def run(options: argparse.Namespace) -> int:
    """Carry out `annotate`; prints the file written."""
    if not (options.accuracy or options.license):
        raise ConfigError("nothing to write", hint="`--accuracy FILE` or `--license TEXT`")
    values = read_metadata(options.model)
    if values.get("nunet.version") != "1":
        raise ConfigError(f"`{options.model}` is not a nunet model file of version 1")
    if options.license:
        values["nunet.license"] = options.license
    if options.accuracy:
        accuracy = read_accuracy(options.accuracy)
        found = to_json(by_name(accuracy))
        if values.get("nunet.accuracy") != found:  # (else it is there already)
            _check_measured(options.model, options.accuracy, measured(accuracy))
        values["nunet.accuracy"] = found
    write_metadata(options.model, values)
    print(options.model)
    return 0


def _check_measured(model: Path, path: Path, of: Measured) -> None:
    """Refuse metrics of another file than this one."""
    if of.sha256 is not None:
        digest = hashlib.sha256(model.read_bytes()).hexdigest()
        if of.sha256 != digest:
            raise ConfigError(
                f"`{path}` is of the model `{of.name}` with the SHA-256 `{of.sha256}`; expected "
                f"`{model.name}` with `{digest}`",
                hint="measure the file as it is now, since "
                "any change to its metadata changes its hash",
            )
    elif of.name not in {None, model.name}:
        raise ConfigError(
            f"`{path}` is of the model `{of.name}`; expected `{model.name}`",
            hint=f"`evaluate --model {model}`",
        )


def read_accuracy(path: Path) -> dict[str, Any]:
    """A result of `evaluate` or `nunetd eval --json`, or any JSON object.

    # Errors
    `ConfigError` naming a file that is not a JSON object.
    """
    try:
        values = json.loads(path.read_text(encoding="utf-8-sig"), parse_constant=_refused)
    except ValueError as error:  # of JSON or of UTF-8
        raise ConfigError(
            f"`{path}` is not JSON: {error}", hint=f"`evaluate ... > {path.name}` writes it"
        ) from error
    if not isinstance(values, dict):
        raise ConfigError(f"`{path}` is not a JSON object", hint="a result of `evaluate` is one")
    try:
        measured(values)
    except TypeError as error:
        raise ConfigError(f"`{path}`: {error}", hint="a result of `evaluate` has one") from error
    return values


def _refused(constant: str) -> NoReturn:
    raise ValueError(f"`{constant}` is not a JSON number")
