"""What every room has: walls with openings, floor, ceiling, skirting, windows, doors, lamps."""

from __future__ import annotations

import math
from dataclasses import dataclass

import bpy
from mathutils import Matrix

from nunet_models.rendering import images, materials
from nunet_models.rendering.shapes import Maker

WALL_THICKNESS = 0.22
WHITE_PAINT = (0.72, 0.71, 0.68)


@dataclass(frozen=True)
class WallOpening:
    """A window's hole in a wall: from the wall's left end, and heights above the floor."""

    left: float
    right: float
    sill: float
    top: float


@dataclass(frozen=True)
class Shell:
    """An empty room with one corner at the origin, `width` along x, `depth` along y."""

    width: float
    depth: float
    height: float

    def wall(self, maker: Maker, side: str) -> tuple[Maker, float]:
        """A maker that faces a wall from inside, its origin at the wall's left end; its length.

        x runs to the right along the wall, y points into it: the wall's face is y = 0.
        """
        corners = {
            "far": (0, self.depth, 0, self.width),
            "right": (self.width, self.depth, -90, self.depth),
            "near": (self.width, 0, 180, self.width),
            "left": (0, 0, 90, self.depth),
        }
        x, y, turn, length = corners[side]
        return maker.at(x, y, turn=turn), length

    def build(
        self,
        maker: Maker,
        *,
        floor: bpy.types.Material,
        paint: dict[str, bpy.types.Material],
        openings: dict[str, WallOpening | list[WallOpening]],
    ) -> None:
        """Floor, ceiling, four walls with their openings, skirting boards."""
        middle, size = (self.width / 2, self.depth / 2), (self.width + 1, self.depth + 1)
        maker.of("floor").box((*size, 0.2), (*middle, -0.2), floor, bevel=0)
        ceiling = materials.plaster((0.8, 0.79, 0.77))
        maker.of("ceiling").box((*size, 0.2), (*middle, self.height), ceiling, bevel=0)
        white = materials.paint(WHITE_PAINT)
        for side in ("far", "right", "near", "left"):
            facing, length = self.wall(maker.of("wall"), side)
            cover = paint.get(side, paint["all"])
            for left, right, low, high in _around(openings.get(side), length, self.height):
                size_m = (right - left, WALL_THICKNESS, high - low)
                at = ((left + right) / 2, WALL_THICKNESS / 2, low)
                facing.box(size_m, at, cover, bevel=0)
            for left, right, low, _ in _around(openings.get(side), length, self.height):
                if low == 0:
                    start, end = max(left, 0), min(right, length)
                    size_m, at = (end - start, 0.014, 0.085), ((start + end) / 2, -0.007, 0)
                    facing.box(size_m, at, white, bevel=0.006)


def _around(
    holes: WallOpening | list[WallOpening] | None, length: float, height: float
) -> list[tuple[float, float, float, float]]:
    """The pieces of a wall around its openings; the ends reach into the corners."""
    holes = [holes] if isinstance(holes, WallOpening) else sorted(holes or [], key=lambda o: o.left)
    pieces, start = [], -WALL_THICKNESS
    for hole in holes:
        pieces.append((start, hole.left, 0, height))
        pieces += [
            (hole.left, hole.right, low, high)
            for low, high in ((0, hole.sill), (hole.top, height))
            if high > low
        ]
        start = hole.right
    return [*pieces, (start, length + WALL_THICKNESS, 0, height)]


def window(
    facing: Maker, hole: WallOpening, *, daylight: float, view: float, casements: int
) -> None:
    """Frame, pane, sill and the light that comes in; `daylight` in watts, `view` its brightness."""
    facing = facing.of("window")
    white = materials.paint((0.78, 0.78, 0.77), 0.3)
    width, height = hole.right - hole.left, hole.top - hole.sill
    middle, y = (hole.left + hole.right) / 2, 0.14
    for z in (hole.sill, hole.top - 0.06):
        facing.box((width, 0.07, 0.06), (middle, y, z), white)
    for i in range(casements + 1):
        x = hole.left + 0.03 + (width - 0.06) * i / casements
        thickness = 0.06 if i in (0, casements) else 0.09
        facing.box((thickness, 0.065, height), (x, y, hole.sill), white)
    for i in range(1, casements):
        x = hole.left + width * i / casements - 0.035
        handle = materials.metal()
        facing.box((0.02, 0.03, 0.1), (x, y - 0.05, hole.sill + height * 0.45), handle)
    glass = facing.box((width, 0.006, height), (middle, y, hole.sill), materials.pane(), bevel=0)
    glass.visible_shadow = glass.visible_diffuse = False
    facing.of("wall").box(
        (width + 0.14, 0.2, 0.03), (middle, 0.02, hole.sill - 0.03), white, bevel=0.008
    )
    _daylight(facing, (middle, y + 0.06, hole.sill + height / 2), (width, height), daylight)
    outside = images.outdoors(view)
    backdrop = facing.box((40, 0.1, 20), (middle, 9, -8), outside, bevel=0)
    backdrop.visible_shadow = backdrop.visible_diffuse = False


def _daylight(
    facing: Maker, at: tuple[float, float, float], size: tuple[float, float], watts: float
) -> None:
    """The sky's light as a lamp in the window: far less noise than sampling the sky."""
    lamp = bpy.data.lights.new("daylight", "AREA")
    lamp.shape = "RECTANGLE"
    lamp.size, lamp.size_y = size
    lamp.energy = watts
    lamp.color = (0.86, 0.94, 1.0)
    made = bpy.data.objects.new("daylight", lamp)
    # A lamp shines along its -z; tilted a little down, as the sky is above.
    made.matrix_world = (
        facing.frame @ Matrix.Translation(at) @ Matrix.Rotation(math.radians(-72), 4, "X")
    )
    made.visible_camera = made.visible_glossy = False
    bpy.context.scene.collection.objects.link(made)


def sun(direction_deg: tuple[float, float], strength: float) -> None:
    """The sun at a height and an azimuth (degrees; 0 shines toward +y, 90 toward -x)."""
    lamp = bpy.data.lights.new("sun", "SUN")
    lamp.energy, lamp.angle, lamp.color = strength, math.radians(1.2), (1.0, 0.9, 0.76)
    made = bpy.data.objects.new("sun", lamp)
    height, azimuth = direction_deg
    made.rotation_euler = (math.radians(90 - height), 0, math.radians(azimuth))
    bpy.context.scene.collection.objects.link(made)


def ceiling_lamp(maker: Maker, height: float, watts: float) -> None:
    """A flat round lamp below the ceiling and the light that it gives."""
    maker = maker.of("objects")
    shade = materials.glowing((1.0, 0.86, 0.66), 5)
    rim = materials.metal()
    maker.lathe([(0.03, 0), (0.16, 0.008), (0.19, 0.05)], (0, 0, height - 0.075), shade)
    maker.cylinder(0.2, 0.025, (0, 0, height - 0.025), rim)
    lamp = bpy.data.lights.new("ceiling lamp", "AREA")
    lamp.shape, lamp.size = "DISK", 0.36
    lamp.energy, lamp.color = watts, (1.0, 0.85, 0.66)
    made = bpy.data.objects.new("ceiling lamp", lamp)
    made.matrix_world = maker.frame @ Matrix.Translation((0, 0, height - 0.08))
    made.visible_camera = made.visible_glossy = False
    bpy.context.scene.collection.objects.link(made)


def bulb(maker: Maker, at: tuple[float, float, float], watts: float) -> None:
    """A small warm light, as in a table lamp."""
    lamp = bpy.data.lights.new("bulb", "POINT")
    lamp.energy, lamp.color, lamp.shadow_soft_size = watts, (1.0, 0.74, 0.45), 0.06
    made = bpy.data.objects.new("bulb", lamp)
    made.matrix_world = maker.frame @ Matrix.Translation(at)
    made.visible_camera = made.visible_glossy = False
    bpy.context.scene.collection.objects.link(made)


def door(facing: Maker, left: float, *, width: float = 0.86, height: float = 2.02) -> None:
    """A closed paneled door with its casing; NYU's class map counts doors as wall."""
    facing = facing.of("wall")
    white = materials.paint(WHITE_PAINT, 0.35)
    middle = left + width / 2
    facing.box((width, 0.02, height), (middle, -0.01, 0.005), white)
    for z, tall in ((0.14, 0.75), (1.0, 0.86)):
        for x in (-0.2, 0.2):
            facing.box((0.28, 0.012, tall), (middle + x, -0.024, z), white, bevel=0.01)
    for x in (left - 0.04, left + width + 0.04):
        facing.box((0.08, 0.035, height + 0.08), (x, -0.0175, 0), white, bevel=0.006)
    facing.box((width, 0.035, 0.08), (middle, -0.0175, height), white, bevel=0.006)
    steel = materials.metal()
    x = left + width - 0.07
    facing.box((0.04, 0.01, 0.2), (x, -0.025, 0.92), steel)
    facing.rod((x, -0.03, 1.06), (x, -0.075, 1.06), 0.009, steel)
    facing.rod((x + 0.01, -0.07, 1.06), (x - 0.11, -0.07, 1.06), 0.009, steel)


def switch(facing: Maker, x: float, z: float) -> None:
    """A light switch or a socket."""
    white = materials.paint((0.85, 0.85, 0.83), 0.3)
    facing.of("objects").box((0.08, 0.01, 0.08), (x, -0.005, z), white, bevel=0.004)
    facing.of("objects").box((0.055, 0.008, 0.055), (x, -0.012, z + 0.0125), white, bevel=0.003)


def curtains(
    facing: Maker, hole: WallOpening, cloth: bpy.types.Material, *, width: float, floor_gap: float
) -> None:
    """Two drawn-back curtains on a rod."""
    facing = facing.of("window")
    top = hole.top + 0.14
    left, right = hole.left - 0.25, hole.right + 0.25
    steel = materials.metal((0.2, 0.19, 0.18), 0.4)
    facing.rod((left - 0.1, -0.1, top), (right + 0.1, -0.1, top), 0.012, steel)
    for x in (left + width / 2, right - width / 2):
        facing.curtain(width, top - floor_gap, (x, -0.1, floor_gap), cloth)


def radiator(facing: Maker, left: float, right: float) -> None:
    """A ribbed radiator below a window."""
    facing = facing.of("objects")
    white = materials.paint((0.75, 0.75, 0.73), 0.35)
    count = round((right - left) / 0.065)
    for i in range(count):
        x = left + (i + 0.5) * (right - left) / count
        facing.box((0.05, 0.07, 0.5), (x, -0.09, 0.14), white, bevel=0.015)
    facing.box((right - left, 0.03, 0.03), ((left + right) / 2, -0.09, 0.2), white)
    facing.box((right - left, 0.03, 0.03), ((left + right) / 2, -0.09, 0.56), white)
