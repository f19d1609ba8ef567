"""Surface normals: truth from depth and the camera, loss, and error in degrees.

Normals are unit vectors in the camera's frame (x right, y down, z forward) that face the camera: a
wall straight ahead has (0, 0, -1).
"""

from itertools import product

import torch
import torch.nn.functional as F

from nunet_models.data.batches import Batch
from nunet_models.zoo.spec import GraphSpec

REACH = 3
"""Pixels around each one whose depth counts: 7x7 of the inner image."""

STEP = 0.1
"""Relative difference of inverse depth beyond which a neighbor is on another surface."""

LEAST_NEIGHBORS = 16
LEAST_SPREAD = 0.25  # of them, in square pixels: those of a single row have no normal

WITHIN_DEG = {"within_11": 11.25, "within_22": 22.5, "within_30": 30.0}


def surface_normals(depth_m: torch.Tensor, focal: tuple[float, float]) -> torch.Tensor:
    """Depth float32 `[B, 1, h, w]` (NaN = none) to unit normals `[B, 3, h, w]` (NaN = none).

    `focal` is (fx, fy) in pixels of `depth_m`. The inverse depth q of a plane is linear in the
    image, so its normal is proportional to `(fx q_u, fy q_v, q - (u - cx) q_u - (v - cy) q_v)`
    (Fan et al., "Three-filters-to-normal", 2021, for the first two). q and its slopes come from
    the plane of least squares through the neighbors on the same surface.

    The principal point is the center of the image, as the network, which sees crops of images,
    must assume.
    """
    inverse = depth_m.float().reciprocal()
    height, width = inverse.shape[2:]
    a, b, c = _planes(inverse)
    u = torch.arange(width, dtype=torch.float32) - (width - 1) / 2
    v = (torch.arange(height, dtype=torch.float32) - (height - 1) / 2)[:, None]
    toward = -torch.cat([focal[0] * a, focal[1] * b, inverse + c - u * a - v * b], dim=1)
    return F.normalize(toward, dim=1)


def _planes(inverse: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """The plane `a x + b y + c` of least squares about each pixel, all `[B, 1, h, w]`, NaN = none.

    x and y are pixels from the pixel itself; the plane is of the difference to its value.
    """
    height, width = inverse.shape[2:]
    padded = F.pad(inverse, (REACH,) * 4, value=torch.nan)
    n, x, y, xx, xy, yy, s, xs, ys = torch.zeros(9, *inverse.shape)
    for dy, dx in product(range(-REACH, REACH + 1), repeat=2):
        top, left = REACH + dy, REACH + dx
        step = padded[..., top : top + height, left : left + width] - inverse
        same = (step.abs() <= STEP * inverse).float()  # 0 for NaN
        step = torch.where(same > 0.0, step, 0.0)
        for total, factor in (
            (n, 1),
            (x, dx),
            (y, dy),
            (xx, dx * dx),
            (xy, dx * dy),
            (yy, dy * dy),
        ):
            total.add_(same, alpha=factor)
        for total, factor in ((s, 1), (xs, dx), (ys, dy)):
            total.add_(step, alpha=factor)
    n = n.where(n >= LEAST_NEIGHBORS, torch.nan)
    x, y, s = x / n, y / n, s / n
    xx, xy, yy = xx / n - x * x, xy / n - x * y, yy / n - y * y
    xs, ys = xs / n - x * s, ys / n - y * s
    area = xx * yy - xy * xy
    area = area.where(area >= LEAST_SPREAD, torch.nan)
    a, b = (yy * xs - xy * ys) / area, (xx * ys - xy * xs) / area
    return a, b, s - a * x - b * y


def _truth(batch: Batch, spec: GraphSpec) -> torch.Tensor:
    """Normals of a batch, whose depth is for the training camera at the inner size."""
    camera, (height, width) = spec.camera, spec.inner_size
    focal = camera.fx * width / camera.width, camera.fy * height / camera.height
    return surface_normals(batch.depth_m, focal)


class Normals:
    """The task `normals`: three channels, the normal's x, y and z.

    The next component reads the raw vectors; they are shorter where the network is less certain.
    """

    needs = "depth"

    def loss(self, raw: torch.Tensor, batch: Batch, spec: GraphSpec) -> torch.Tensor:
        """Mean of `|r - n|^2 / 2`, which is `1 - cosine` where r has unit length.

        The dot product alone (Eigen and Fergus, "Predicting depth, surface normals and semantic
        labels with a common multi-scale convolutional architecture", 2015) would leave
        the length of r free, and the next component reads r.
        """
        truth = _truth(batch, spec)
        known = truth.isfinite().all(dim=1, keepdim=True)
        error = torch.where(known, raw.float() - truth, 0.0)
        return 0.5 * error.square().sum() / known.sum().clamp(min=1)

    def metrics(self, spec: GraphSpec) -> "NormalMetrics":
        """Angular errors of nothing yet."""
        return NormalMetrics(spec)

    def score(self, metrics: dict[str, float]) -> float:
        """Negative mean angular error."""
        return -metrics["angle_deg"]

    def shown(self, raw: torch.Tensor) -> torch.Tensor:
        """How much the surface faces the camera: 1 straight ahead, 0 for one seen along it."""
        return -F.normalize(raw.float(), dim=1)[:, 2:].clamp(-1.0, 0.0)


class NormalMetrics:
    """Angles between predicted and true normals, pooled over all pixels that have truth."""

    def __init__(self, spec: GraphSpec) -> None:
        self.spec = spec
        self.pixels = 0
        self.sums = dict.fromkeys(("angle_deg", *WITHIN_DEG), 0.0)

    def add(self, raw: torch.Tensor, batch: Batch) -> None:
        """Count a batch of raw vectors `[B, 3, h, w]`."""
        truth = _truth(batch, self.spec)
        cosine = (F.normalize(raw.float(), dim=1) * truth).sum(dim=1)
        cosine = cosine[cosine.isfinite()].double().clamp(-1.0, 1.0)
        angle = cosine.arccos().rad2deg()
        self.pixels += angle.numel()
        self.sums["angle_deg"] += float(angle.sum())
        for name, limit in WITHIN_DEG.items():
            self.sums[name] += int((angle < limit).sum())

    def values(self) -> dict[str, float]:
        """`angle_deg`: mean angle; `within_11`, ...: share of pixels below 11.25, 22.5, 30 degrees.

        As in Fouhey, Gupta and Hebert, "Data-driven 3D primitives for single image understanding",
        2013.
        """
        return {name: total / self.pixels for name, total in self.sums.items() if self.pixels}
