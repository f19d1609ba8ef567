"""The nearest obstacle in front of a robot: `python nearest_obstacle.py IMAGE`.

Searches a corridor of the robot's own size straight ahead, without the floor. If too much of the corridor has
no depth, the answer is `unknown`: space that was not seen is not free.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import nunet_py as nunet

HALF_WIDTH_M = 0.35  # of the robot, with a margin
TOP_M, BOTTOM_M = -0.5, 0.6  # above and below the camera's axis; y points down
GROUND = {"floor"}
# Outliers must not stop the robot: this share of the corridor's points may be nearer.
OUTLIERS_PERCENT = 1.0
# The share of pixels that may have no depth, of those that see the corridor at this distance.
LOOK_AHEAD_M = 2.0
UNSEEN_PERCENT = 5.0


def describe(cloud: nunet.Cloud, class_names: Sequence[str], camera: nunet.Camera) -> str:
    """Find the nearest point of the cloud in the corridor that is not ground."""
    x, y, z = np.moveaxis(cloud.points, -1, 0)  # meters: right, down, forward
    row, column = np.indices(z.shape)
    right = LOOK_AHEAD_M * (column - camera.cx) / camera.fx
    down = LOOK_AHEAD_M * (row - camera.cy) / camera.fy
    in_corridor = (np.abs(right) < HALF_WIDTH_M) & (down > TOP_M) & (down < BOTTOM_M)
    unseen = np.count_nonzero(in_corridor & np.isnan(z))
    if unseen >= max(1, UNSEEN_PERCENT / 100 * np.count_nonzero(in_corridor)) or not in_corridor.any():
        return f"unknown: {unseen} of {np.count_nonzero(in_corridor)} pixels have no depth"

    ground = [index for index, name in enumerate(class_names) if name in GROUND]
    # Comparisons with NaN are false, so the few pixels without depth are ignored.
    corridor = (np.abs(x) < HALF_WIDTH_M) & (y > TOP_M) & (y < BOTTOM_M) & ~np.isin(cloud.labels, ground)
    if not corridor.any():
        return "nothing in the way"
    ahead = float(np.percentile(z[corridor], OUTLIERS_PERCENT))
    nearest = corridor & (z <= ahead + 0.1)
    names, counts = np.unique(cloud.labels[nearest], return_counts=True)
    return f"{class_names[names[counts.argmax()]]}, {ahead:.2f} m ahead"


def main(image: Path) -> None:
    """Infer, and print the nearest obstacle."""
    model = nunet.Model("wnet_c.onnx")
    camera = nunet.Camera(fx=518.9, fy=519.5, cx=325.6, cy=253.7, size=(640, 480))
    result = model.infer(image, camera=camera)
    rows, columns = result.depth.shape
    print(describe(result.cloud(), result.class_names, camera.at_size(columns, rows)))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("image", type=Path)
    main(parser.parse_args().image)
