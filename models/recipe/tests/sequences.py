"""Reads a rendered sequence, and carries depth from one image to another by the poses."""

import csv
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

SMOOTH_M = 0.03
"""Largest difference of four neighboring depths on a smooth surface."""


@dataclass(frozen=True)
class Sequence:
    """A folder with `rgb`, `depth`, `labels`, `camera.json` and `poses.csv`."""

    folder: Path

    @property
    def ids(self):
        return sorted(path.stem for path in (self.folder / "rgb").glob("*.jpg"))

    @property
    def camera(self):
        return json.loads((self.folder / "camera.json").read_text())

    @property
    def poses(self):
        with (self.folder / "poses.csv").open(newline="") as file:
            rows = list(csv.reader(file))[1:]
        return {name: np.array(row, float).reshape(3, 4) for name, *row in rows}

    def depth_m(self, identity):
        return np.array(Image.open(self.folder / f"depth/{identity}.png")) / 1000.0

    def labels(self, identity):
        return np.array(Image.open(self.folder / f"labels/{identity}.png"))

    def carried(self, before, identity):
        """Depth of an image as another predicts it and as it is itself, on smooth surfaces."""
        known, world_from = self.camera, self.poses
        fx, fy, cx, cy = (known[name] for name in ("fx", "fy", "cx", "cy"))
        width, height = known["width"], known["height"]
        z = self.depth_m(before)
        row, column = np.mgrid[0:height, 0:width]
        points = np.stack([(column - cx) / fx * z, (row - cy) / fy * z, z], axis=2).reshape(-1, 3)
        rotation, place = world_from[before][:, :3], world_from[before][:, 3]
        here, origin = world_from[identity][:, :3], world_from[identity][:, 3]
        x, y, z = ((points @ rotation.T + place - origin) @ here).T
        ahead = z > 0.05
        x, y, z = x[ahead], y[ahead], z[ahead]
        u, v = fx * x / z + cx, fy * y / z + cy
        inside = (u >= 0) & (u < width - 1) & (v >= 0) & (v < height - 1)
        return _interpolated(self.depth_m(identity), u[inside], v[inside], z[inside])


def _interpolated(own, u, v, z):
    row, column = v.astype(int), u.astype(int)
    down, right = v - row, u - column
    corners = np.stack([own[row + i, column + j] for i in (0, 1) for j in (0, 1)])
    above = (1 - right) * corners[0] + right * corners[1]
    below = (1 - right) * corners[2] + right * corners[3]
    smooth = np.ptp(corners, axis=0) < SMOOTH_M
    return z[smooth], ((1 - down) * above + down * below)[smooth]
