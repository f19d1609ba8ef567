"""Files of a rendered sequence: depth, labels, `camera.json`, `poses.csv`. Needs no Blender."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import numpy as np
from PIL import Image

from nunet_models.classes import CLASSES_13
from nunet_models.rendering.folder import keep_file, replace_file, replace_image
from nunet_models.rendering.intrinsics import Intrinsics

FOLDERS = ("rgb", "depth", "labels")
POSE_COLUMNS = [f"{name}{axis}" for axis in "xyz" for name in ("right_", "down_", "ahead_", "")]


def write_truth(out: Path, identity: str, depth_m: np.ndarray, labels: np.ndarray) -> None:
    """Depth (`[H, W]`, meters, NaN = none) and labels of one image, labels last."""
    millimeters = np.nan_to_num(np.rint(depth_m * 1000), nan=0).astype(np.uint16)
    for folder, plane in (("depth", millimeters), ("labels", labels)):
        replace_image(out / f"{folder}/{identity}.png", Image.fromarray(plane), optimize=True)


def write_rgb(out: Path, identity: str, rgb: Image.Image, quality: int) -> None:
    """One image as JPEG."""
    replace_image(out / f"rgb/{identity}.jpg", rgb, quality=quality, optimize=True)


def write_camera(out: Path, camera: Intrinsics, frames_per_second: float) -> None:
    """`camera.json`: image size, intrinsics, frame rate, classes; an equal file is kept."""
    described = {
        "width": camera.width,
        "height": camera.height,
        "fx": camera.fx_px,
        "fy": camera.fy_px,
        "cx": camera.cx_px,
        "cy": camera.cy_px,
        "frames_per_second": frames_per_second,
        "classes": CLASSES_13,
    }
    keep_file(out / "camera.json", (json.dumps(described, indent=2) + "\n").encode())


def write_poses(out: Path, poses: dict[str, np.ndarray], *, name: str = "poses.csv") -> None:
    """A table with one row per image, the `[3, 4]` matrix world from camera row by row."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(["id", *POSE_COLUMNS])
    for identity, pose in poses.items():
        rows.writerow([identity, *(round(float(value), 6) for value in pose.ravel())])
    replace_file(out / name, text.getvalue().encode())
