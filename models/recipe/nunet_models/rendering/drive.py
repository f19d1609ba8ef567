"""Renders the drive: a robot's path through two rooms and a corridor, with poses."""

from __future__ import annotations

import io
import logging
import math
import shutil
import time
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix

from nunet_models.rendering import drive_rooms, sequence
from nunet_models.rendering.camera import CV_FROM_BLENDER, add_camera, turned
from nunet_models.rendering.fast import FastRenderer
from nunet_models.rendering.folder import replace_file
from nunet_models.rendering.intrinsics import Intrinsics
from nunet_models.rendering.robot_path import RobotPath
from nunet_models.rendering.scene import clear
from nunet_models.rendering.sensor import Metered, Sensor

LOG = logging.getLogger(__name__)
CAMERA = Intrinsics(262.0, 262.0, 160.3, 119.2, 320, 240)
FRAMES_PER_SECOND = 10
SAMPLES = 6
SENSOR = Sensor(
    exposure_stops=0.25,
    white_balance=0.6,
    shoulder=0.6,
    contrast=1.15,
    saturation=1.0,
    noise=0.35,
    blur_px=0.0,
    vignette=0.1,
    quality=88,
)
ADAPTATION_FRAMES = 12
"""Exposure and white balance are averaged over so many frames."""


@dataclass(frozen=True)
class Robot:
    """How fast a robot drives (meters per second), and where its camera is; positive is up."""

    speed: float
    height_m: float
    pitch_deg: float


ROBOT = Robot(0.6, 0.25, 4.0)
"""The robot of the drive."""


def pose(path: RobotPath, frame: int, robot: Robot = ROBOT) -> Matrix:
    """World from Blender's camera at a frame: the path, and the shaking of wheels on a floor."""
    t = frame / FRAMES_PER_SECOND
    s = robot.speed * t
    x, y = path.point(s)
    shake = [math.sin(2 * math.pi * f * t + p) for f, p in ((1.3, 0.4), (2.9, 1.1), (1.7, 2.0))]
    rotation = turned(
        path.heading_deg(s) + 0.3 * shake[2], robot.pitch_deg + 0.35 * shake[0], 0.3 * shake[1]
    )
    return Matrix.Translation((x, y, robot.height_m + 0.002 * shake[1])) @ rotation


def frame_count(path: RobotPath) -> int:
    """Frames from the start to the end of the path."""
    return int(path.length_m / ROBOT.speed * FRAMES_PER_SECOND) + 1


def render_drive(out: Path, *, threads: int) -> None:
    """Render the frames that are not there yet; with all of them, write the dataset."""
    scratch = out / ".light"
    for folder in (*sequence.FOLDERS, scratch.name):
        (out / folder).mkdir(parents=True, exist_ok=True)
    clear()
    path, ambient = drive_rooms.build()
    camera = add_camera(CAMERA, bpy.context.scene)
    renderer = FastRenderer(SAMPLES, threads, ambient)
    count = frame_count(path)
    names = [f"{frame:04d}" for frame in range(count)]
    for frame, name in enumerate(names):
        if not (scratch / f"{name}.npy").exists():
            started = time.monotonic()
            camera.matrix_world = pose(path, frame)
            _render_frame(out, name, renderer, seed=frame)
            LOG.info("frame %d of %d: %.1f s", frame, count, time.monotonic() - started)
    _develop(out, names)
    poses = [np.array(pose(path, frame) @ CV_FROM_BLENDER)[:3] for frame in range(count)]
    sequence.write_camera(out, CAMERA, FRAMES_PER_SECOND)
    sequence.write_poses(out, dict(zip(names, poses, strict=True)))
    shutil.rmtree(scratch)


def _render_frame(out: Path, name: str, renderer: FastRenderer, *, seed: int) -> None:
    """Write truth and linear light; the light comes last and marks the frame as complete."""
    light = renderer.light(seed)
    sequence.write_truth(out, name, *renderer.truth())
    buffer = io.BytesIO()
    np.save(buffer, light.clip(0, 6e4).astype(np.float16))
    replace_file(out / f".light/{name}.npy", buffer.getvalue())


def _develop(out: Path, names: list[str]) -> None:
    """JPEGs of all frames, with an exposure that adapts slowly."""
    metered = [Metered.of(np.load(out / f".light/{name}.npy")) for name in names]
    for index, name in enumerate(names):
        window = metered[max(0, index - ADAPTATION_FRAMES) : index + 1]
        light = np.load(out / f".light/{name}.npy").astype(np.float32)
        rgb = SENSOR.develop(light, np.random.default_rng(index), Metered.mean(window))
        sequence.write_rgb(out, name, rgb, SENSOR.quality)
