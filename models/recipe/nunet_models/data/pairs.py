"""Images with depth and labels, from folders and other sources."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from PIL import Image, ImageOps, UnidentifiedImageError

from nunet_models.classes import CLASSES_13, IGNORE, labels13_from_labels40
from nunet_models.errors import DataError
from nunet_models.files import read_text

RGB_SUFFIXES = (".jpg", ".jpeg", ".png")
SIXTEEN_TO_EIGHT = 257  # 65535 / 255
LABEL_FOLDERS = {"labels": len(CLASSES_13), "label40": 40}
"""Number of classes by label folder; the first folder that exists is used, as in nunetd."""
MILLIMETER_M = 0.001  # default unit of 16-bit depth images
NO_DEPTH = 65535  # some sensors write this and some 0 for no measurement; 7-Scenes has both


@dataclass(frozen=True)
class Pair:
    """One image with its truth.

    `rgb` uint8 `[H, W, 3]`; `depth_m` float32 `[H, W]`, meters, NaN where there is no
    measurement; `labels` uint8 `[H, W]`, `IGNORE` where nothing is known, or None.
    """

    id: str
    rgb: np.ndarray
    depth_m: np.ndarray
    labels: np.ndarray | None


class Pairs(Protocol):
    """A collection of pairs, read one at a time."""

    ids: Sequence[str]
    description: str
    identity: str
    """Text that identifies the pairs: it differs if `__getitem__` would return others."""
    has_labels: bool

    def __len__(self) -> int:
        """How many pairs."""
        ...

    def __getitem__(self, index: int) -> Pair:
        """Read pair `index`; `DataError` names the file that cannot be read."""
        ...


@dataclass(frozen=True)
class DepthUnits:
    """How the numbers of a depth image become meters: `(value + offset) * scale_m`.

    0 is no measurement where `zero_is_none`, 65535 never is one. Without a `scale_m` 16 bits are
    millimeters, and images of 8 bits are refused.
    """

    scale_m: float | None = None
    offset: float = 0.0
    zero_is_none: bool = True

    def meters(self, values: np.ndarray) -> np.ndarray:
        """Image values (integers, any shape) to float32 meters, NaN = none."""
        scale_m = MILLIMETER_M if self.scale_m is None else self.scale_m
        depth = ((values.astype(np.float64) + self.offset) * scale_m).astype(np.float32)
        if self.zero_is_none:
            depth[values == 0] = np.nan
        depth[values == NO_DEPTH] = np.nan
        return depth


class FolderPairs:
    """A folder with `rgb/ID.jpg|png`, `depth/ID.png` and, perhaps, labels.

    They are `labels/ID.png` of the 13 classes or `label40/ID.png` of NYU's 40, both from 0, with
    `IGNORE` where nothing is known.
    `window` is (top, left, bottom, right) in pixels: outside of it depth and labels count as
    none, for data with a frame around each image.
    """

    def __init__(
        self,
        root: Path,
        ids: Sequence[str],
        *,
        units: DepthUnits,
        window: tuple[int, int, int, int] | None = None,
    ) -> None:
        if not root.is_dir():
            raise DataError(
                f"`{root}` is not a folder; expected one with `rgb/` and `depth/`, or NYU Depth "
                "V2's .mat file",
                hint="check `--data`",
            )
        self.root = root
        self.ids = ids
        self.units = units
        self.window = window
        self.label_folder = next((name for name in LABEL_FOLDERS if (root / name).is_dir()), None)
        self.has_labels = self.label_folder is not None
        self.description = f"{root.name}, {len(ids)} images"
        missing = [p for i in ids for p in self._paths(i) if not p.is_file()]
        if missing:
            files = sum(len(self._paths(i)) for i in ids)
            more = f", and {len(missing) - 1} more of the {files} files of {len(ids)} pairs"
            more = more if len(missing) > 1 else ""
            raise DataError(f"`{missing[0]}` is missing{more}")
        state = file_state([p for i in ids for p in self._paths(i)])
        self.identity = f"{root.resolve()} {units} {window} {self.label_folder} {state}"

    def __len__(self) -> int:
        """How many pairs."""
        return len(self.ids)

    def __getitem__(self, index: int) -> Pair:
        """Read one pair.

        # Errors
        `DataError` naming the file that is corrupt or of another size than its image.
        """
        identity = self.ids[index]
        rgb_path, depth_path, *label_path = self._paths(identity)
        rgb = read_rgb(rgb_path)
        depth = _single_channel(depth_path, rgb.shape[:2])
        if depth.dtype == np.uint8 and self.units.scale_m is None:
            raise DataError(
                f"`{depth_path}` has 8 bits, which cannot be millimeters",
                hint="`--depth-scale METERS` sets the unit",
            )
        depth_m = self.units.meters(depth)
        labels = self._labels(label_path[0], rgb.shape[:2]) if label_path else None
        known = blank_outside(depth_m, labels, self.window, of=str(depth_path))
        return Pair(identity, rgb, *known)

    def _paths(self, identity: str) -> list[Path]:
        folders = ["depth", *([self.label_folder] if self.label_folder else [])]
        return [
            self._path("rgb", identity, RGB_SUFFIXES),
            *(self._path(folder, identity, (".png",)) for folder in folders),
        ]

    def _path(self, folder: str, identity: str, suffixes: Sequence[str]) -> Path:
        """The image's file, or its expected name if none exists; endings may be in capitals.

        # Errors
        `DataError` naming both of two files.
        """
        names = [identity + ending for suffix in suffixes for ending in (suffix, suffix.upper())]
        paths = [self.root / folder / name for name in names]
        first, *others = [path for path in paths if path.is_file()] or paths[:1]
        for other in others:
            if not other.samefile(first):
                raise DataError(
                    f"`{first}` and `{other}` are two files of one image",
                    hint="remove one of them",
                )
        return first

    def _labels(self, path: Path, size: tuple[int, int]) -> np.ndarray:
        values = _single_channel(path, size)
        _check_labels(values, path, folder=self.label_folder)
        values = values.astype(np.uint8)
        return labels13_from_labels40(values) if self.label_folder == "label40" else values


def _check_labels(values: np.ndarray, path: Path, *, folder: str) -> None:
    """Refuse numbers that are not a class. Skipping them would hide a wrong unit or class list."""
    classes = LABEL_FOLDERS[folder]
    wrong = values[(values >= classes) & (values != IGNORE)]
    if not wrong.size:
        return
    worst = int(wrong.max())
    hint = f"`{IGNORE}` means unknown"
    if worst <= LABEL_FOLDERS["label40"]:
        hint = "NYU's 40 classes belong in `label40/`"
        if folder == "label40":
            hint = "`label40/` counts NYU's classes from 0, 0 is a wall"
    raise DataError(
        f"`{path}` has the label {worst}; expected 0 to {classes - 1}, or {IGNORE} for unknown",
        hint=f"{hint}",
    )


def file_state(paths: Sequence[Path]) -> str:
    """A text that changes when the size or time of any file changes.

    The newest time alone is not enough: a replaced file may be older.
    """
    known = [path.stat() for path in paths]
    size, times = sum(s.st_size for s in known), sum(s.st_mtime_ns for s in known)
    return f"{len(known)} files, {size} bytes, {times} ns"


def read_ids(path: Path) -> list[str]:
    """Ids of a list file in UTF-8, one per line; blank lines are allowed, repeated ids are not.

    # Errors
    `DataError` naming a file that is missing or is not such a list.
    """
    return list(list_of_lines(path))


def list_of_lines(path: Path) -> dict[str, int]:
    """The line of each id in a list, counted from 1, in the order of the file."""
    if not path.is_file():
        what = "is not a file" if path.exists() else "is missing"
        raise DataError(f"`{path}` {what}; expected a list of ids, one per line")
    lines = read_text(path, "a list of ids").split("\n")
    named = [(line.strip(), number) for number, line in enumerate(lines, 1) if line.strip()]
    if not named:
        raise DataError(f"`{path}` holds no ids")
    if len(ids := dict(named)) != len(named):
        raise DataError(f"`{path}` names an id twice")
    return ids


def blank_outside(
    depth_m: np.ndarray,
    labels: np.ndarray | None,
    window: tuple[int, int, int, int] | None,
    *,
    of: str,
) -> tuple[np.ndarray, np.ndarray | None]:
    """Depth and labels `[H, W]` with no truth outside of `window` (top, left, bottom, right).

    # Errors
    `DataError` naming the image, `of`, of which nothing would be left.
    """
    if window is None:
        return depth_m, labels
    top, left, bottom, right = window
    if not depth_m[top:bottom, left:right].size:
        height, width = depth_m.shape
        raise DataError(
            f"`--window {top},{left},{bottom},{right}` leaves nothing of `{of}`, which has "
            f"{height} rows and {width} columns"
        )
    outside = np.ones(depth_m.shape, dtype=bool)
    outside[top:bottom, left:right] = False
    depth_m[outside] = np.nan
    if labels is not None:
        labels[outside] = IGNORE
    return depth_m, labels


def read_rgb(path: Path) -> np.ndarray:
    """An image's colors, uint8 `[H, W, 3]`; 16 bits per channel are rounded to 8.

    It is rotated by its EXIF orientation, as in nunetd: depth and labels have that orientation.

    # Errors
    `DataError` naming a file that is not an image.
    """
    image = _upright(_open(path))
    if not image.mode.startswith("I"):
        return np.array(image.convert("RGB"))
    # 16 bits of gray, which PIL would clip at 255
    gray = (np.array(image).astype(np.int64) + SIXTEEN_TO_EIGHT // 2) // SIXTEEN_TO_EIGHT
    return np.repeat(gray.clip(0, 255).astype(np.uint8)[..., None], 3, axis=2)


def _open(path: Path) -> Image.Image:
    try:
        image = Image.open(path)
        image.load()
    except (UnidentifiedImageError, OSError, SyntaxError) as error:
        raise DataError(f"`{path}` cannot be read as an image: {error}") from error
    return image


def _upright(image: Image.Image) -> Image.Image:
    """Rotated by its EXIF orientation; unreadable EXIF data is ignored."""
    try:
        return ImageOps.exif_transpose(image)
    except Exception:  # PIL raises errors of many types for a damaged block
        return image


def _single_channel(path: Path, size: tuple[int, int]) -> np.ndarray:
    """Whole numbers `[H, W]`."""
    values = np.array(_open(path))
    if values.ndim != 2:
        raise DataError(f"`{path}` has {values.shape[-1]} channels; expected one")
    if values.dtype.kind not in "iu":
        kind = "1 bit" if values.dtype == np.bool_ else values.dtype
        raise DataError(f"`{path}` has {kind} per pixel; expected whole numbers of 8 or 16 bits")
    if values.shape != size:
        raise DataError(f"`{path}` is {values.shape}, but its color image is {size}")
    return values
