"""The drive's world: a living room, a corridor and an office, doors open, obstacles on the way."""

from __future__ import annotations

from random import Random

import numpy as np

from nunet_models.rendering import (
    clutter,
    equipment,
    furniture,
    materials,
    people,
    shell,
    surroundings,
)
from nunet_models.rendering.floorplan import Rectangle
from nunet_models.rendering.furnisher import Furnisher
from nunet_models.rendering.robot_path import RobotPath
from nunet_models.rendering.shapes import Maker

SEED = "drive 5"
WALL_M = 2 * shell.WALL_THICKNESS - 0.04
LIVING = shell.Shell(4.8, 5.0, 2.55)
CORRIDOR = shell.Shell(7.2, 1.9, 2.5)
OFFICE = shell.Shell(5.0, 4.8, 2.6)
CORRIDOR_AT = (2.2, LIVING.depth + WALL_M)
OFFICE_AT = (5.2, LIVING.depth + WALL_M + CORRIDOR.depth + WALL_M)
FIRST_DOOR = (3.05, 4.0)
SECOND_DOOR = (7.3, 8.3)
"""Left and right ends of the doorways on the world's x."""
DOOR_TOP_M = 2.05

WAYPOINTS = np.array(
    [
        (1.0, 0.6),
        (1.3, 1.6),
        (2.2, 2.35),
        (2.75, 3.3),
        (3.4, 4.2),
        (3.52, 5.0),
        (3.62, 5.7),
        (4.3, 6.35),
        (5.3, 6.4),
        (6.2, 6.05),
        (7.1, 6.05),
        (7.75, 6.7),
        (7.8, 7.6),
        (7.5, 8.5),
        (7.8, 9.3),
        (7.7, 9.95),
    ]
)
CLEARANCE_M = 0.62
"""Furniture that is placed at random leaves a lane of this width."""


def build() -> tuple[RobotPath, tuple[float, float, float]]:
    """Build the world in the open scene; the robot's path and the ambient light."""
    random, path = Random(SEED), RobotPath(WAYPOINTS)
    maker = Maker(random)
    _living(maker, path)
    _corridor(maker.at(*CORRIDOR_AT, -0.003), path)
    _office(maker.at(*OFFICE_AT), path)
    _door_frames(maker)
    return path, (0.17, 0.175, 0.18)


def _furnisher(
    maker: Maker, room: shell.Shell, at: tuple[float, float], path: RobotPath
) -> Furnisher:
    """A furnisher that leaves the robot's lane free."""
    made = Furnisher(maker, room, [])
    for x, y in path.samples(0.2) - at:
        made.plan.reserve(Rectangle(x, y, CLEARANCE_M, CLEARANCE_M))
    return made


def _keep(f: Furnisher, x: float, y: float, width: float, depth: float) -> Maker:
    """Reserve a place by hand; a maker in its middle."""
    f.plan.reserve(Rectangle(x, y, width, depth))
    return f.maker.at(x, y)


def _living(maker: Maker, path: RobotPath) -> None:
    room = LIVING
    hole = shell.WallOpening(1.6, 3.4, 0.85, 2.2)
    door = shell.WallOpening(*FIRST_DOOR, 0, DOOR_TOP_M)
    room.build(
        maker,
        floor=materials.floorboards((0.33, 0.2, 0.1)),
        paint={
            "all": materials.plaster((0.62, 0.57, 0.47)),
            "left": materials.plaster((0.36, 0.42, 0.38)),
        },
        openings={"left": [hole], "far": [door]},
    )
    left, _ = room.wall(maker, "left")
    shell.window(left, hole, daylight=110, view=3.0, casements=2)
    cloth = materials.fabric((0.5, 0.43, 0.33), 240, 0.15)
    shell.curtains(left, hole, cloth, width=0.45, floor_gap=0.03)
    shell.radiator(left, 1.8, 3.2)
    shell.sun((34, -100), 14)
    shell.ceiling_lamp(maker.at(2.4, 2.5), room.height, 60)
    _furnish_living(maker, path)


def _furnish_living(maker: Maker, path: RobotPath) -> None:
    room = LIVING
    f = _furnisher(maker, room, (0, 0), path)
    f.plan.reserve(f.plan.along_wall("left", 2.5, 1.9, 0.16))
    place = _keep(f, 1.25, 2.75, 0.7, 1.1)
    furniture.low_table(place.at(0, 0, turn=90), (1.0, 0.55, 0.42), (0.36, 0.22, 0.11))
    clutter.mug(place.at(0.1, 0.2, 0.42, turn=40), (0.5, 0.1, 0.05))
    clutter.pile(place.at(-0.05, -0.2, 0.42), 3)
    chairs = _keep(f, 3.6, 2.5, 1.5, 1.5)
    furniture.table(chairs, (0.9, 0.9, 0.75), (0.15, 0.08, 0.045))
    blue = materials.fabric((0.07, 0.14, 0.22), 230, 0.3)
    for x, y, turn in ((-0.62, 0.05, -95), (0.05, -0.62, 172), (0.1, 0.62, 12)):
        furniture.chair(chairs.at(x, y, turn=turn), (0.36, 0.22, 0.11), blue)
    equipment.small_thing(chairs.at(0.1, 0.1, 0.75))
    clutter.bowl(chairs.at(-0.2, -0.15, 0.75), (0.2, 0.3, 0.32))
    equipment.box(_keep(f, 1.75, 0.95, 0.36, 0.3).at(0, 0, turn=20), (0.34, 0.28, 0.26))
    clutter.slippers(_keep(f, 1.55, 3.75, 0.3, 0.3).at(0, 0, turn=60), (0.12, 0.13, 0.16))
    equipment.cable(maker.at(1.1, 2.0, turn=-8), 2.0)
    f.plan.reserve(f.plan.along_wall("far", 3.5, 1.2, 0.9))
    right, _ = room.wall(maker, "right")
    f.plan.reserve(f.plan.along_wall("right", 1.1, 1.4, 0.45))
    side = right.at(1.1, -0.01)
    furniture.cupboard(side, (1.3, 0.4, 0.75), (0.5, 0.33, 0.17), doors=3, drawers=1)
    clutter.table_lamp(side.at(-0.4, -0.2, 0.75), 6)
    clutter.plant(side.at(0.4, -0.2, 0.75), 0.45, 16, pot=0.08)
    furniture.painting(right, 1.1, 1.4, (0.9, 0.6), 4)
    for call in (f.sofa, f.cupboard, f.bookcase, f.bookcase, f.floor_lamp, f.cupboard):
        call()
    for call in (f.floor_thing, f.floor_thing, f.wall_decoration, f.wall_decoration):
        call()


def _corridor(maker: Maker, path: RobotPath) -> None:
    room, (x0, _) = CORRIDOR, CORRIDOR_AT
    near = shell.WallOpening(
        room.width - (FIRST_DOOR[1] - x0), room.width - (FIRST_DOOR[0] - x0), 0, DOOR_TOP_M
    )
    far = shell.WallOpening(SECOND_DOOR[0] - x0, SECOND_DOOR[1] - x0, 0, DOOR_TOP_M)
    room.build(
        maker,
        floor=materials.tiles((0.5, 0.47, 0.42), 0.45),
        paint={
            "all": materials.plaster((0.66, 0.65, 0.6)),
            "right": materials.plaster((0.5, 0.3, 0.2)),
        },
        openings={"near": [near], "far": [far]},
    )
    for x in (1.4, 4.4, 6.4):
        shell.ceiling_lamp(maker.at(x, 0.95), room.height, 32)
    f = _furnisher(maker, room, CORRIDOR_AT, path)
    stack = _keep(f, 2.9, 0.42, 0.6, 0.5)
    equipment.box_stack(stack.at(0, 0, turn=8), 0.5, 0.42, 0.85)
    equipment.box(_keep(f, 3.5, 1.25, 0.34, 0.3).at(0, 0, turn=-15), (0.32, 0.26, 0.2))
    people.person(_keep(f, 6.2, 0.5, 0.5, 0.5).at(0, 0, turn=-75))
    equipment.bag(_keep(f, 4.5, 1.62, 0.4, 0.3))
    far_wall, _ = room.wall(maker, "far")
    shell.door(far_wall, 1.1)
    right, _ = room.wall(maker, "right")
    furniture.painting(right, 0.95, 1.2, (0.6, 0.8), 6)
    furniture.painting(far_wall, 3.7, 1.15, (0.9, 0.6), 9)
    near_wall, length = room.wall(maker, "near")
    furniture.cupboard(near_wall.at(length - 4.3, -0.01), (1.0, 0.3, 0.9), None, doors=2)
    clutter.plant(near_wall.at(length - 4.6, -0.16, 0.9), 0.4, 14, pot=0.07)
    clutter.plant(_keep(f, 6.85, 1.5, 0.4, 0.4), 1.1, 22, pot=0.15)
    equipment.cable(maker.at(3.7, 0.75, turn=70), 0.9)
    green = materials.fabric((0.08, 0.2, 0.12), 230, 0.3)
    furniture.chair(_keep(f, 2.55, 1.55, 0.5, 0.5).at(0, 0, turn=-14), (0.15, 0.08, 0.045), green)
    equipment.box(_keep(f, 0.55, 1.5, 0.45, 0.4).at(0, 0, turn=12), (0.42, 0.34, 0.38))
    furniture.painting(far_wall, 2.55, 1.05, (0.5, 0.66), 2)
    shell.switch(far_wall, 2.15, 1.05)


def _office(maker: Maker, path: RobotPath) -> None:
    room, (x0, y0) = OFFICE, OFFICE_AT
    hole = shell.WallOpening(1.2, 3.4, 0.9, 2.15)
    door = shell.WallOpening(
        room.width - (SECOND_DOOR[1] - x0), room.width - (SECOND_DOOR[0] - x0), 0, DOOR_TOP_M
    )
    room.build(
        maker,
        floor=materials.carpet((0.16, 0.19, 0.23)),
        paint={
            "all": materials.plaster((0.6, 0.62, 0.62)),
            "far": materials.plaster((0.3, 0.38, 0.44)),
        },
        openings={"right": [hole], "near": [door]},
    )
    right, _ = room.wall(maker, "right")
    shell.window(right, hole, daylight=90, view=3.0, casements=2)
    shell.ceiling_lamp(maker.at(1.5, 2.4), room.height, 45)
    shell.ceiling_lamp(maker.at(3.6, 2.4), room.height, 45)
    f = _furnisher(maker, room, OFFICE_AT, path)
    f.plan.reserve(f.plan.along_wall("near", room.width - (7.8 - x0), 1.3, 0.8))
    table = _keep(f, 7.3 - x0, 11.25 - y0, 1.9, 1.5)
    furniture.table(table, (1.5, 0.8, 0.74), (0.5, 0.33, 0.17))
    dark = materials.fabric((0.035, 0.037, 0.042), 240, 0.4)
    for x, y, turn in ((-0.35, -0.55, 170), (0.4, -0.6, 200), (-0.3, 0.6, 10), (0.4, 0.6, -8)):
        furniture.chair(table.at(x, y, turn=turn), (0.15, 0.08, 0.045), dark)
    f.small_things(table.at(0, 0, 0.74), 1.5, 0.8, 6)
    chair = _keep(f, 8.55 - x0, 9.0 - y0, 0.6, 0.6)
    furniture.office_chair(chair.at(0, 0, turn=60), dark)
    equipment.box(_keep(f, 6.95 - x0, 9.35 - y0, 0.5, 0.4).at(0, 0, turn=30), (0.4, 0.3, 0.3))
    for call in (f.desk, f.desk, f.bookcase, f.cupboard, f.rack, f.bookcase):
        call()
    for call in (f.floor_thing, f.floor_thing, f.wall_decoration, f.wall_decoration):
        call()


def _door_frames(maker: Maker) -> None:
    """White linings of the doorways and an open door leaf each."""
    white = materials.paint(shell.WHITE_PAINT, 0.35)
    for (left, right), y, hinge, turn in (
        (FIRST_DOOR, LIVING.depth, "left", 97),
        (SECOND_DOOR, CORRIDOR_AT[1] + CORRIDOR.depth, "right", 62),
    ):
        hole = shell.WallOpening(left, right, 0, DOOR_TOP_M)
        surroundings.line_doorway(maker.at(0, y), hole, WALL_M)
        x = left + 0.03 if hinge == "left" else right - 0.03
        leaf = maker.of("wall").at(x, y + WALL_M + 0.02, turn=turn)
        width = right - left - 0.06
        leaf.box((width, 0.04, DOOR_TOP_M - 0.05), (width / 2, 0, 0.01), white)
        steel = materials.metal()
        for side in (-0.05, 0.05):
            leaf.rod((width - 0.06, side, 1.02), (width - 0.17, side, 1.02), 0.009, steel)
