"""Depth of one image as a numpy array: `python numpy_depth.py IMAGE [FOLDER]`.

Prints the range of depth and the share of each class, and writes all results into FOLDER: `depth.npy`
(float32, meters, NaN where there is no depth), `depth.png` (colors), `cloud.ply` and others.
"""

import argparse
from pathlib import Path

import numpy as np
import nunet_py as nunet


def main(image: Path, folder: Path) -> None:
    """Infer, print numbers, write files."""
    model = nunet.Model("wnet_c.onnx")
    # Meters scale with the focal length: pass your own camera, at the size that it was calibrated at.
    camera = nunet.Camera(fx=518.9, fy=519.5, cx=325.6, cy=253.7, size=(640, 480))
    result = model.infer(image, camera=camera)

    valid = result.depth[np.isfinite(result.depth)]
    near, middle, far = np.percentile(valid, [1, 50, 99])
    print(f"{near:.2f} to {far:.2f} {result.units}, median {middle:.2f} ({result.scale_source})")
    for index in np.unique(result.labels if result.labels is not None else []):
        share = np.mean(result.labels == index)
        print(f"{100 * share:5.1f} % {result.class_names[index]}")

    for file in result.save(folder):
        print(file)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("image", type=Path)
    parser.add_argument("folder", type=Path, nargs="?", default=Path())
    arguments = parser.parse_args()
    main(arguments.image, arguments.folder)
