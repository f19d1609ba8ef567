"""The plan of an experiment: a TOML file that names networks and the options that train them."""

import re
import shlex
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from nunet_models.errors import DataError
from nunet_models.files import read_text

_NAME = re.compile(r"[A-Za-z0-9_.]+")
_PLACEHOLDER = re.compile(r"\{(.*?)\}")
_KEYS = {"common", "seeds", "pretrained", "networks"}


@dataclass(frozen=True)
class Plan:
    """What an experiment trains.

    `common` are options of `train` for every run; those of a run come after them and win.
    `pretrained` are trained once, in their order, and not measured: a network, or a later one of
    them, starts from one by `{NAME}` in its options (not in `common`), which becomes the path of
    its checkpoint. Each of `networks` is trained with every seed and measured. The first one is
    what the others are compared with.
    """

    common: tuple[str, ...]
    seeds: tuple[int, ...]
    pretrained: Mapping[str, tuple[str, ...]]
    networks: Mapping[str, tuple[str, ...]]


def read_plan(path: Path) -> Plan:
    """Read a plan.

    # Errors
    `DataError` naming the file, for one that is not TOML, an unknown key or a bad value.
    """
    try:
        values = tomllib.loads(read_text(path, "a plan"))
    except tomllib.TOMLDecodeError as error:
        raise DataError(f"`{path}` is not a TOML file: {error}") from error
    unknown = sorted(values.keys() - _KEYS)
    if unknown:
        expected = ", ".join(sorted(_KEYS))
        raise DataError(f"`{path}`: unknown key `{unknown[0]}`; expected one of {expected}")
    plan = Plan(
        _options(path, "common", values.get("common", "")),
        _seeds(path, values.get("seeds", [0])),
        _runs(path, "pretrained", values.get("pretrained", {})),
        _runs(path, "networks", values.get("networks")),
    )
    _check_references(path, plan)
    return plan


def _seeds(path: Path, value: object) -> tuple[int, ...]:
    counts = isinstance(value, list) and all(type(seed) is int and seed >= 0 for seed in value)
    if not counts or not value or len(set(value)) != len(value):
        raise DataError(f"`{path}`: `seeds` is {value!r}, expected a list of different numbers")
    return tuple(value)


def _runs(path: Path, key: str, value: object) -> dict[str, tuple[str, ...]]:
    if not isinstance(value, dict) or (key == "networks" and not value):
        raise DataError(f'`{path}`: expected a table `[{key}]` of `NAME = "OPTIONS"`')
    for name in value:
        if not _NAME.fullmatch(name):
            raise DataError(
                f"`{path}`: `{name}` in `[{key}]`; expected letters, digits, `_` and `.` alone",
                hint="files are named after it",
            )
    return {name: _options(path, name, options) for name, options in value.items()}


def _options(path: Path, name: str, value: object) -> tuple[str, ...]:
    """Options as a shell would split them."""
    if not isinstance(value, str):
        raise DataError(f"`{path}`: `{name}` is {value!r}, expected options of `train` as text")
    try:
        return tuple(shlex.split(value))
    except ValueError as error:
        raise DataError(f"`{path}`: `{name}`: {error}") from error


def _check_references(path: Path, plan: Plan) -> None:
    """Refuse networks that start from one that is not trained before them.

    `common` cannot name any: it is also of the first pretrained network, before which is none.
    """
    for used in _PLACEHOLDER.findall(" ".join(plan.common)):
        raise DataError(
            f"`{path}`: `common` uses `{{{used}}}`, but `common` is of every network, also of the "
            "pretrained ones",
            hint=f"write `{{{used}}}` into the options of the networks that start from it",
        )
    before: set[str] = set()
    for name, options in plan.pretrained.items():
        _check_used(path, name, options, before)
        before.add(name)
    for name, options in plan.networks.items():
        if name in before:
            raise DataError(f"`{path}`: `{name}` is in `[pretrained]` and in `[networks]`")
        _check_used(path, name, options, before)


def _check_used(path: Path, name: str, options: tuple[str, ...], before: set[str]) -> None:
    for used in _PLACEHOLDER.findall(" ".join(options)):
        if used not in before:
            raise DataError(
                f"`{path}`: `{name}` uses `{{{used}}}`, which is not pretrained before it",
                hint="a network can use those of `[pretrained]`, and one of these those above it",
            )
