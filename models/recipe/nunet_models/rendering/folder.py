"""The dataset's folder: images, `intrinsics.csv`, lists of the split. Needs no Blender."""

from __future__ import annotations

import contextlib
import csv
import fcntl
import hashlib
import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from uuid import uuid4

import numpy as np
from PIL import Image

from nunet_models.errors import DataError
from nunet_models.files import read_text
from nunet_models.rendering.intrinsics import Intrinsics

COLUMNS = ("id", "fx", "fy", "cx", "cy", "width", "height", "sensor", "scene")
INTRINSICS = "intrinsics.csv"
VIEWS = "views.csv"
VIEW_COLUMNS = ("id", "kind", "height_m", "pitch_deg", "roll_deg")
MAX_DEPTH_MM = 65535


@dataclass(frozen=True)
class Rendered:
    """One image with its truth, ready to be written."""

    rgb: Image.Image
    depth_m: np.ndarray
    """`[H, W]`, meters along the optical axis, NaN = none."""
    labels: np.ndarray
    """`[H, W]`, uint8, 255 = none."""
    intrinsics: Intrinsics
    quality: int


@dataclass(frozen=True)
class Placement:
    """How a camera stands: the kind of view, height above the floor, angles (up and clockwise)."""

    kind: str
    height_m: float
    pitch_deg: float
    roll_deg: float


class RoomsFolder:
    """A folder of rendered rooms that an interrupted run continues.

    A room is complete once its rows are in `intrinsics.csv`; they are written after its images.
    """

    def __init__(self, path: Path, test_share: float) -> None:
        self.path = path
        self.test_share = test_share
        for name in ("rgb", "depth", "labels"):
            (path / name).mkdir(parents=True, exist_ok=True)
        self.rooms = {row["scene"] for row in read_rows(path / INTRINSICS)}

    def is_complete(self, room: str) -> bool:
        """Whether all images of a room are there."""
        return room in self.rooms

    def write_image(self, identity: str, image: Rendered) -> None:
        """Image, depth and labels, each renamed to its final name only when complete."""
        replace_image(self.path / f"rgb/{identity}.jpg", image.rgb, quality=image.quality)
        millimeters = np.nan_to_num(np.rint(image.depth_m * 1000), nan=0)
        depth = Image.fromarray(millimeters.clip(0, MAX_DEPTH_MM).astype(np.uint16))
        for name, plane in (("depth", depth), ("labels", Image.fromarray(image.labels))):
            replace_image(self.path / f"{name}/{identity}.png", plane, compress_level=6)

    def finish_room(
        self, room: str, images: dict[str, tuple[Intrinsics, Placement]], sensor: str
    ) -> None:
        """Add a room's rows to `views.csv` and `intrinsics.csv`, its ids to its split's list."""
        intrinsics, views = [], []
        for name, (c, p) in images.items():
            row = (name, c.fx_px, c.fy_px, c.cx_px, c.cy_px, c.width, c.height, sensor, room)
            intrinsics.append(",".join(map(str, row)))
            views.append(f"{name},{p.kind},{p.height_m:.3f},{p.pitch_deg:.2f},{p.roll_deg:.2f}")
        split = "test" if is_test_room(room, self.test_share) else "train"
        with _locked(self.path):
            append_lines(self.path / f"{split}.txt", list(images))
            append_lines(self.path / VIEWS, views, header=",".join(VIEW_COLUMNS))
            # Last, since a room counts as complete once it is in this table.
            append_lines(self.path / INTRINSICS, intrinsics, header=",".join(COLUMNS))
        self.rooms.add(room)


def is_test_room(room: str, share: float) -> bool:
    """Whether a room is kept for tests. The name decides, so that it never changes."""
    digest = hashlib.sha256(room.encode()).digest()
    return int.from_bytes(digest[:4], "big") / 2**32 < share


def read_rows(path: Path) -> list[dict[str, str]]:
    """The rows of an `intrinsics.csv`; none if the file is not there yet."""
    if not path.exists():
        return []
    reader = csv.reader(io.StringIO(read_text(path, "a table")))
    header = next(reader, [])
    if tuple(header) != COLUMNS:
        raise DataError(
            f"{path}:1: columns are `{','.join(header)}`, expected `{','.join(COLUMNS)}`"
        )
    rows = []
    for number, values in enumerate(reader, 2):
        if len(values) != len(COLUMNS):
            raise DataError(f"{path}:{number}: {len(values)} values, expected {len(COLUMNS)}")
        rows.append(dict(zip(COLUMNS, values, strict=True)))
    return rows


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Several processes may add rooms to one folder, each its own."""
    with (folder / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def append_lines(path: Path, lines: list[str], *, header: str | None = None) -> None:
    """Add lines that are not there yet; the file is replaced as a whole."""
    before = path.read_text().splitlines() if path.exists() else [header] if header else []
    known = set(before)
    text = "\n".join([*before, *(line for line in lines if line not in known)]) + "\n"
    replace_file(path, text.encode())


def replace_file(path: Path, content: bytes) -> None:
    """Write a file under a temporary name and rename it, so that no reader sees a partial file.

    The temporary name is this call's own: several processes may write the same file at once.
    """
    temporary = path.with_name(f".{path.name}.{uuid4().hex}.part")
    try:
        temporary.write_bytes(content)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def keep_file(path: Path, content: bytes) -> None:
    """As `replace_file`, but a file that has this content already stays untouched."""
    if not path.is_file() or path.read_bytes() != content:
        replace_file(path, content)


def replace_image(path: Path, image: Image.Image, **options: int) -> None:
    """Write a JPEG or PNG file as `replace_file` does; `options` are Pillow's."""
    buffer = io.BytesIO()
    image.save(buffer, "JPEG" if path.suffix == ".jpg" else "PNG", **options)
    replace_file(path, buffer.getvalue())
