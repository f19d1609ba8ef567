"""A robot's smooth path through waypoints at constant speed. Needs no Blender."""

from __future__ import annotations

import math

import numpy as np

STEP_M = 0.01
LOOK_AHEAD_M = 0.45
"""A robot turns toward the point of its path that lies this far ahead."""


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
