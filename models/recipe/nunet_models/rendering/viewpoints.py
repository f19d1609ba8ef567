"""Where the camera stands in a random room: views that show objects and are not inside one."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from random import Random

import bpy
import numpy as np
from mathutils import Matrix, Vector

from nunet_models.rendering.camera import turned
from nunet_models.rendering.folder import Placement
from nunet_models.rendering.intrinsics import Intrinsics, random_intrinsics
from nunet_models.rendering.shapes import CLASSES

VIEW_KINDS = LOW, DRIVING, NEAR, SEATED, STANDING = "low", "driving", "near", "seated", "standing"
SHARES = {LOW: 0.34, NEAR: 0.3, STANDING: 0.36}
SHELL = tuple(CLASSES.index(name) + 1 for name in ("wall", "floor", "ceiling", "window"))
COLUMNS, ROWS = 16, 12
TOO_NEAR_M = 0.22
MAX_TOO_NEAR = 0.02
"""Share of rays that may end nearer than `TOO_NEAR_M`."""
MAX_LOST = 0.02
"""Share of rays that may hit nothing, or the inside of a body."""
MIN_SPREAD = 1.2
"""Ratio of the 95th to the 5th percentile of depth: a flat wall is no view."""


MIN_THINGS = 7
"""Number of different objects that a view's rays must hit."""
MIN_THINGS_DRIVING = 4
PLAIN_SHARE = 0.07
"""Share of views that may show fewer: cameras do look at bare walls."""


@dataclass(frozen=True)
class ViewRange:
    """Where a camera is that looks at a thing."""

    distance_m: tuple[float, float]
    rise_deg: tuple[float, float]
    """How far above the thing the camera is, as an angle seen from the thing."""
    target_m: tuple[float, float]
    """Height of the thing above the floor."""


DRIVING_M = ((0.3, 1.5), (0.0, 0.8))
"""How far ahead of a driving robot the thing is, and how high it is hit."""
RANGES = {
    NEAR: ViewRange((0.3, 1.0), (-5, 65), (-math.inf, math.inf)),
    SEATED: ViewRange((0.4, 1.2), (0, 40), (0.68, 1.2)),
}


@dataclass(frozen=True)
class View:
    """A camera and where it stands (world from Blender's camera)."""

    kind: str
    intrinsics: Intrinsics
    pose: Matrix

    @property
    def placement(self) -> Placement:
        """Height and angles of the pose."""
        right, ahead = self.pose.col[0].xyz, -self.pose.col[2].xyz
        pitch = math.asin(max(-1.0, min(1.0, ahead.z)))
        # The roll of a camera that looks straight up or down is not defined.
        roll = math.asin(max(-1.0, min(1.0, right.z / max(math.cos(pitch), 1e-6))))
        height_m = self.pose.translation.z
        return Placement(self.kind, height_m, math.degrees(pitch), math.degrees(roll))


class ViewFinder:
    """Finds views of the open scene in a box of `size` meters with its corner at the origin."""

    def __init__(
        self,
        random: Random,
        size: tuple[float, float, float],
        shares: Mapping[str, float] = SHARES,
    ) -> None:
        self.random, self.size, self.shares = random, size, shares
        self.scene = bpy.context.scene
        bpy.context.view_layer.update()
        self.depsgraph = bpy.context.evaluated_depsgraph_get()

    def find(self, attempts: int = 40, *, kind: str | None = None) -> View | None:
        """A random view, or none if no attempt gave a good one; of any kind, or of this one."""
        wanted = kind or self.random.choices(list(self.shares), list(self.shares.values()))[0]
        # Random places are mostly near a wall; people stand where they see the room.
        median_m = self.random.choice((0.0, 1.6, 2.2)) if wanted == STANDING else 0.0
        for _ in range(attempts):
            intrinsics = random_intrinsics(self.random)
            pose = self._pose(wanted)
            things = MIN_THINGS_DRIVING if wanted == DRIVING else MIN_THINGS
            if pose is not None and self.is_good(intrinsics, pose, median_m, things):
                return View(wanted, intrinsics, pose)
        return None

    def _pose(self, kind: str) -> Matrix | None:
        if kind == DRIVING:
            return self._before_thing()
        ranges = RANGES.get(kind)
        return self._at_thing(ranges) if ranges else self._free(low=kind == LOW)

    def _free(self, *, low: bool) -> Matrix:
        random, (width, depth, height) = self.random, self.size
        margin = 0.2
        x, y = random.uniform(margin, width - margin), random.uniform(margin, depth - margin)
        if low:
            z, pitch = self._robot()
        else:
            z, pitch = random.uniform(0.4, min(1.9, height - 0.2)), random.gauss(-8, 10)
        if random.random() < 0.1:
            pitch = random.uniform(-30, 30)
        rotation = turned(random.uniform(0, 360), max(-30, min(30, pitch)), self._roll())
        return Matrix.Translation((x, y, z)) @ rotation

    def _robot(self) -> tuple[float, float]:
        """Height and pitch of a robot's camera."""
        return self.random.uniform(0.1, 0.4), self.random.gauss(2, 7)

    def _roll(self) -> float:
        wide = self.random.random() < 0.15
        return self.random.uniform(-30, 30) if wide else self.random.gauss(0, 2.5)

    def _at_thing(self, ranges: ViewRange) -> Matrix | None:
        """Look at a thing; none if the attempt found no thing or no place for the camera."""
        random, target = self.random, self._thing(ranges.target_m)
        if target is None:
            return None
        distance = random.uniform(*ranges.distance_m)
        rise, around = (
            math.radians(random.uniform(*ranges.rise_deg)),
            random.uniform(0, 2 * math.pi),
        )
        away = Vector(
            (math.cos(rise) * math.cos(around), math.cos(rise) * math.sin(around), math.sin(rise))
        )
        eye = target + distance * away
        if not self._is_inside(eye):
            return None
        yaw = math.degrees(math.atan2(away.x, -away.y))
        pitch = -math.degrees(rise)
        return Matrix.Translation(eye) @ turned(
            yaw + random.gauss(0, 6), pitch + random.gauss(0, 6), self._roll()
        )

    def _before_thing(self) -> Matrix | None:
        """As a robot sees a thing ahead; none if the attempt found no thing or no place."""
        random, (distance_m, target_m) = self.random, DRIVING_M
        target = self._thing(target_m)
        if target is None:
            return None
        around, distance = random.uniform(0, 2 * math.pi), random.uniform(*distance_m)
        away = Vector((math.cos(around), math.sin(around), 0))
        eye = target + distance * away
        eye.z, pitch = self._robot()
        if not self._is_inside(eye):
            return None
        yaw = math.degrees(math.atan2(away.x, -away.y)) + random.gauss(0, 15)
        return Matrix.Translation(eye) @ turned(yaw, pitch, self._roll())

    def _thing(self, height_m: tuple[float, float]) -> Vector | None:
        """A random point of a thing at a height in this range."""
        random, (width, depth, _) = self.random, self.size
        low, high = height_m
        for _ in range(12):
            start = Vector(
                (random.uniform(0, width), random.uniform(0, depth), random.uniform(0.3, 1.9))
            )
            aim = Vector(
                (random.gauss(0, 1), random.gauss(0, 1), random.gauss(-0.7, 0.6))
            ).normalized()
            hit, point, _, _, thing, _ = self.scene.ray_cast(self.depsgraph, start, aim)
            if hit and thing.pass_index not in SHELL and low <= point.z <= high:
                return point
        return None

    def _is_inside(self, eye: Vector) -> bool:
        return all(0.08 < value < limit - 0.08 for value, limit in zip(eye, self.size, strict=True))

    def is_good(
        self, intrinsics: Intrinsics, pose: Matrix, min_median_m: float, min_things: int
    ) -> bool:
        """Whether a view is not inside a body, too near to one, or of fewer things than these."""
        eye, rotation = pose.translation, pose.to_3x3()
        columns = np.linspace(0, intrinsics.width - 1, COLUMNS)
        rows = np.linspace(0, intrinsics.height - 1, ROWS)
        depths, lost, things = [], 0, set()
        limit = MAX_LOST * COLUMNS * ROWS
        for v in rows:
            for u in columns:
                ray = Vector(
                    (
                        (u - intrinsics.cx_px) / intrinsics.fx_px,
                        -(v - intrinsics.cy_px) / intrinsics.fy_px,
                        -1,
                    )
                )
                length = ray.length
                aim = (rotation @ ray) / length
                hit, point, normal, _, thing, _ = self.scene.ray_cast(self.depsgraph, eye, aim)
                if not hit or normal.dot(aim) > 0:
                    lost += 1
                    if lost > limit:
                        return False
                    continue
                things.add(thing.name)
                depths.append((point - eye).length / length)
        if len(things) < min_things and self.random.random() > PLAIN_SHARE:
            return False
        low, median, high = np.percentile(depths, (5, 50, 95))
        near = np.mean(np.array(depths) < TOO_NEAR_M)
        return bool(near <= MAX_TOO_NEAR and high / low >= MIN_SPREAD and median >= min_median_m)
