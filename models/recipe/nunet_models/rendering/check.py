"""Measures rendered depth, labels and pixel positions against the intrinsics, in test scenes."""

from __future__ import annotations

import math
from random import Random

import bpy
import numpy as np
from mathutils import Matrix, Vector

from nunet_models.rendering import kinds, materials, passes
from nunet_models.rendering.camera import CV_FROM_BLENDER, add_camera, turned
from nunet_models.rendering.intrinsics import Intrinsics, random_intrinsics
from nunet_models.rendering.scene import clear
from nunet_models.rendering.shapes import CLASSES, Maker

WALL_MM = 3000
BALL_RADIUS_PX = 6
MAX_OFF_PX = 0.3


RANDOM_CAMERAS = 6


def problems() -> list[str]:
    """What is wrong with the clip's camera and with random ones; empty if all is right."""
    found = _repeat_problems() + _camera_problems(Intrinsics(), turned(40, -21, 0))
    for number in range(RANDOM_CAMERAS):
        random = Random(number)
        angles = random.uniform(0, 360), random.uniform(-30, 30), random.uniform(-30, 30)
        rotation = turned(*angles)
        found += _angle_problems(rotation, *angles)
        found += _camera_problems(random_intrinsics(random), rotation)
    return found


def _repeat_problems() -> list[str]:
    """The same seed builds the same room."""
    scenes = []
    for _ in range(2):
        clear()
        kinds.build("check", [])
        objects = sorted(bpy.data.objects, key=lambda each: each.name)
        scenes.append([(each.name, np.array(each.matrix_world).tolist()) for each in objects])
    return [] if scenes[0] == scenes[1] else ["the same seed builds different rooms"]


def _camera_problems(intrinsics: Intrinsics, rotation: Matrix) -> list[str]:
    """A wall, and balls in the middle and near the corners of the image."""
    found = _wall(intrinsics, rotation)
    width, height = intrinsics.width, intrinsics.height
    for column, row, depth_m in ((0.5, 0.5, 2.0), (0.1, 0.85, 2.0), (0.9, 0.12, 2.4)):
        u, v = column * width, row * height
        at = ((u - intrinsics.cx_px) / intrinsics.fx_px, (v - intrinsics.cy_px) / intrinsics.fy_px)
        found += _ball(intrinsics, rotation, depth_m * np.array((*at, 1.0)))
    return found


def _angle_problems(rotation: Matrix, yaw: float, pitch: float, roll: float) -> list[str]:
    """The camera looks as far up as `pitch` says, and its right side rises by `roll`."""
    right, ahead = rotation.col[0].xyz, -rotation.col[2].xyz
    measured = (
        math.degrees(math.atan2(-ahead.x, ahead.y)) % 360,
        math.degrees(math.asin(ahead.z)),
        math.degrees(math.asin(right.z / math.cos(math.radians(pitch)))),
    )
    expected = (yaw, pitch, roll)
    return [
        f"{name} is {got:.3f} degrees, expected {wanted:.3f}"
        for name, got, wanted in zip(("yaw", "pitch", "roll"), measured, expected, strict=True)
        if abs(got - wanted) > 0.01
    ]


def _scene(intrinsics: Intrinsics, rotation: Matrix) -> bpy.types.Object:
    """An empty scene with a camera away from the origin."""
    clear()
    passes.prepare(0, 1)
    camera = add_camera(intrinsics, bpy.context.scene)
    camera.matrix_world = Matrix.Translation((1.0, -2.0, 1.4)) @ rotation
    return camera


def _wall(intrinsics: Intrinsics, rotation: Matrix) -> list[str]:
    """A wall across the optical axis has one depth everywhere (depth is not distance)."""
    camera = _scene(intrinsics, rotation)
    facing = Maker(Random(0), "wall", camera.matrix_world)
    facing.box((20, 20, 0.1), (0, 0, -WALL_MM / 1000 - 0.1), materials.paint((0.5,) * 3), bevel=0)
    depth_m, labels = passes.truth()
    millimeters = np.rint(depth_m * 1000)
    found = []
    if not (millimeters == WALL_MM).all():
        low, high = millimeters.min(), millimeters.max()
        found.append(f"a wall at {WALL_MM} mm is rendered from {low} to {high} mm")
    if not (labels == CLASSES.index("wall")).all():
        found.append(f"a wall's labels are {np.unique(labels).tolist()}")
    return found


def _ball(intrinsics: Intrinsics, rotation: Matrix, at: np.ndarray) -> list[str]:
    """A small ball is at the pixel that the intrinsics predict, with the depth of its near side."""
    camera = _scene(intrinsics, rotation)
    radius_m = BALL_RADIUS_PX * at[2] / intrinsics.fx_px
    in_blender = CV_FROM_BLENDER @ Vector(at)
    ball = Maker(Random(0), "objects", camera.matrix_world @ Matrix.Translation(in_blender))
    material = materials.paint((0.5,) * 3)
    ball.soft((2 * radius_m,) * 3, (0, 0, -radius_m), material, radius=radius_m)
    depth_m, labels = passes.truth()
    rows, columns = np.nonzero(labels == CLASSES.index("objects"))
    if len(rows) == 0:
        return [f"a ball at {at.tolist()} is not in the image"]
    # A ball's image is an ellipse; its center is the image of a point a little farther out.
    outwards = at[2] ** 2 / (at[2] ** 2 - radius_m**2)
    column, row = intrinsics.project(at * (outwards, outwards, 1))
    found = []
    off = np.hypot(columns.mean() - column, rows.mean() - row)
    if off > MAX_OFF_PX:
        found.append(f"a ball at {at.tolist()} is {off:.2f} pixels off")
    nearest = np.nanmin(depth_m[rows, columns])
    expected = at[2] - radius_m
    if abs(nearest - expected) > 0.02 * radius_m:
        found.append(
            f"a ball at {at.tolist()}: nearest depth {nearest:.4f}, expected {expected:.4f}"
        )
    return found
