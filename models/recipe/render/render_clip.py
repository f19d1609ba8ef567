"""Renders the clip: `python models/recipe/render/render_clip.py --out models/clip`.

Needs `pip install bpy==4.5.* pillow` (Python 3.11), and of the recipe, which need not be installed,
the names of the classes alone.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from random import Random

import bpy
import check
import numpy as np
import passes
from camera import CV_FROM_BLENDER, FRAMES_PER_SECOND, Intrinsics
from PIL import Image
from rooms import ROOMS
from shapes import CLASSES

SEED = 11
FRAMES = 8
JPEG_QUALITY = 90


def clear() -> None:
    """Empty the scene; materials stay, they are shared by all rooms."""
    for collection in (bpy.data.objects, bpy.data.meshes, bpy.data.lights, bpy.data.cameras):
        bpy.data.batch_remove(list(collection))


def write_camera(out: Path, poses: dict[str, list[float]]) -> None:
    """`camera.json`: intrinsics, frame rate, classes; `poses.csv`: a row a picture."""
    camera = Intrinsics()
    described = {
        "width": camera.width,
        "height": camera.height,
        "fx": camera.fx_px,
        "fy": camera.fy_px,
        "cx": camera.cx_px,
        "cy": camera.cy_px,
        "frames_per_second": FRAMES_PER_SECOND,
        "classes": CLASSES,
    }
    (out / "camera.json").write_text(json.dumps(described, indent=2) + "\n")
    columns = ",".join(
        f"{name}{axis}" for axis in "xyz" for name in ("right_", "down_", "ahead_", "")
    )
    rows = [f"{identity},{','.join(map(str, pose))}" for identity, pose in poses.items()]
    (out / "poses.csv").write_text("\n".join([f"id,{columns}", *rows]) + "\n")


def render_room(name: str, options: argparse.Namespace, poses: dict[str, list]) -> None:
    """Build a room and render the frames that are asked for and not there yet."""
    clear()
    shot = ROOMS[name](Random(f"{SEED} {name}"))
    samples = options.samples or (6 if options.preview else shot.samples)
    passes.prepare(shot.exposure, samples)
    intrinsics = Intrinsics().scaled(0.5) if options.preview else Intrinsics()
    camera = intrinsics.apply(bpy.context.scene)
    for frame in range(FRAMES):
        identity = f"{name}_{frame:02d}"
        camera.matrix_world = shot.motion.pose(frame)
        pose = camera.matrix_world @ CV_FROM_BLENDER
        poses[identity] = [round(value, 6) for row in pose[:3] for value in row]
        if frame in options.frames and not (options.out / f"labels/{identity}.png").exists():
            started = time.monotonic()
            write_picture(options.out, identity, seed=SEED + frame)
            seconds = time.monotonic() - started
            print(f"{identity}: {seconds:.1f} s", file=sys.stderr)


def write_picture(out: Path, identity: str, *, seed: int) -> None:
    """Picture, depth and labels of the scene as it stands."""
    rgb = passes.with_noise(passes.picture(seed), np.random.default_rng(seed))
    depth_m, labels = passes.truth()
    millimetres = np.nan_to_num(np.rint(depth_m * 1000), nan=passes.DEPTH_NONE_MM)
    for folder in ("rgb", "depth", "labels"):
        (out / folder).mkdir(parents=True, exist_ok=True)
    Image.fromarray(rgb).save(out / f"rgb/{identity}.jpg", quality=JPEG_QUALITY, optimize=True)
    depth = Image.fromarray(millimetres.astype(np.uint16))
    depth.save(out / f"depth/{identity}.png", optimize=True)
    Image.fromarray(labels).save(out / f"labels/{identity}.png", optimize=True)


def parser() -> argparse.ArgumentParser:
    """The command line."""
    made = argparse.ArgumentParser(description=__doc__)
    made.add_argument("--out", type=Path, help="folder of the clip; pictures that exist are kept")
    made.add_argument("--rooms", nargs="+", choices=sorted(ROOMS), default=sorted(ROOMS))
    made.add_argument("--frames", nargs="+", type=int, default=list(range(FRAMES)))
    made.add_argument("--samples", type=int, help="rays a pixel, instead of the room's own")
    made.add_argument("--preview", action="store_true", help="half the size, 6 rays a pixel")
    made.add_argument("--check", action="store_true", help="measure depth and pixels, no pictures")
    return made


def main() -> int:
    """Render or check; the exit code."""
    options = parser().parse_args()
    if options.check:
        found = check.problems(clear)
        print("\n".join(found) or "depth, labels and pixels are right")
        return 1 if found else 0
    if options.out is None:
        parser().error("--out says where the pictures go")
    poses: dict[str, list] = {}
    for name in options.rooms:
        render_room(name, options, poses)
    if not options.preview and set(options.rooms) == set(ROOMS):
        write_camera(options.out, poses)
    return 0


if __name__ == "__main__":
    sys.exit(main())
