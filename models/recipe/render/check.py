"""Whether rendered depth, labels and pixels are what the intrinsics say, in scenes made for it."""

from __future__ import annotations

from random import Random

import bpy
import materials
import numpy as np
import passes
from camera import CV_FROM_BLENDER, Intrinsics
from mathutils import Matrix, Vector
from shapes import CLASSES, Maker

WALL_MM = 3000
BALL_RADIUS_M = 0.02


def problems(clear: object) -> list[str]:
    """What is wrong; `clear` empties the scene."""
    intrinsics = Intrinsics()
    found = _wall(clear, intrinsics)
    for at in ((0.0, 0.0, 2.0), (-1.1, 0.8, 2.0), (1.3, -1.0, 2.4), (-0.9, -0.7, 1.7)):
        found += _ball(clear, intrinsics, np.array(at))
    return found


def _scene(clear: object, intrinsics: Intrinsics) -> bpy.types.Object:
    """An empty scene whose camera stands anyhow, so that no axis is special."""
    clear()
    passes.prepare(0, 1)
    camera = intrinsics.apply(bpy.context.scene)
    turned = Matrix.Rotation(0.7, 4, "Z") @ Matrix.Rotation(1.2, 4, "X")
    camera.matrix_world = Matrix.Translation((1.0, -2.0, 1.4)) @ turned
    return camera


def _wall(clear: object, intrinsics: Intrinsics) -> list[str]:
    """A wall across the axis is equally deep everywhere: depth is no distance."""
    camera = _scene(clear, intrinsics)
    facing = Maker(Random(0), "wall", camera.matrix_world)
    facing.box((20, 20, 0.1), (0, 0, -WALL_MM / 1000 - 0.1), materials.paint((0.5,) * 3), bevel=0)
    depth_m, labels = passes.truth()
    millimetres = np.rint(depth_m * 1000)
    found = []
    if not (millimetres == WALL_MM).all():
        low, high = millimetres.min(), millimetres.max()
        found.append(f"a wall at {WALL_MM} mm is rendered from {low} to {high} mm")
    if not (labels == CLASSES.index("wall")).all():
        found.append(f"a wall's labels are {np.unique(labels).tolist()}")
    return found


def _ball(clear: object, intrinsics: Intrinsics, at: np.ndarray) -> list[str]:
    """A small ball lands where the intrinsics say, as deep as its near side."""
    camera = _scene(clear, intrinsics)
    in_blender = CV_FROM_BLENDER @ Vector(at)
    ball = Maker(Random(0), "objects", camera.matrix_world @ Matrix.Translation(in_blender))
    size = (2 * BALL_RADIUS_M,) * 3
    material = materials.paint((0.5,) * 3)
    ball.soft(size, (0, 0, -BALL_RADIUS_M), material, radius=BALL_RADIUS_M)
    depth_m, labels = passes.truth()
    rows, columns = np.nonzero(labels == CLASSES.index("objects"))
    if len(rows) == 0:
        return [f"a ball at {at.tolist()} is not in the picture"]
    column, row = intrinsics.project(at)
    found = []
    # Off the axis a ball is an ellipse whose middle is not the ball's: here by below 0.1 pixels.
    off = np.hypot(columns.mean() - column, rows.mean() - row)
    if off > 0.3:
        found.append(f"a ball at {at.tolist()} lands {off:.2f} pixels beside its place")
    nearest = np.nanmin(depth_m[rows, columns])
    expected = at[2] - BALL_RADIUS_M
    if abs(nearest - expected) > 0.001:
        found.append(f"a ball at {at.tolist()}: nearest depth {nearest:.4f}, not {expected:.4f}")
    return found
