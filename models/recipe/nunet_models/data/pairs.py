"""Pictures with depth and labels, wherever they come from."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from PIL import Image, UnidentifiedImageError

from nunet_models.classes import IGNORE, labels13_from_labels40
from nunet_models.errors import DataError

RGB_SUFFIXES = (".jpg", ".jpeg", ".png")
MILLIMETRE_M = 0.001  # unit of 16-bit depth pictures unless told otherwise
NO_DEPTH = 65535  # written by sensors that measured nothing, besides 0: 7-Scenes has both


@dataclass(frozen=True)
class Pair:
    """One picture with its truth.

    `rgb` uint8 `[H, W, 3]`; `depth_m` float32 `[H, W]`, metres, NaN where there is no
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
    """Everything that decides what `__getitem__` gives: another identity, other pairs."""

    def __len__(self) -> int:
        """How many pairs."""
        ...

    def __getitem__(self, index: int) -> Pair:
        """Read pair `index`; `DataError` names the file that cannot be read."""
        ...


@dataclass(frozen=True)
class DepthUnits:
    """How the numbers of a depth picture become metres: `(value + offset) * scale_m`.

    0 is no measurement where `zero_is_none`, 65535 never is one.
    """

    scale_m: float = MILLIMETRE_M
    offset: float = 0.0
    zero_is_none: bool = True

    def metres(self, values: np.ndarray) -> np.ndarray:
        """Picture values (integers, any shape) to float32 metres, NaN = none."""
        depth = ((values.astype(np.float64) + self.offset) * self.scale_m).astype(np.float32)
        if self.zero_is_none:
            depth[values == 0] = np.nan
        depth[values == NO_DEPTH] = np.nan
        return depth


class FolderPairs:
    """A folder with `rgb/ID.jpg|png`, `depth/ID.png` and, perhaps, `label40/ID.png`.

    `window` is (top, left, bottom, right) in pixels: outside of it depth and labels count as
    none, for data with a frame around each picture.
    """

    def __init__(
        self,
        root: Path,
        ids: Sequence[str],
        *,
        units: DepthUnits,
        window: tuple[int, int, int, int] | None = None,
    ) -> None:
        self.root = root
        self.ids = ids
        self.units = units
        self.window = window
        self.has_labels = (root / "label40").is_dir()
        self.description = f"{root.name}, {len(ids)} pictures"
        missing = [p for i in ids for p in self._paths(i) if not p.is_file()]
        if missing:
            raise DataError(
                f"`{missing[0]}` is missing, and {len(missing) - 1} more of {len(ids)} pairs' files"
            )
        newest = max(p.stat().st_mtime_ns for i in ids for p in self._paths(i))
        self.identity = f"{root.resolve()} {units} {window} {self.has_labels} {newest}"

    def __len__(self) -> int:
        """How many pairs."""
        return len(self.ids)

    def __getitem__(self, index: int) -> Pair:
        """Read one pair.

        # Errors
        `DataError` naming the file that is corrupt or of another size than its picture.
        """
        identity = self.ids[index]
        rgb_path, depth_path, *label_path = self._paths(identity)
        rgb = read_rgb(rgb_path)
        depth_m = self.units.metres(_single_channel(depth_path, rgb.shape[:2]))
        labels = None
        if label_path:
            labels = labels13_from_labels40(_single_channel(label_path[0], rgb.shape[:2]))
        return Pair(identity, rgb, *blank_outside(depth_m, labels, self.window))

    def _paths(self, identity: str) -> list[Path]:
        candidates = [self.root / "rgb" / f"{identity}{suffix}" for suffix in RGB_SUFFIXES]
        rgb = next((p for p in candidates if p.is_file()), candidates[0])
        paths = [rgb, self.root / "depth" / f"{identity}.png"]
        return paths + [self.root / "label40" / f"{identity}.png"] * self.has_labels


def read_ids(path: Path) -> list[str]:
    """Ids of a list file, one a line; blank lines are allowed, repeated ids are not."""
    ids = path.read_text(encoding="utf-8").split()
    if not ids:
        raise DataError(f"`{path}` holds no ids")
    if len(set(ids)) != len(ids):
        raise DataError(f"`{path}` names an id twice")
    return ids


def blank_outside(
    depth_m: np.ndarray,
    labels: np.ndarray | None,
    window: tuple[int, int, int, int] | None,
) -> tuple[np.ndarray, np.ndarray | None]:
    """Depth and labels `[H, W]` with no truth outside of `window` (top, left, bottom, right)."""
    if window is None:
        return depth_m, labels
    top, left, bottom, right = window
    outside = np.ones(depth_m.shape, dtype=bool)
    outside[top:bottom, left:right] = False
    depth_m[outside] = np.nan
    if labels is not None:
        labels[outside] = IGNORE
    return depth_m, labels


def read_rgb(path: Path) -> np.ndarray:
    """A picture's colours, uint8 `[H, W, 3]`.

    # Errors
    `DataError` naming a file that is no picture.
    """
    return np.array(_open(path).convert("RGB"))


def _open(path: Path) -> Image.Image:
    try:
        image = Image.open(path)
        image.load()
    except (UnidentifiedImageError, OSError, SyntaxError) as error:
        raise DataError(f"`{path}` cannot be read as a picture: {error}") from error
    return image


def _single_channel(path: Path, size: tuple[int, int]) -> np.ndarray:
    values = np.array(_open(path))
    if values.ndim != 2:
        raise DataError(f"`{path}` has {values.shape[-1]} channels; expected one")
    if values.shape != size:
        raise DataError(f"`{path}` is {values.shape}, but its colour picture is {size}")
    return values
