"""Text files of users, tables, and checks of output files before the work."""

import csv
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from nunet_models.errors import ConfigError, DataError


def read_text(path: Path, what: str) -> str:
    """The text of `path`, which is expected to be `what`; a byte order mark is skipped.

    # Errors
    `DataError` naming a file that is not in UTF-8.
    """
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError(f"`{path}` is not {what} in UTF-8: {error}") from error


def finite(text: str | None) -> float | None:
    """The number that a cell states; None if it states none, or one that is not finite."""
    try:
        number = float(text or "")
    except ValueError:
        return None
    return number if math.isfinite(number) else None


def write_table(path: Path, columns: Sequence[str], rows: Iterable[Mapping[str, object]]) -> None:
    """Write a CSV file; None becomes an empty cell."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=columns)
        writer.writeheader()
        writer.writerows(rows)


def check_output_file(option: str, path: Path | None, *, makes_folders: bool = False) -> None:
    """Refuse a file that cannot be written, so that no work is lost; None is not checked.

    With `makes_folders`, the command makes the folders above the file.

    # Errors
    `ConfigError` naming `option` and the path.
    """
    if path is None:
        return
    if path.is_dir():
        raise ConfigError(f"`{option} {path}` is a folder; expected the name of a file")
    if makes_folders or path.exists():
        _check_writable(option, path)
    elif path.parent.is_dir():
        _check_writable(option, path.parent)
    else:
        raise ConfigError(
            f"`{option} {path}`: `{path.parent}` is not a folder", hint=f"mkdir -p {path.parent}"
        )


def check_output_folder(option: str, path: Path) -> None:
    """The same for a folder, which the command makes if it is missing."""
    if path.exists() and not path.is_dir():
        raise ConfigError(f"`{option} {path}` is a file; expected a folder")
    _check_writable(option, path)


def _check_writable(option: str, path: Path) -> None:
    """Refuse `path` if it, or else the nearest folder above it, cannot be written."""
    there = next(place for place in (path, *path.absolute().parents) if place.exists())
    if there != path and not there.is_dir():
        raise ConfigError(f"`{option} {path}`: `{there}` is not a folder")
    if not os.access(there, os.W_OK):
        raise ConfigError(f"`{option} {path}`: `{there}` cannot be written: permission denied")
