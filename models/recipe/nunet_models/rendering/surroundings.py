"""What surrounds the furniture of a random room: surfaces, openings, a second room, light."""

from __future__ import annotations

import math
from random import Random

import bpy

from nunet_models.rendering import materials, shell
from nunet_models.rendering.floorplan import SIDES
from nunet_models.rendering.furnisher import TONES, Furnisher
from nunet_models.rendering.shapes import Maker

SUN_AZIMUTHS_DEG = {"far": 180, "right": 90, "near": 0, "left": -90}


def _color(random: Random, low: float, high: float, tint: float) -> tuple[float, float, float]:
    base = random.uniform(low, high)
    return tuple(min(0.9, max(0.01, base * (1 + random.uniform(-tint, tint)))) for _ in range(3))


def wall_surface(random: Random) -> bpy.types.Material:
    """A random wall: mostly plaster."""
    kind = random.random()
    if kind < 0.7:
        return materials.plaster(_color(random, 0.25, 0.8, random.choice((0.05, 0.2, 0.6))))
    if kind < 0.8:
        size = random.choice(((0.24, 0.08), (0.4, 0.2), (1.2, 0.6), (0.1, 2.4)))
        return materials.bricks(_color(random, 0.1, 0.6, 0.4), _color(random, 0.3, 0.6, 0.05), size)
    if kind < 0.9:
        return materials.concrete(_color(random, 0.2, 0.5, 0.1))
    first, second = _color(random, 0.2, 0.7, 0.4), _color(random, 0.2, 0.7, 0.4)
    return materials.striped(first, second, random.uniform(0.05, 0.3), random.choice("xz"))


def floor_surface(random: Random) -> bpy.types.Material:
    """A random floor."""
    kind = random.random()
    if kind < 0.35:
        return materials.floorboards(random.choice(TONES))
    if kind < 0.55:
        return materials.carpet(_color(random, 0.05, 0.4, 0.3))
    if kind < 0.72:
        return materials.tiles(
            _color(random, 0.1, 0.7, 0.15), random.choice((0.15, 0.3, 0.45, 0.6))
        )
    if kind < 0.92:
        return materials.concrete(_color(random, 0.1, 0.5, 0.2))
    return materials.checkered(
        _color(random, 0.02, 0.2, 0.3),
        _color(random, 0.3, 0.7, 0.2),
        random.choice((0.2, 0.3, 0.5)),
    )


def add_openings(
    f: Furnisher, windows: float
) -> tuple[dict[str, shell.WallOpening], tuple[str, shell.WallOpening] | None]:
    """Windows by wall, and a doorway on a wall without a window."""
    random, room = f.random, f.room
    holes: dict[str, shell.WallOpening] = {}
    sides = list(SIDES)
    random.shuffle(sides)
    for side in sides[: random.choice((1, 1, 2)) if random.random() < windows else 0]:
        length = f.plan.wall_length(side)
        width = min(random.uniform(0.7, 3.0), length - 0.8)
        if width < 0.5:
            continue
        left = random.uniform(0.4, length - width - 0.4)
        sill = random.choice((0.15, random.uniform(0.7, 1.1)))
        if room.height > 3.2:
            sill += room.height - 3.2
        holes[side] = shell.WallOpening(
            left, left + width, sill, min(sill + random.uniform(1.0, 1.9), room.height - 0.2)
        )
        f.walls_taken.append((side, left - 0.3, left + width + 0.3))
    side = sides[-1]
    length = f.plan.wall_length(side)
    left = random.uniform(0.2, max(0.21, length - 1.3))
    f.walls_taken.append((side, left - 0.15, left + 1.1))
    f.plan.reserve(f.plan.along_wall(side, left + 0.45, 1.0, 0.9))
    if random.random() < 0.5 or length < 1.5:
        facing, _ = room.wall(f.maker, side)
        if length > 1.2:
            shell.door(facing, left)
            shell.switch(facing, left + 1.05, 1.08)
        return holes, None
    return holes, (side, shell.WallOpening(left, left + random.uniform(0.8, 1.0), 0, 2.05))


def add_annex(f: Furnisher, side: str, hole: shell.WallOpening) -> None:
    """A second room behind a doorway."""
    random = f.random
    facing, _ = f.room.wall(f.maker, side)
    width, depth = random.uniform(1.6, 4), random.uniform(1.5, 5)
    offset = hole.left - random.uniform(0.2, width - 1.3)
    thick = 2 * shell.WALL_THICKNESS - 0.04
    annex = shell.Shell(width, depth, min(f.room.height, 2.6))
    # A little lower, so that floors and ceilings that overlap are not in one plane.
    behind = facing.at(offset, thick, -0.003)
    mirrored = shell.WallOpening(
        width - (hole.right - offset), width - (hole.left - offset), 0, hole.top
    )
    annex.build(
        behind,
        floor=floor_surface(random),
        paint={"all": wall_surface(random)},
        openings={"near": mirrored},
    )
    line_doorway(facing, hole, thick)
    shell.ceiling_lamp(
        behind.at(width / 2, depth / 2), annex.height, random.choice((0, 15, 40, 60))
    )
    inner = Furnisher(behind, annex, f.photos)
    inner.plan.reserve(
        inner.plan.along_wall("near", (mirrored.left + mirrored.right) / 2, 1.0, 0.9)
    )
    inner.cupboard()
    inner.boxes()


def line_doorway(facing: Maker, hole: shell.WallOpening, thick: float) -> None:
    """White boards on the sides and the top of a doorway in a wall."""
    white = materials.paint(shell.WHITE_PAINT)
    frame = facing.of("wall")
    for x in (hole.left + 0.015, hole.right - 0.015):
        frame.box((0.03, thick + 0.04, hole.top), (x, thick / 2, 0), white)
    size = (hole.right - hole.left, thick + 0.04, 0.03)
    frame.box(size, ((hole.left + hole.right) / 2, thick / 2, hole.top - 0.03), white)


def add_light(
    f: Furnisher, panels: float, holes: dict[str, shell.WallOpening]
) -> tuple[float, float, float]:
    """Windows, sun and lamps; the ambient light in place of further bounces."""
    random, room = f.random, f.room
    area = room.width * room.depth
    day = bool(holes) and random.random() < 0.65
    for side, hole in holes.items():
        facing, _ = room.wall(f.maker, side)
        glass = (hole.right - hole.left) * (hole.top - hole.sill)
        view = random.uniform(1.5, 5) if day else random.uniform(0.0, 0.05)
        daylight = glass * random.uniform(30, 70) if day else 0
        shell.window(
            facing,
            hole,
            daylight=daylight,
            view=view,
            casements=max(1, round((hole.right - hole.left) / 0.8)),
        )
        if random.random() < 0.4 and hole.left > 0.35:
            shell.curtains(facing, hole, f.cloth(), width=random.uniform(0.3, 0.5), floor_gap=0.03)
        if random.random() < 0.3 and hole.sill > 0.6:
            shell.radiator(facing, hole.left + 0.05, hole.right - 0.05)
            f.plan.reserve(
                f.plan.along_wall(side, (hole.left + hole.right) / 2, hole.right - hole.left, 0.14)
            )
    if day and random.random() < 0.5:
        side = random.choice(list(holes))
        shell.sun(
            (random.uniform(15, 50), SUN_AZIMUTHS_DEG[side] + random.uniform(-40, 40)),
            random.uniform(5, 25),
        )
    lamps = 0.0 if day and random.random() < 0.45 else random.uniform(1.5, 5)
    if not day and random.random() < 0.2:
        lamps = 0.6
    if random.random() < panels:
        _panels(f, lamps)
    else:
        for _ in range(1 + int(area > 25) + int(area > 60)):
            x, y = (random.uniform(0.3, 0.7) * length for length in (room.width, room.depth))
            shell.ceiling_lamp(f.maker.at(x, y), room.height, lamps * area / (1 + int(area > 25)))
    level = random.uniform(0.08, 0.25) * (1.0 if day else 0.7 * math.sqrt(lamps / 3))
    warm = (0.95, 1.0, 1.05) if day else (1.1, 1.0, 0.85)
    return tuple(level * channel for channel in warm)


def _panels(f: Furnisher, watts_per_m2: float) -> None:
    """Square light panels in a grid at the ceiling."""
    room, random = f.room, f.random
    columns, rows = max(1, int(room.width / 2.8)), max(1, int(room.depth / 2.8))
    watts = watts_per_m2 * room.width * room.depth / (columns * rows)
    glow = materials.glowing((1.0, 0.97, 0.92), 6 if watts else 0.0)
    long = random.random() < 0.4
    size = (1.2, 0.25) if long else (0.6, 0.6)
    for i in range(columns):
        for k in range(rows):
            x, y = room.width * (i + 0.5) / columns, room.depth * (k + 0.5) / rows
            f.maker.of("objects").box((*size, 0.03), (x, y, room.height - 0.03), glow, bevel=0)
            # Many lamps cost time; a few of them light as much.
            if watts and (i + k) % 2 == 0:
                lamp = bpy.data.lights.new("panel", "AREA")
                lamp.shape, lamp.size, lamp.size_y = "RECTANGLE", *size
                lamp.energy, lamp.color = 2 * watts, (1.0, 0.96, 0.9)
                made = bpy.data.objects.new("panel", lamp)
                made.matrix_world = f.maker.at(x, y, room.height - 0.04).frame
                made.visible_camera = made.visible_glossy = False
                bpy.context.scene.collection.objects.link(made)
