"""Sets of a dataset list, made of a plane whose depth is known for every camera."""

from pathlib import Path

import numpy as np
from PIL import Image

from nunet_models.data.sets.cameras import Pinhole

CAMERA = Pinhole(fx=80.0, fy=80.0, cx=63.5, cy=47.5, width=128, height=96)
NORMAL, DISTANCE = np.array([0.2, 0.5, 0.8]), 2.0
HEADER = "id,fx,fy,cx,cy,width,height,sensor,scene"


def plane_depth(camera: Pinhole, turned: np.ndarray | None = None) -> np.ndarray:
    """Depth of the plane `NORMAL . X = DISTANCE`; `turned` are the camera's axes as columns."""
    rows, columns = np.mgrid[: camera.height, : camera.width]
    rays = np.stack(
        [(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones(rows.shape)]
    )
    normal = NORMAL if turned is None else turned.T @ NORMAL
    return DISTANCE / np.einsum("i,ihw->hw", normal, rays)


def write_set(
    root: Path,
    *,
    camera: Pinhole = CAMERA,
    scenes: tuple[str, ...] = ("hall", "hall", "attic", "attic"),
    unit_m: float = 0.001,
) -> list[str]:
    """A folder with `rgb/`, `depth/`, `labels/` and `intrinsics.csv`; brightness tells depth."""
    for name in ("rgb", "depth", "labels"):
        (root / name).mkdir(parents=True, exist_ok=True)
    depth = plane_depth(camera)
    rgb = np.repeat((60 * depth)[..., None], 3, axis=2).clip(0, 255).astype(np.uint8)
    labels = np.zeros(depth.shape, np.uint8)
    labels[depth.shape[0] // 2 :] = 1
    lines = [HEADER]
    ids = [f"{i:03d}" for i in range(len(scenes))]
    for identity, scene in zip(ids, scenes, strict=True):
        Image.fromarray(rgb).save(root / "rgb" / f"{identity}.png")
        units = np.rint(depth / unit_m).astype(np.uint16)
        Image.fromarray(units).save(root / "depth" / f"{identity}.png")
        Image.fromarray(labels).save(root / "labels" / f"{identity}.png")
        c = camera
        numbers = f"{c.fx},{c.fy},{c.cx},{c.cy},{c.width},{c.height}"
        lines.append(f"{identity},{numbers},Test camera,{scene}")
    (root / "intrinsics.csv").write_text("\n".join(lines) + "\n")
    return ids


def write_list(path: Path, *sets: str) -> Path:
    """A dataset list of these tables."""
    path.write_text("\n".join(f"[[set]]\n{text}\n" for text in sets))
    return path
