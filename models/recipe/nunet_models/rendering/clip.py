"""Renders the clip (`models/clip`): three furnished rooms, eight frames each."""

from __future__ import annotations

import logging
import time
from pathlib import Path
from random import Random

import bpy
import numpy as np
from PIL import Image

from nunet_models.rendering import passes, sequence
from nunet_models.rendering.camera import CV_FROM_BLENDER, FRAMES_PER_SECOND, add_camera
from nunet_models.rendering.clip_rooms import ROOMS
from nunet_models.rendering.intrinsics import Intrinsics
from nunet_models.rendering.scene import clear

LOG = logging.getLogger(__name__)
SEED = 11
FRAMES = 8
JPEG_QUALITY = 90


def render_clip(out: Path, *, threads: int) -> None:
    """Render the images that are not there yet, then write camera and poses."""
    for folder in sequence.FOLDERS:
        (out / folder).mkdir(parents=True, exist_ok=True)
    scene = bpy.context.scene
    scene.render.threads_mode, scene.render.threads = "FIXED", threads
    poses: dict[str, np.ndarray] = {}
    for name in sorted(ROOMS):
        poses |= _render_room(out, name)
    sequence.write_camera(out, Intrinsics(), FRAMES_PER_SECOND)
    sequence.write_poses(out, poses)


def _render_room(out: Path, name: str) -> dict[str, np.ndarray]:
    """Build a room and render its missing frames; the poses of all its frames."""
    clear(keep_materials=True)
    shot = ROOMS[name](Random(f"{SEED} {name}"))
    passes.prepare(shot.exposure, shot.samples)
    camera = add_camera(Intrinsics(), bpy.context.scene)
    poses = {}
    for frame in range(FRAMES):
        identity = f"{name}_{frame:02d}"
        camera.matrix_world = shot.motion.pose(frame)
        poses[identity] = np.array(camera.matrix_world @ CV_FROM_BLENDER)[:3]
        if not (out / f"labels/{identity}.png").exists():
            started = time.monotonic()
            _write_image(out, identity, seed=SEED + frame)
            LOG.info("%s: %.1f s", identity, time.monotonic() - started)
    return poses


def _write_image(out: Path, identity: str, *, seed: int) -> None:
    """Image, depth and labels of the scene as it stands."""
    rgb = passes.with_noise(passes.image(seed), np.random.default_rng(seed))
    sequence.write_rgb(out, identity, Image.fromarray(rgb), JPEG_QUALITY)
    sequence.write_truth(out, identity, *passes.truth())
