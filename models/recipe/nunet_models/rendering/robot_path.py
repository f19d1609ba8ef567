"""A robot's smooth path at constant speed, through waypoints or random. Needs no Blender."""

from __future__ import annotations

import math
from random import Random

import numpy as np

STEP_M = 0.01
LOOK_AHEAD_M = 0.45
"""A robot turns toward the point of its path that lies this far ahead."""
MARGIN_M = 0.4
"""Between a random path and the walls."""
BETWEEN_M = (0.5, 1.0)
"""Range of the distance between the waypoints of a random path."""
TURN_DEG = 35.0
"""Standard deviation of the change of direction at such a waypoint."""
ATTEMPTS = 50
CHECKED_EVERY = 3
"""Frames between two that are checked for things too near to the camera."""
SHOWING = 5
"""Frames of a video, evenly spread from the first to the last, that must show things."""


class RobotPath:
    """Waypoints on the floor, `[N, 2]` meters, joined by a curve (centripetal Catmull-Rom)."""

    def __init__(self, waypoints: np.ndarray) -> None:
        points = np.asarray(waypoints, float)
        if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2:
            raise ValueError(f"waypoints have shape {points.shape}, expected (N, 2) with N >= 2")
        # Ends are extended in a straight line, so that the curve passes through all waypoints.
        first, last = 2 * points[0] - points[1], 2 * points[-1] - points[-2]
        padded = np.vstack([first, points, last])
        dense = [_segment(*padded[i : i + 4]) for i in range(len(points) - 1)]
        curve = np.vstack([*dense, points[-1:]])
        lengths = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
        self.length_m = float(lengths[-1])
        self._s = np.arange(0, self.length_m + STEP_M, STEP_M)
        self._points = np.stack([np.interp(self._s, lengths, curve[:, k]) for k in (0, 1)], axis=1)

    def point(self, s_m: float) -> np.ndarray:
        """The point at a distance along the path, `[2]`; the ends hold beyond them."""
        return np.array([np.interp(s_m, self._s, self._points[:, k]) for k in (0, 1)])

    def heading_deg(self, s_m: float) -> float:
        """Where the robot looks at a distance along the path, to the left of +y, averaged."""
        # Near the end the target is on the last straight, which keeps the direction defined.
        ahead = min(s_m + LOOK_AHEAD_M, self.length_m)
        behind = min(max(s_m - 0.15, 0.0), self.length_m - LOOK_AHEAD_M)
        x, y = self.point(ahead) - self.point(behind)
        return math.degrees(math.atan2(-x, y))

    def samples(self, spacing_m: float) -> np.ndarray:
        """Points along the path, `[N, 2]`."""
        return np.array([self.point(s) for s in np.arange(0, self.length_m, spacing_m)])


def random_path(random: Random, size: tuple[float, float], length_m: float) -> RobotPath | None:
    """A path of at least this length in a room whose corner is at the origin; none if none fits."""
    for _ in range(ATTEMPTS):
        waypoints = _random_waypoints(random, size, length_m)
        if waypoints is not None:
            path = RobotPath(waypoints)
            # Between waypoints, the curve may come nearer to a wall than they do.
            if all(_is_inside(point, size) for point in path.samples(0.05)):
                return path
    return None


def checked_frames(frames: int) -> list[tuple[int, bool]]:
    """Frames of a video to check before it is rendered, and whether each must show things.

    Those that must come first, because they refuse most paths, and the last frame before all.
    """
    showing = {round(place) for place in np.linspace(0, frames - 1, SHOWING)}
    others = set(range(0, frames, CHECKED_EVERY)) - showing
    first = [(frame, True) for frame in sorted(showing, reverse=True)]
    return first + [(frame, False) for frame in sorted(others)]


def _random_waypoints(
    random: Random, size: tuple[float, float], length_m: float
) -> np.ndarray | None:
    """Waypoints `[N, 2]`, of which each is ahead of the one before; none if a wall stops them."""
    points = [np.array([random.uniform(MARGIN_M, side - MARGIN_M) for side in size])]
    heading, left_m = random.uniform(0, 360), length_m
    while left_m > 0:
        for _ in range(ATTEMPTS):
            turned = heading + random.gauss(0, TURN_DEG)
            step_m, angle = random.uniform(*BETWEEN_M), math.radians(turned)
            point = points[-1] + step_m * np.array([math.cos(angle), math.sin(angle)])
            if _is_inside(point, size):
                break
        else:
            return None
        points.append(point)
        heading, left_m = turned, left_m - step_m
    return np.array(points)


def _is_inside(point: np.ndarray, size: tuple[float, float]) -> bool:
    return all(
        MARGIN_M <= value <= side - MARGIN_M for value, side in zip(point, size, strict=True)
    )


def _segment(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """The curve from b to c, without c (Barry and Goldman's form)."""
    knots = np.cumsum([0, *(math.sqrt(np.linalg.norm(q - p)) for p, q in ((a, b), (b, c), (c, d)))])
    t = np.linspace(knots[1], knots[2], 60, endpoint=False)[:, None]

    def blend(p: np.ndarray, q: np.ndarray, start: float, end: float) -> np.ndarray:
        return ((end - t) * p + (t - start) * q) / (end - start)

    first = blend(a, b, knots[0], knots[1])
    second = blend(b, c, knots[1], knots[2])
    third = blend(c, d, knots[2], knots[3])
    lower = blend(first, second, knots[0], knots[2])
    upper = blend(second, third, knots[1], knots[3])
    return blend(lower, upper, knots[1], knots[2])
