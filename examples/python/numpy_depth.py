"""Depth of one picture as a numpy array: `python numpy_depth.py PICTURE [FOLDER]`.

Writes `depth.npy` (float32, metres, NaN where there is none) and `depth.png` (colours) into FOLDER.
Needs the package Pillow.
"""

import sys
from pathlib import Path

import numpy as np
import nunet_py as nunet
from PIL import Image


def main(picture: Path, folder: Path) -> None:
    """Infer, look at the numbers, write both files."""
    model = nunet.Model("wnet_c.onnx")
    rgb = np.array(Image.open(picture).convert("RGB"))
    # Metres depend on the focal length: give yours, at the size that it was calibrated at.
    camera = nunet.Camera(fx=518.9, fy=519.5, cx=325.6, cy=253.7, size=(640, 480))
    result = model.infer(rgb, camera=camera)

    valid = result.depth[np.isfinite(result.depth)]
    near, middle, far = np.percentile(valid, [1, 50, 99])
    print(f"{near:.2f} to {far:.2f} {result.units}, half of it nearer than {middle:.2f} ({result.scale_source})")
    for index in np.unique(result.labels if result.labels is not None else []):
        share = np.mean(result.labels == index)
        print(f"{100 * share:5.1f} % {result.class_names[index]}")

    np.save(folder / "depth.npy", result.depth)
    Image.fromarray(nunet.colorize(result.depth)).save(folder / "depth.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2] if len(sys.argv) > 2 else "."))
