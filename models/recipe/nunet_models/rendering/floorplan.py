"""Where furniture stands: rectangles on a floor that do not overlap. Needs no Blender."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from random import Random

import numpy as np

SIDES = ("far", "right", "near", "left")
ATTEMPTS = 25


@dataclass(frozen=True)
class Rectangle:
    """A rectangle on the floor: center, width along its own x, depth along its own y, turn."""

    x: float
    y: float
    width: float
    depth: float
    turn_deg: float = 0.0

    def axes(self) -> np.ndarray:
        """Unit vectors along width and depth, `[2, 2]`."""
        angle = math.radians(self.turn_deg)
        return np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])

    def corners(self) -> np.ndarray:
        """`[4, 2]` in meters."""
        half = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2 * (self.width, self.depth)
        return half @ self.axes() + (self.x, self.y)

    def overlaps(self, other: Rectangle) -> bool:
        """Whether two rectangles share area (separating axes)."""
        mine, theirs = self.corners(), other.corners()
        for axis in (*self.axes(), *other.axes()):
            a, b = mine @ axis, theirs @ axis
            if a.max() <= b.min() or b.max() <= a.min():
                return False
        return True


@dataclass
class FloorPlan:
    """A rectangular floor with its corner at the origin, and what is taken of it."""

    width: float
    depth: float
    random: Random
    taken: list[Rectangle] = field(default_factory=list)

    def is_free(self, place: Rectangle) -> bool:
        """Whether a rectangle lies on the floor and overlaps nothing."""
        corners = place.corners()
        inside = (corners >= -1e-6).all() and (
            corners <= (self.width + 1e-6, self.depth + 1e-6)
        ).all()
        return bool(inside) and not any(place.overlaps(other) for other in self.taken)

    def reserve(self, place: Rectangle) -> None:
        """Take a rectangle, whether it is free or not (doorways, walkways)."""
        self.taken.append(place)

    def wall_length(self, side: str) -> float:
        """Length of a wall."""
        return self.width if side in ("far", "near") else self.depth

    def along_wall(
        self, side: str, x: float, width: float, depth: float, gap: float = 0.0
    ) -> Rectangle:
        """The rectangle of a thing centered at `x` along a wall, its back `gap` before the wall."""
        y = gap + depth / 2
        return {
            "far": Rectangle(x, self.depth - y, width, depth, 0),
            "right": Rectangle(self.width - y, self.depth - x, width, depth, -90),
            "near": Rectangle(self.width - x, y, width, depth, 180),
            "left": Rectangle(y, x, width, depth, 90),
        }[side]

    def against_wall(
        self, width: float, depth: float, *, sides: tuple[str, ...] = SIDES, gap: float = 0.02
    ) -> tuple[str, float] | None:
        """Take a free place at a wall; the wall and the place's center along it."""
        for _ in range(ATTEMPTS):
            side = self.random.choice(sides)
            low, high = width / 2 + 0.02, self.wall_length(side) - width / 2 - 0.02
            if high < low:
                continue
            x = self.random.uniform(low, high)
            place = self.along_wall(side, x, width, depth + 0.02, gap)
            if self.is_free(place):
                self.taken.append(place)
                return side, x
        return None

    def free_place(
        self, width: float, depth: float, *, turn_deg: float | None = None
    ) -> Rectangle | None:
        """Take a free place anywhere on the floor, at a random turn unless one is given."""
        for _ in range(ATTEMPTS):
            turn = self.random.uniform(0, 360) if turn_deg is None else turn_deg
            x, y = self.random.uniform(0, self.width), self.random.uniform(0, self.depth)
            place = Rectangle(x, y, width, depth, turn)
            if self.is_free(place):
                self.taken.append(place)
                return place
        return None
