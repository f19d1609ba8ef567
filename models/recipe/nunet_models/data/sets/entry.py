"""The dataset list: a TOML file that names folders of images with depth, one `[[set]]` each."""

import math
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path

from nunet_models.errors import DataError

USES = ("train", "val")
PROTOCOLS = ("full", "eigen")
"""Those of `evaluate`."""
_HEADER = "[[set]]"


@dataclass(frozen=True)
class SetEntry:
    """One `[[set]]` of a dataset list.

    `root` holds `rgb/`, `depth/` and perhaps labels, as for `--data`. `ids` is a list of ids (all
    images of `rgb/` without one). `scenes` keeps these scenes only and `except_scenes` drops
    scenes; both need `intrinsics.csv`. `intrinsics` is `fx,fy,cx,cy@WxH` for a set of one camera,
    instead of `intrinsics.csv`.

    Sampling: a room is drawn first, with a probability proportional to `weight`, then an image of
    it. `rooms` says how many rooms a set without scenes counts for.

    Masks: `depth_range` is what the sensor measures reliably, in meters. `edge_erosion` drops that
    many pixels around depth edges, for depth that is not registered exactly. `sparse` is for
    sensors that measure few pixels: each measurement also counts for its direct neighbors.

    `growing` is for a folder that another program still writes: it is read again at each epoch,
    and images whose files are not all there yet are skipped. `limit` keeps that many images,
    spread evenly. `protocol` is that of `evaluate`.
    """

    name: str
    root: Path
    line: int
    file: Path
    use: str = "train"
    ids: Path | None = None
    scenes: tuple[str, ...] = ()
    except_scenes: tuple[str, ...] = ()
    intrinsics: str | None = None
    depth_scale: float | None = None
    depth_offset: float = 0.0
    window: tuple[int, ...] | None = None
    weight: float = 1.0
    rooms: int = 1
    depth_range: tuple[float, ...] = (0.0, math.inf)
    edge_erosion: int = 0
    sparse: bool = False
    growing: bool = False
    limit: int | None = None
    protocol: str = "full"

    @property
    def where(self) -> str:
        """File and line of the set, for messages."""
        return f"{self.file}:{self.line}: set `{self.name}`"

    def error(self, what: str, *, hint: str | None = None) -> DataError:
        """An error of this set."""
        return DataError(f"{self.where}: {what}", hint=hint)


_OWN = {"line", "file"}
_KEYS = {f.name for f in fields(SetEntry)} - _OWN


def _text(value: object) -> bool:
    return isinstance(value, str) and bool(value)


def _number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _positive(value: object) -> bool:
    return _number(value) and value > 0


def _count(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 1


def _texts(value: object) -> bool:
    return isinstance(value, list) and bool(value) and all(map(_text, value))


def _window(value: object) -> bool:
    if not isinstance(value, list) or len(value) != 4:
        return False
    return (
        all(isinstance(n, int) for n in value)
        and 0 <= value[0] < value[2]
        and 0 <= value[1] < value[3]
    )


def _range(value: object) -> bool:
    pair = isinstance(value, list) and len(value) == 2 and all(map(_number, value))
    return pair and 0 <= value[0] < value[1]


def _flag(value: object) -> bool:
    return isinstance(value, bool)


_RULES: dict[str, tuple[Callable[[object], bool], str]] = {
    "name": (_text, "text"),
    "root": (_text, "a folder"),
    "use": (lambda v: v in USES, " or ".join(f'"{use}"' for use in USES)),
    "ids": (_text, "a file of ids"),
    "scenes": (_texts, "a list of scene names"),
    "except_scenes": (_texts, "a list of scene names"),
    "intrinsics": (_text, '"fx,fy,cx,cy@WxH" in pixels'),
    "depth_scale": (_positive, "meters per unit, more than 0"),
    "depth_offset": (_number, "a number"),
    "window": (_window, "[top, left, bottom, right] in pixels"),
    "weight": (_positive, "a number more than 0"),
    "rooms": (_count, "a whole number, at least 1"),
    "depth_range": (_range, "[nearest, farthest] in meters"),
    "edge_erosion": (lambda v: v == 0 or _count(v), "a whole number of pixels"),
    "sparse": (_flag, "true or false"),
    "growing": (_flag, "true or false"),
    "limit": (_count, "a whole number, at least 1"),
    "protocol": (lambda v: v in PROTOCOLS, " or ".join(f'"{name}"' for name in PROTOCOLS)),
}


def read_dataset_list(path: Path) -> list[SetEntry]:
    """The sets of a dataset list. Relative paths start at the list's folder.

    # Errors
    `DataError` with file and line for a file that is not TOML, an unknown key, a bad value, or a
    name that appears twice.
    """
    if not path.is_file():
        raise DataError(f"cannot read the dataset list `{path}`: no such file")
    try:
        text = path.read_text(encoding="utf-8-sig")
        values = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise DataError(f"{path}: not a TOML file: {error}") from error
    tables = values.get("set", [])
    unknown = sorted(set(values) - {"set"})
    if unknown or not isinstance(tables, list) or not tables:
        got = f"`{unknown[0]}`" if unknown else "none"
        raise DataError(f"{path}: expected one or more tables `{_HEADER}`, got {got}")
    lines = _Lines(text)
    entries = [_entry(path, table, lines, index) for index, table in enumerate(tables)]
    _check_names(entries)
    return entries


class _Lines:
    """Line numbers of the tables and keys of a dataset list (`tomllib` gives none)."""

    def __init__(self, text: str) -> None:
        self.lines = text.split("\n")
        starts = [i for i, line in enumerate(self.lines) if line.strip().startswith(_HEADER)]
        self.starts = [*starts, len(self.lines)]

    def of(self, table: int, key: str | None = None) -> int:
        """Line, from 1, of a table or of a key in it; 1 where the text is written otherwise."""
        if table + 1 >= len(self.starts):
            return 1
        first, end = self.starts[table], self.starts[table + 1]
        for number in range(first, end):
            if key is not None and self.lines[number].split("=")[0].strip() == key:
                return number + 1
        return first + 1


def _entry(path: Path, table: object, lines: _Lines, index: int) -> SetEntry:
    def fail(key: str | None, what: str) -> DataError:
        return DataError(f"{path}:{lines.of(index, key)}: {what}")

    if not isinstance(table, dict):
        raise fail(None, f"expected a table `{_HEADER}`")
    for key in table:
        if key not in _KEYS:
            raise fail(key, f"unknown key `{key}`; expected one of {', '.join(sorted(_KEYS))}")
        holds, expected = _RULES[key]
        if not holds(table[key]):
            raise fail(key, f"`{key}` is {table[key]!r}, expected {expected}")
    for key in ("name", "root"):
        if key not in table:
            raise fail(None, f"the set has no `{key}`")
    values = {k: tuple(v) if isinstance(v, list) else v for k, v in table.items()}
    for key in ("root", "ids"):
        if key in values:
            values[key] = path.parent / values[key]
    return SetEntry(**values, line=lines.of(index), file=path)


def _check_names(entries: list[SetEntry]) -> None:
    seen: dict[tuple[str, str], SetEntry] = {}
    for entry in entries:
        before = seen.setdefault((entry.use, entry.name), entry)
        if before is not entry:
            raise entry.error(f"another set of line {before.line} has this name")
