"""Decoded images kept as flat arrays on disk, so that epochs need no decoding."""

import hashlib
import json
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Self
from uuid import uuid4

import numpy as np
from tqdm import tqdm

from nunet_models.classes import IGNORE
from nunet_models.data.pairs import Pairs, read_rgb
from nunet_models.errors import DataError

UNIT_M = 0.0002  # of cached depth: rounds to 0.1 mm
REACH_M = np.iinfo(np.uint16).max * UNIT_M  # 13.1 m, past the 12 m that a network can give
NONE = 0  # cached depth where there is no measurement
VERSION = (
    3  # version 1 could be read while another run wrote it; version 2 ignored EXIF orientation
)


@dataclass(frozen=True)
class Cached:
    """All pairs of a collection, memory-mapped.

    `rgb` uint8 `[N, H, W, 3]`, `depth` uint16 `[N, H, W]` in `UNIT_M` with 0 = none, which includes
    depth beyond `REACH_M`, `labels` uint8 `[N, H, W]` with `IGNORE` = none.
    """

    ids: tuple[str, ...]
    rgb: np.ndarray
    depth: np.ndarray
    labels: np.ndarray

    @classmethod
    def of_image(cls, path: Path) -> Self:
        """One image without truth.

        # Errors
        `DataError` naming a file that is not an image.
        """
        return cls.of_rgb(path.stem, read_rgb(path))

    @classmethod
    def of_rgb(cls, identity: str, rgb: np.ndarray) -> Self:
        """One image, uint8 `[H, W, 3]`, without truth."""
        size = (1, *rgb.shape[:2])
        labels = np.full(size, IGNORE, np.uint8)
        return cls((identity,), rgb[None], np.full(size, NONE, np.uint16), labels)

    def __len__(self) -> int:
        """How many pairs."""
        return len(self.ids)

    def depth_m(self, index: int) -> np.ndarray:
        """Depth of one pair in meters, float32 `[H, W]`, NaN = none."""
        return meters(self.depth[index])

    @property
    def has_labels(self) -> bool:
        """Whether any pixel of any pair is labeled."""
        return any(bool((image != IGNORE).any()) for image in self.labels)

    @property
    def has_depth(self) -> bool:
        """Whether any pixel of any pair has depth."""
        return any(bool((image != NONE).any()) for image in self.depth)


def meters(cached: np.ndarray) -> np.ndarray:
    """Cached depth (uint16) to float32 meters, NaN = none; same shape."""
    return np.where(cached == NONE, np.float32(np.nan), cached.astype(np.float32) * UNIT_M)


def build_cache(pairs: Pairs, folder: Path, *, quiet: bool = False) -> Cached:
    """Decode `pairs` once under `folder`, or open what an earlier run decoded.

    All images must have one size: batches and evaluation crops depend on it. Any number of runs
    may share `folder`: each decodes into its own temporary folder, and the first to finish wins.
    `quiet` draws no progress bar.
    """
    key = json.dumps([VERSION, pairs.identity, list(pairs.ids)])
    place = folder / hashlib.sha256(key.encode()).hexdigest()[:16]
    if not (place / "done").exists():
        partial = folder / f"{place.name}.{uuid4().hex}"
        partial.mkdir(parents=True)
        try:
            _decode(pairs, partial, quiet=quiet)
            _move(partial, place)
        finally:
            shutil.rmtree(partial, ignore_errors=True)
    far = int((place / "done").read_text(encoding="utf-8"))
    if far:
        print(
            f"{pairs.description}: {far} pixels of depth beyond {REACH_M:.1f} m count as none",
            file=sys.stderr,
        )
    arrays = (np.load(place / f"{name}.npy", mmap_mode="r") for name in ("rgb", "depth", "labels"))
    return Cached(tuple(pairs.ids), *arrays)


def _move(partial: Path, place: Path) -> None:
    """Rename a decoded folder to its final name, unless another run was first."""
    try:
        partial.rename(place)  # replaces an empty folder only
    except OSError:
        if not (place / "done").exists():
            raise


def _decode(pairs: Pairs, place: Path, *, quiet: bool) -> None:
    """Decode into the empty folder `place`; its file `done` counts the pixels that are too far."""
    height, width = pairs[0].depth_m.shape
    shape = (len(pairs), height, width)

    def array(name: str, dtype: type, shape: tuple[int, ...]) -> np.ndarray:
        return np.lib.format.open_memmap(place / f"{name}.npy", "w+", dtype, shape)

    rgb = array("rgb", np.uint8, (*shape, 3))
    depth = array("depth", np.uint16, shape)
    labels = array("labels", np.uint8, shape)
    far = 0
    what = f"decoding {pairs.description}"
    for index in tqdm(range(len(pairs)), desc=what, unit="image", disable=quiet):
        pair = pairs[index]
        if pair.depth_m.shape != (height, width):
            raise DataError(
                f"image `{pair.id}` is {pair.depth_m.shape}, the first one {(height, width)}",
                hint="resize the data to one size first",
            )
        rgb[index] = pair.rgb
        units = np.rint(np.nan_to_num(pair.depth_m, nan=0.0) / UNIT_M)
        beyond = units > np.iinfo(np.uint16).max
        far += int(beyond.sum())
        depth[index] = np.where(beyond, NONE, units.clip(min=NONE))
        labels[index] = IGNORE if pair.labels is None else pair.labels
    for array in (rgb, depth, labels):
        array.flush()
    (place / "done").write_text(str(far), encoding="utf-8")
