"""Relief that a network predicts on flat panes: posters, murals, screens, mirrors.

Each pane is measured twice: as it is, and gray. What differs is made by what the pane shows.
"""

import csv
import io
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.ndimage import binary_erosion

from nunet_models.data.pairs import read_rgb
from nunet_models.data.sets.cameras import Pinhole, read_intrinsics
from nunet_models.errors import DataError
from nunet_models.evaluation.compare import Predict
from nunet_models.evaluation.sets import focal_factor
from nunet_models.files import read_text
from nunet_models.rendering.folder import INTRINSICS, VIEWS
from nunet_models.rendering.panes import PANES, PLAIN
from nunet_models.zoo.spec import Camera

EDGE_PX = 3  # depth is soft at a pane's edge
MIN_PIXELS = 200
PERCENTILES = (5, 95)
METRICS = ("relief_m", "plain_relief_m", "added_m", "change_m")


@dataclass(frozen=True)
class FlatImage:
    """An image with a pane, the same with a gray pane, and the pane's mask `[H, W]`."""

    id: str
    kind: str
    camera: Pinhole
    rgb: np.ndarray
    plain: np.ndarray
    pane: np.ndarray


class FlatImages:
    """The folder that `render --flat-images` writes.

    # Errors
    `DataError` naming a file that is missing or has another size.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        rows = read_intrinsics(root / INTRINSICS)
        self.cameras = {name: row.camera for name, row in rows.items()}
        self.kinds = _kinds(root / VIEWS)
        missing = sorted(self.cameras.keys() - self.kinds.keys())
        if missing:
            raise DataError(f"`{root / VIEWS}` has no row of image `{missing[0]}`")
        self.ids = sorted(self.cameras)

    def __len__(self) -> int:
        """How many images."""
        return len(self.ids)

    def __getitem__(self, index: int) -> FlatImage:
        """Read one image."""
        name = self.ids[index]
        rgb = read_rgb(self.root / f"rgb/{name}.jpg")
        plain = read_rgb(self.root / f"{PLAIN}/{name}.jpg")
        path = self.root / f"{PANES}/{name}.png"
        try:
            pane = np.asarray(Image.open(path).convert("L")) > 0
        except OSError as error:
            raise DataError(f"cannot read `{path}`: {error}") from error
        if not rgb.shape[:2] == plain.shape[:2] == pane.shape:
            raise DataError(
                f"image `{name}` is {rgb.shape[:2]}, with a gray pane {plain.shape[:2]}, and its "
                f"pane {pane.shape}; expected one size"
            )
        return FlatImage(name, self.kinds[name], self.cameras[name], rgb, plain, pane)


def _kinds(path: Path) -> dict[str, str]:
    if not path.is_file():
        raise DataError(
            f"cannot read `{path}`: no such file", hint="`render --flat-images` writes this folder"
        )
    rows = csv.DictReader(io.StringIO(read_text(path, "a table")))
    return {row["id"]: row["kind"] for row in rows}


def relief(depth_m: np.ndarray, pane: np.ndarray) -> float:
    """How far depth `[H, W]` in `pane` is from a plane, in meters.

    The inverse depth of a plane is linear in the pixels. The linear function that fits best is
    subtracted; the result is the range from the 5th to the 95th percentile of what remains, in
    meters along the optical axis. Neither the plane's distance nor its angle counts.
    """
    rows, columns = np.nonzero(pane)
    z = depth_m[pane].astype(np.float64)
    terms = np.stack([columns, rows, np.ones(len(rows))], axis=1)
    fitted = terms @ np.linalg.lstsq(terms, 1.0 / z, rcond=None)[0]
    away = z - 1.0 / np.maximum(fitted, 1.0 / z.max() / 2.0)
    low, high = np.percentile(away, PERCENTILES)
    return float(high - low)


def pane_metrics(image: FlatImage, predict: Predict, training: Camera) -> dict[str, float]:
    """`METRICS` of one image; empty if too little of the pane is visible."""
    factor = np.float32(focal_factor(image.camera, training))
    shown, plain = (predict(rgb).depth * factor for rgb in (image.rgb, image.plain))
    pane = binary_erosion(image.pane, iterations=EDGE_PX)
    pane &= np.isfinite(shown) & np.isfinite(plain)
    if pane.sum() < MIN_PIXELS:
        return {}
    with_image, gray = relief(shown, pane), relief(plain, pane)
    change = float(np.abs(shown[pane] - plain[pane]).mean())
    values = (with_image, gray, with_image - gray, change)
    return dict(zip(METRICS, values, strict=True))


def means_by_kind(rows: Sequence[Mapping[str, str | float]]) -> dict[str, dict[str, float]]:
    """Mean of each metric and the number of panes, by kind and of `all`."""
    groups: dict[str, list[Mapping[str, str | float]]] = defaultdict(list)
    for row in rows:
        groups[str(row["kind"])].append(row)
    groups["all"] = list(rows)
    return {
        kind: {
            "panes": len(each),
            **{name: float(np.mean([row[name] for row in each])) for name in METRICS},
        }
        for kind, each in groups.items()
    }
