"""Pinhole cameras: fixed ones, and random ones as users own them. Needs no Blender."""

from __future__ import annotations

import math
from dataclasses import dataclass
from random import Random

import numpy as np

IMAGE_SIZES = ((320, 240), (320, 240), (320, 240), (320, 180), (240, 240))
"""Width and height; a size that is listed more often is drawn more often."""

HFOV_DEG = (45.0, 110.0)
"""Range of the horizontal field of view."""


@dataclass(frozen=True)
class Intrinsics:
    """A pinhole camera; centers of pixels lie at whole numbers."""

    fx_px: float = 518.858
    fy_px: float = 519.470
    cx_px: float = 325.582
    cy_px: float = 253.736
    width: int = 640
    height: int = 480

    def scaled(self, factor: float) -> Intrinsics:
        """The same camera with another image size."""
        return Intrinsics(
            self.fx_px * factor,
            self.fy_px * factor,
            (self.cx_px + 0.5) * factor - 0.5,
            (self.cy_px + 0.5) * factor - 0.5,
            round(self.width * factor),
            round(self.height * factor),
        )

    def project(self, point: np.ndarray) -> tuple[float, float]:
        """Column and row of a point in the camera's frame (x right, y down, z ahead)."""
        x, y, z = point
        return self.fx_px * x / z + self.cx_px, self.fy_px * y / z + self.cy_px

    @property
    def hfov_deg(self) -> float:
        """Horizontal field of view."""
        left = math.atan((self.cx_px + 0.5) / self.fx_px)
        right = math.atan((self.width - self.cx_px - 0.5) / self.fx_px)
        return math.degrees(left + right)


def random_intrinsics(random: Random) -> Intrinsics:
    """A camera with a field of view in `HFOV_DEG` and a principal point near the image's center."""
    width, height = random.choice(IMAGE_SIZES)
    # Most cameras have 55 to 90 degrees; the mode of the triangle is in the middle of these.
    hfov_deg = random.triangular(*HFOV_DEG, 68.0)
    fx_px = width / 2 / math.tan(math.radians(hfov_deg) / 2)
    cx_px = width / 2 - 0.5 + random.uniform(-0.01, 0.01) * width
    cy_px = height / 2 - 0.5 + random.uniform(-0.02, 0.02) * height
    fy_px = fx_px * random.uniform(0.995, 1.005)
    return Intrinsics(*(round(v, 3) for v in (fx_px, fy_px, cx_px, cy_px)), width, height)
