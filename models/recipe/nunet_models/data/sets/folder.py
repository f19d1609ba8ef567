"""The images of one set: color, depth after the sensor's masks, labels, intrinsics and scene."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nunet_models.data.pairs import (
    RGB_SUFFIXES,
    DepthUnits,
    FolderPairs,
    Pair,
    list_of_lines,
)
from nunet_models.data.sets import masks
from nunet_models.data.sets.cameras import Pinhole, Row, read_intrinsics
from nunet_models.data.sets.entry import SetEntry
from nunet_models.errors import DataError

MEDIAN_LIMIT_M = 20.0
"""No room is so deep that the median of an image lies beyond: the unit is another one."""
PROBED = 4  # images of each set that are read at the start, to find a wrong unit or size


@dataclass(frozen=True)
class CameraImage:
    """An image with its truth (see `Pair`), its camera and its room."""

    pair: Pair
    camera: Pinhole
    window: tuple[int, int, int, int]
    """Top, left, bottom, right of the part that shows the scene."""
    room: str


class CameraSet:
    """The images of one `SetEntry`, read one at a time.

    # Errors
    `DataError` with file and line for missing files or intrinsics, images of another size than
    their intrinsics, and a unit of depth that puts the median beyond `MEDIAN_LIMIT_M`.
    """

    def __init__(self, entry: SetEntry) -> None:
        self.entry = entry
        if not entry.root.is_dir():
            raise entry.error(f"`{entry.root}` is not a folder")
        self.rows = self._rows()
        ids = self._scenes_only(self._ids())
        if entry.limit is not None and len(ids) > entry.limit:
            ids = [ids[i] for i in np.linspace(0, len(ids) - 1, entry.limit).astype(int)]
        if not ids and not entry.growing:
            raise entry.error("no image is left of it")
        units = DepthUnits(
            entry.depth_scale, entry.depth_offset, zero_is_none=entry.depth_offset == 0.0
        )
        window = tuple(entry.window) if entry.window else None
        try:
            self.pairs = FolderPairs(entry.root, ids, units=units, window=window)
        except DataError as error:
            raise entry.error(str(error), hint=error.hint) from error
        self.ids = ids
        self.has_labels = self.pairs.has_labels
        for index in np.linspace(0, len(ids) - 1, min(PROBED, len(ids))).astype(int):
            self._check_unit(self[int(index)])

    def __len__(self) -> int:
        """How many images."""
        return len(self.ids)

    def __getitem__(self, index: int) -> CameraImage:
        """Read image `index`; `DataError` names what is wrong with it."""
        entry, row = self.entry, self.rows[self.ids[index]]
        try:
            pair = self.pairs[index]
        except DataError as error:
            raise entry.error(str(error), hint=error.hint) from error
        height, width = pair.depth_m.shape
        if (width, height) != (row.camera.width, row.camera.height):
            raise DataError(
                f"{row.where}: image `{pair.id}` of `{entry.root}` is {width}x{height}, but its "
                f"intrinsics are for {row.camera.width}x{row.camera.height}"
            )
        depth = masks.in_range(pair.depth_m, *entry.depth_range)
        if entry.edge_erosion:
            depth = masks.without_edges(depth, entry.edge_erosion)
        if entry.sparse:
            depth = masks.spread_sparse(depth)
        window = tuple(entry.window or (0, 0, height, width))
        pair = Pair(pair.id, pair.rgb, depth, pair.labels)
        return CameraImage(pair, row.camera, window, self.room(index))

    def room(self, index: int) -> str:
        """The room of image `index`: its scene, or the set as a whole."""
        return self.rows[self.ids[index]].scene

    def room_weights(self) -> np.ndarray:
        """How often each image is drawn, relative to the others of the list.

        The images of a room share the room's weight.
        """
        entry = self.entry
        counts = Counter(self.room(i) for i in range(len(self)))
        scenes = len(counts) > 1 or "" not in counts
        rooms = 1 if scenes else entry.rooms
        shares = [entry.weight * rooms / counts[self.room(i)] for i in range(len(self))]
        return np.array(shares, dtype=np.float64)

    def _ids(self) -> list[str]:
        entry = self.entry
        if entry.ids is not None:
            listed = list_of_lines(entry.ids)
            if entry.growing:
                return [i for i in listed if i in self.rows and self._whole(i)]
            for identity, line in listed.items():
                self._require_row(identity, f"{entry.ids}:{line}")
            return list(listed)
        rgb = entry.root / "rgb"
        if not rgb.is_dir():
            raise entry.error(f"`{entry.root}` has no folder `rgb`")
        found = sorted(p.stem for p in rgb.iterdir() if p.suffix.lower() in RGB_SUFFIXES)
        if entry.growing:
            return [i for i in found if i in self.rows and self._whole(i)]
        for identity in found:
            self._require_row(identity, entry.where)
        return found

    def _require_row(self, identity: str, where: str) -> None:
        if identity not in self.rows:
            raise DataError(
                f"{where}: image `{identity}` has no row in `{self.entry.root}/intrinsics.csv`"
            )

    def _whole(self, identity: str) -> bool:
        depth = self.entry.root / "depth" / f"{identity}.png"
        return depth.is_file() and depth.stat().st_size > 0

    def _rows(self) -> dict[str, Row]:
        entry = self.entry
        if entry.intrinsics is None:
            return read_intrinsics(entry.root / "intrinsics.csv", growing=entry.growing)
        camera = Pinhole.parse(entry.intrinsics)
        if camera is None:
            raise entry.error(f"`intrinsics` is `{entry.intrinsics}`, expected fx,fy,cx,cy@WxH")
        if entry.scenes or entry.except_scenes:
            raise entry.error("scenes are in `intrinsics.csv`, but the set has `intrinsics`")
        return _Everything(Row(camera, where=entry.where))

    def _scenes_only(self, ids: Sequence[str]) -> list[str]:
        entry = self.entry
        known = {row.scene for row in self.rows.values()}
        for scene in (*entry.scenes, *entry.except_scenes):
            if scene not in known:
                raise entry.error(f"no scene `{scene}`; expected one of {', '.join(sorted(known))}")
        kept = [i for i in ids if not entry.scenes or self.rows[i].scene in entry.scenes]
        return [i for i in kept if self.rows[i].scene not in entry.except_scenes]

    def _check_unit(self, image: CameraImage) -> None:
        known = image.pair.depth_m[np.isfinite(image.pair.depth_m)]
        if self.entry.depth_range[1] < math.inf:  # computed from the sensor's unmasked depth
            known = self.pairs[self.ids.index(image.pair.id)].depth_m
            known = known[np.isfinite(known)]
        if known.size and (median := float(np.median(known))) > MEDIAN_LIMIT_M:
            raise self.entry.error(
                f"the median depth of `{image.pair.id}` is {median:.1f} m, expected at most "
                f"{MEDIAN_LIMIT_M:.0f} m",
                hint="`depth_scale` is the meters per unit",
            )


class _Everything(dict):
    """One row for every id: a set of one camera."""

    def __init__(self, row: Row) -> None:
        super().__init__()
        self.row = row

    def __contains__(self, identity: object) -> bool:
        return True

    def __missing__(self, identity: str) -> Row:
        return self.row

    def values(self) -> list[Row]:
        """The one row."""
        return [self.row]
