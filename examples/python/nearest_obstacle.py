"""How far a robot may drive: `python nearest_obstacle.py PICTURE`.

Looks through a corridor of the robot's own size straight ahead, and leaves out what the robot drives on. Needs the
package Pillow.
"""

import sys
from pathlib import Path

import numpy as np
import nunet_py as nunet
from PIL import Image

HALF_WIDTH_M = 0.35  # of the robot, with a margin
TOP_M, BOTTOM_M = -0.5, 0.6  # above and below the camera's axis; y points down
GROUND = {"floor"}
# A single wrong pixel must not stop the robot: this share of the corridor's points may be nearer.
OUTLIERS_PERCENT = 1.0


def main(picture: Path) -> None:
    """Infer, cut the corridor out of the cloud, print the nearest point that is no ground."""
    model = nunet.Model("wnet_c.onnx")
    camera = nunet.Camera(fx=518.9, fy=519.5, cx=325.6, cy=253.7, size=(640, 480))
    rgb = np.array(Image.open(picture).convert("RGB"))
    result = model.infer(rgb, camera=camera)
    cloud = result.cloud()

    x, y, z = np.moveaxis(cloud.points, -1, 0)  # metres: right, down, forward
    ground = [index for index, name in enumerate(result.class_names) if name in GROUND]
    # Comparisons with NaN are false: a pixel without depth is no obstacle, and no free way either.
    corridor = (np.abs(x) < HALF_WIDTH_M) & (y > TOP_M) & (y < BOTTOM_M) & ~np.isin(cloud.labels, ground)
    if not corridor.any():
        print("nothing in the way")
        return
    ahead = float(np.percentile(z[corridor], OUTLIERS_PERCENT))
    nearest = corridor & (z <= ahead + 0.1)
    names, counts = np.unique(cloud.labels[nearest], return_counts=True)
    print(f"{result.class_names[names[counts.argmax()]]}, {ahead:.2f} m ahead")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
