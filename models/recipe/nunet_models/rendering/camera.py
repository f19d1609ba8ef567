"""Blender's camera: intrinsics, rotation, hand-held motion."""

from __future__ import annotations

import math
from dataclasses import dataclass

import bpy
from mathutils import Matrix

from nunet_models.rendering.intrinsics import Intrinsics

FRAMES_PER_SECOND = 30

CV_FROM_BLENDER = Matrix.Diagonal((1, -1, -1, 1))
"""Blender's camera looks along -z with y up; the project's along +z with y down."""


def add_camera(intrinsics: Intrinsics, scene: bpy.types.Scene) -> bpy.types.Object:
    """A camera in the scene with exactly these intrinsics."""
    made = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(made)
    scene.camera = made
    set_intrinsics(intrinsics, scene)
    return made


def set_intrinsics(intrinsics: Intrinsics, scene: bpy.types.Scene) -> None:
    """Give the scene's camera these intrinsics."""
    data = scene.camera.data
    data.sensor_fit = "HORIZONTAL"
    data.sensor_width = 36.0
    data.lens = intrinsics.fx_px * data.sensor_width / intrinsics.width
    data.clip_start, data.clip_end = 0.05, 100
    # fx < fy means that pixels are wider than tall.
    scene.render.pixel_aspect_x = intrinsics.fy_px / intrinsics.fx_px
    scene.render.pixel_aspect_y = 1.0
    # Shifts are in image widths; the image's edge is at -0.5.
    aspect = scene.render.pixel_aspect_y / scene.render.pixel_aspect_x
    data.shift_x = (0.5 * intrinsics.width - (intrinsics.cx_px + 0.5)) / intrinsics.width
    data.shift_y = (intrinsics.cy_px + 0.5 - 0.5 * intrinsics.height) * aspect / intrinsics.width
    scene.render.resolution_x, scene.render.resolution_y = intrinsics.width, intrinsics.height
    scene.render.resolution_percentage = 100


def turned(yaw_deg: float, pitch_deg: float, roll_deg: float) -> Matrix:
    """Rotation of Blender's camera: yaw to the left of +y, then pitch up, then roll."""
    made = Matrix.Rotation(math.radians(yaw_deg), 4, "Z")
    made @= Matrix.Rotation(math.radians(90 + pitch_deg), 4, "X")
    return made @ Matrix.Rotation(math.radians(roll_deg), 4, "Z")


@dataclass(frozen=True)
class Motion:
    """Hand-held motion: start, velocity, turn rate, and tremor."""

    start_m: tuple[float, float, float]
    look_deg: tuple[float, float]
    """To the left of +y, and up."""
    velocity: tuple[float, float, float]
    """Meters per second."""
    turn: tuple[float, float]
    """Degrees per second, to the left and up."""

    def pose(self, frame: int) -> Matrix:
        """World from Blender's camera at a frame."""
        t = frame / FRAMES_PER_SECOND
        eye = [
            start + speed * t + 0.002 * _tremor(t, axis)
            for axis, (start, speed) in enumerate(zip(self.start_m, self.velocity, strict=True))
        ]
        yaw, pitch = (
            angle + speed * t + 0.15 * _tremor(t, axis)
            for axis, (angle, speed) in enumerate(zip(self.look_deg, self.turn, strict=True), 3)
        )
        roll = 0.8 + 0.2 * _tremor(t, 5)
        return Matrix.Translation(eye) @ turned(yaw, pitch, roll)


def _tremor(t: float, axis: int) -> float:
    """A hand's tremor, about -1 to 1: slow sway plus 5 Hz."""
    sway = math.sin(2 * math.pi * 1.1 * t + 1.9 * axis)
    return 0.7 * sway + 0.3 * math.sin(2 * math.pi * 5.3 * t + 2.7 * axis)
