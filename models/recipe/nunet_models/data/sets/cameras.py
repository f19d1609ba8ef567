"""Intrinsics of each image: `intrinsics.csv` of a folder, or one camera for all of it."""

import csv
import math
import re
from dataclasses import dataclass, field
from pathlib import Path

from nunet_models.errors import DataError
from nunet_models.files import finite, read_text

COLUMNS = ("id", "fx", "fy", "cx", "cy", "width", "height", "sensor", "scene")
_REQUIRED = COLUMNS[:7]
_NUMBER = r"(-?\d+(?:\.\d*)?)"
_TEXT = re.compile(rf"{_NUMBER},{_NUMBER},{_NUMBER},{_NUMBER}@(\d+)x(\d+)")


@dataclass(frozen=True)
class Pinhole:
    """A pinhole camera: pixels at `width` x `height`, the center of the first pixel at (0, 0)."""

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int

    @property
    def valid(self) -> bool:
        """Whether such a camera can exist: all finite, lengths and sizes more than 0."""
        numbers = (self.fx, self.fy, self.cx, self.cy)
        return all(map(math.isfinite, numbers)) and min(self.fx, self.fy) > 0 < min(
            self.width, self.height
        )

    @classmethod
    def parse(cls, text: str) -> "Pinhole | None":
        """Read `fx,fy,cx,cy@WxH`; None for other text."""
        found = _TEXT.fullmatch(text.replace(" ", ""))
        if not found:
            return None
        fx, fy, cx, cy = map(float, found.groups()[:4])
        camera = cls(fx, fy, cx, cy, int(found[5]), int(found[6]))
        return camera if camera.valid else None


@dataclass(frozen=True)
class Row:
    """One image's row of `intrinsics.csv`, and its place in the file."""

    camera: Pinhole
    sensor: str = ""
    scene: str = ""
    where: str = field(default="", compare=False)


def read_intrinsics(path: Path, *, growing: bool = False) -> dict[str, Row]:
    """Rows of an `intrinsics.csv` by image id.

    With `growing`, a last line without its newline is skipped: it is still being written.

    # Errors
    `DataError` with file and line for a missing column, a bad number or an id that appears twice.
    """
    if not path.is_file():
        raise DataError(
            f"cannot read `{path}`: no such file", hint="set `intrinsics` for one camera"
        )
    text = read_text(path, "a table")
    if growing and not text.endswith("\n"):
        text = text[: text.rfind("\n") + 1]
    reader = csv.DictReader(text.splitlines())
    missing = [name for name in _REQUIRED if name not in (reader.fieldnames or ())]
    if missing:
        raise DataError(f"{path}:1: no column `{missing[0]}`; expected {','.join(COLUMNS)}")
    rows: dict[str, Row] = {}
    for values in reader:
        where = f"{path}:{reader.line_num}"
        if values["id"] in rows:
            raise DataError(f"{where}: id `{values['id']}` appears twice")
        rows[values["id"]] = _row(values, where)
    return rows


def _row(values: dict[str, str | None], where: str) -> Row:
    numbers = []
    for name in _REQUIRED[1:]:
        number = finite(values[name])
        if number is None:
            raise DataError(f"{where}: `{name}` is `{values[name]}`, expected a number")
        numbers.append(number)
    width, height = numbers[4:]
    camera = Pinhole(*numbers[:4], int(width), int(height))
    if not camera.valid or (width, height) != (camera.width, camera.height):
        raise DataError(
            f"{where}: fx, fy, width and height must be more than 0, and sizes whole numbers"
        )
    return Row(camera, values.get("sensor") or "", values.get("scene") or "", where)
