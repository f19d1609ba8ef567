"""The camera: NYU Depth V2's intrinsics, and a hand that holds it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Matrix

FRAMES_PER_SECOND = 30

CV_FROM_BLENDER = Matrix.Diagonal((1, -1, -1, 1))
"""Blender's camera looks along -z with y up; ours along +z with y down."""


@dataclass(frozen=True)
class Intrinsics:
    """A pinhole camera; centres of pixels lie at whole numbers."""

    fx_px: float = 518.858
    fy_px: float = 519.470
    cx_px: float = 325.582
    cy_px: float = 253.736
    width: int = 640
    height: int = 480

    def scaled(self, factor: float) -> Intrinsics:
        """The same camera with pictures of another size."""
        return Intrinsics(
            self.fx_px * factor,
            self.fy_px * factor,
            (self.cx_px + 0.5) * factor - 0.5,
            (self.cy_px + 0.5) * factor - 0.5,
            round(self.width * factor),
            round(self.height * factor),
        )

    def project(self, point: np.ndarray) -> tuple[float, float]:
        """Column and row of a point in the camera's frame (x right, y down, z ahead)."""
        x, y, z = point
        return self.fx_px * x / z + self.cx_px, self.fy_px * y / z + self.cy_px

    def apply(self, scene: bpy.types.Scene) -> bpy.types.Object:
        """A camera in the scene with exactly these numbers."""
        data = bpy.data.cameras.new("camera")
        data.sensor_fit = "HORIZONTAL"
        data.sensor_width = 36.0
        data.lens = self.fx_px * data.sensor_width / self.width
        data.clip_start, data.clip_end = 0.05, 100
        # A pixel that is wider than tall has fewer of them across the same angle.
        scene.render.pixel_aspect_x = self.fy_px / self.fx_px
        scene.render.pixel_aspect_y = 1.0
        # Shifts are in widths of the picture; the picture's edge is at -0.5.
        aspect = scene.render.pixel_aspect_y / scene.render.pixel_aspect_x
        data.shift_x = (0.5 * self.width - (self.cx_px + 0.5)) / self.width
        data.shift_y = (self.cy_px + 0.5 - 0.5 * self.height) * aspect / self.width
        scene.render.resolution_x, scene.render.resolution_y = self.width, self.height
        scene.render.resolution_percentage = 100
        made = bpy.data.objects.new("camera", data)
        scene.collection.objects.link(made)
        scene.camera = made
        return made


@dataclass(frozen=True)
class Motion:
    """A walk: where it starts, how fast it goes and turns, and a hand's tremor."""

    start_m: tuple[float, float, float]
    look_deg: tuple[float, float]
    """To the left of +y, and up."""
    velocity: tuple[float, float, float]
    """Metres a second."""
    turn: tuple[float, float]
    """Degrees a second, to the left and up."""

    def pose(self, frame: int) -> Matrix:
        """World from Blender's camera at a frame."""
        t = frame / FRAMES_PER_SECOND
        eye = [
            start + speed * t + 0.002 * _tremor(t, axis)
            for axis, (start, speed) in enumerate(zip(self.start_m, self.velocity, strict=True))
        ]
        yaw, pitch = (
            look + speed * t + 0.15 * _tremor(t, axis)
            for axis, (look, speed) in enumerate(zip(self.look_deg, self.turn, strict=True), 3)
        )
        roll = 0.8 + 0.2 * _tremor(t, 5)
        turned = Matrix.Rotation(math.radians(yaw), 4, "Z")
        turned @= Matrix.Rotation(math.radians(90 + pitch), 4, "X")
        turned @= Matrix.Rotation(math.radians(roll), 4, "Z")
        return Matrix.Translation(eye) @ turned


def _tremor(t: float, axis: int) -> float:
    """A hand's shaking, about -1 to 1: slow sway and a tremor of some 5 Hz."""
    sway = math.sin(2 * math.pi * 1.1 * t + 1.9 * axis)
    return 0.7 * sway + 0.3 * math.sin(2 * math.pi * 5.3 * t + 2.7 * axis)
