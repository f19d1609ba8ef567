"""Shapes with rounded edges, each an object with a label and a material.

Meters; x to the right, y into the room, z up. A shape's `at` is the middle of its lower side.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from random import Random

import bpy
import numpy as np
from mathutils import Euler, Matrix, Vector, noise

from nunet_models.classes import CLASSES_13 as CLASSES

Point = Sequence[float]


@dataclass(frozen=True)
class Maker:
    """Makes shapes with one label in its own coordinate frame."""

    random: Random
    label: str = "objects"
    frame: Matrix = field(default_factory=lambda: Matrix.Identity(4))

    def at(self, x: float, y: float, z: float = 0.0, *, turn: float = 0.0) -> Maker:
        """A maker whose origin is there, turned counter-clockwise (degrees, seen from above)."""
        moved = Matrix.Translation((x, y, z)) @ Matrix.Rotation(math.radians(turn), 4, "Z")
        return replace(self, frame=self.frame @ moved)

    def of(self, label: str) -> Maker:
        """The same place, another label."""
        return replace(self, label=label)

    def add(
        self,
        points: np.ndarray,
        faces: Sequence[Sequence[int]],
        material: bpy.types.Material,
        *,
        at: Point = (0, 0, 0),
        tilt: Point = (0, 0, 0),
    ) -> bpy.types.Object:
        """Add a mesh; `tilt` rotates it about x, y and z (degrees) before translation."""
        mesh = bpy.data.meshes.new(self.label)
        mesh.from_pydata([tuple(map(float, point)) for point in points], [], list(faces))
        mesh.polygons.foreach_set("use_smooth", np.ones(len(mesh.polygons), bool))
        mesh.materials.append(material)
        made = bpy.data.objects.new(self.label, mesh)
        turned = Euler([math.radians(angle) for angle in tilt]).to_matrix().to_4x4()
        made.matrix_world = self.frame @ Matrix.Translation(at) @ turned
        made.pass_index = CLASSES.index(self.label) + 1
        bpy.context.scene.collection.objects.link(made)
        return made

    def box(
        self,
        size: Point,
        at: Point,
        material: bpy.types.Material,
        *,
        bevel: float = 0.004,
        tilt: Point = (0, 0, 0),
    ) -> bpy.types.Object:
        """A box with beveled edges that stands on `at`."""
        corners = [(i & 1, i >> 1 & 1, i >> 2) for i in range(8)]
        points = (np.array(corners) - (0.5, 0.5, 0)) * size
        faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
        made = self.add(points, faces, material, at=at, tilt=tilt)
        if bevel > 0:
            modifier = made.modifiers.new("bevel", "BEVEL")
            modifier.width = min(bevel, 0.4 * min(size))
            modifier.segments = 2
            modifier.harden_normals = True
        else:
            made.data.polygons.foreach_set("use_smooth", np.zeros(6, bool))
        return made

    def lathe(
        self,
        outline: Sequence[tuple[float, float]],
        at: Point,
        material: bpy.types.Material,
        *,
        tilt: Point = (0, 0, 0),
        sides: int = 28,
    ) -> bpy.types.Object:
        """A turned shape: (radius, height) from below to above; sharp edges where it bends."""
        angles = np.linspace(0, 2 * np.pi, sides, endpoint=False)
        rings = [(r * np.cos(angles), r * np.sin(angles), np.full(sides, z)) for r, z in outline]
        points = np.concatenate([np.stack(ring, axis=1) for ring in rings])
        faces: list[Sequence[int]] = []
        for ring in range(len(outline) - 1):
            low, high = ring * sides, (ring + 1) * sides
            for i in range(sides):
                j = (i + 1) % sides
                faces.append((low + i, low + j, high + j, high + i))
        faces.append(range(sides - 1, -1, -1))
        faces.append(range(len(points) - sides, len(points)))
        made = self.add(points, faces, material, at=at, tilt=tilt)
        made.data.set_sharp_from_angle(angle=math.radians(35))
        return made

    def cylinder(
        self, radius: float, height: float, at: Point, material: bpy.types.Material
    ) -> bpy.types.Object:
        """An upright cylinder with softened rims."""
        soft = min(0.004, radius * 0.3, height * 0.3)
        outline = [(radius - soft, 0), (radius, soft), (radius, height - soft)]
        return self.lathe([*outline, (radius - soft, height)], at, material)

    def rod(
        self, start: Point, end: Point, radius: float, material: bpy.types.Material
    ) -> bpy.types.Object:
        """A round bar between two points."""
        along = Vector(end) - Vector(start)
        made = self.lathe([(radius, 0), (radius, along.length)], start, material, sides=14)
        turned = along.to_track_quat("Z", "Y").to_matrix().to_4x4()
        made.matrix_world = self.frame @ Matrix.Translation(start) @ turned
        return made

    def soft(
        self,
        size: Point,
        at: Point,
        material: bpy.types.Material,
        *,
        radius: float = 0.05,
        puff: float = 0.0,
        pinch: float = 0.0,
        wrinkle: float = 0.0,
        tilt: Point = (0, 0, 0),
    ) -> bpy.types.Object:
        """A stuffed box: rounded by `radius`, swollen by `puff` in the middle of its wide sides.

        `pinch` (0 to 1) makes it thin toward its rim, as a cushion; `wrinkle` is the height of
        folds in meters.
        """
        half = np.array(size) / 2
        radius = min(radius, 0.98 * float(half.min()))
        points, faces = _grid_box(half, radius)
        inner = np.clip(points, radius - half, half - radius)
        out = points - inner
        points = inner + radius * out / np.linalg.norm(out, axis=1, keepdims=True)
        x, y = points[:, 0] / half[0], points[:, 1] / half[1]
        middle = (1 - x**2) * (1 - y**2)
        rim = np.maximum(np.abs(x), np.abs(y)) ** 3
        points[:, 2] *= 1 - pinch * rim
        points[:, 2] += np.sign(points[:, 2]) * puff * middle
        if wrinkle:
            start = Vector([self.random.uniform(0, 50) for _ in range(3)])
            folds = [noise.fractal(Vector(point) * 6 + start, 1.0, 2.0, 3) for point in points]
            outwards = points / np.linalg.norm(points, axis=1, keepdims=True)
            points += wrinkle * np.array(folds)[:, None] * outwards
        points[:, 2] += half[2]
        return self.add(points, faces, material, at=at, tilt=tilt)

    def curtain(
        self, width: float, height: float, at: Point, material: bpy.types.Material
    ) -> bpy.types.Object:
        """Hanging cloth along x with folds that open downwards."""
        columns, rows = max(24, int(width / 0.012)), 12
        x = np.linspace(-width / 2, width / 2, columns)
        pitch = self.random.uniform(0.09, 0.11)
        phase = 2 * np.pi * x / pitch + 1.3 * np.sin(x * 9 + self.random.uniform(0, 6))
        points = []
        for row in range(rows):
            z = row / (rows - 1)
            depth = 0.036 * (1.15 - 0.5 * z)
            sway = 0.25 * np.sin(3 * z + x * 4)
            points.append(
                np.stack([x * (1.03 - 0.06 * z), depth * np.sin(phase + sway), 0 * x + z * height])
            )
        faces = [
            (r * columns + c, r * columns + c + 1, (r + 1) * columns + c + 1, (r + 1) * columns + c)
            for r in range(rows - 1)
            for c in range(columns - 1)
        ]
        return self.add(np.concatenate(points, axis=1).T, faces, material, at=at)


def _grid_box(half: np.ndarray, radius: float) -> tuple[np.ndarray, list[tuple[int, ...]]]:
    """Points and faces of a box, with more lines where the rounding is."""
    lines = []
    for extent in half:
        bend = extent - radius * np.cos(np.linspace(0, np.pi / 2, 6)) ** 2
        flat = max(2, int((extent - radius) / 0.035))
        positive = np.concatenate([np.linspace(0, extent - radius, flat)[:-1], bend])
        lines.append(np.unique(np.concatenate([-positive, positive]).round(7)))
    index: dict[tuple[float, ...], int] = {}
    faces = []
    for axis in range(3):
        first, second = (axis + 1) % 3, (axis + 2) % 3
        for side in (-half[axis], half[axis]):
            for a, b in zip(lines[first][:-1], lines[first][1:], strict=True):
                for c, d in zip(lines[second][:-1], lines[second][1:], strict=True):
                    face = []
                    for u, v in ((a, c), (b, c), (b, d), (a, d)):
                        point = [0.0, 0.0, 0.0]
                        point[axis], point[first], point[second] = round(float(side), 7), u, v
                        face.append(index.setdefault(tuple(map(float, point)), len(index)))
                    faces.append(tuple(face if side > 0 else face[::-1]))
    return np.array(list(index), dtype=float), faces
