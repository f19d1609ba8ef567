"""The clip's three rooms: furniture, light, camera motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from random import Random

from nunet_models.rendering import clutter, furniture, materials, shell
from nunet_models.rendering.camera import Motion
from nunet_models.rendering.shapes import Maker

OAK = (0.36, 0.22, 0.11)
WALNUT = (0.15, 0.08, 0.045)
PINE = (0.5, 0.33, 0.17)


@dataclass(frozen=True)
class Shot:
    """How a room is rendered: camera motion, exposure in stops, samples per pixel."""

    motion: Motion
    exposure: float
    samples: int = 8


def living_room(random: Random) -> Shot:
    """Sofa below the window, a television on a sideboard, a bookcase, an armchair."""
    maker = Maker(random)
    room = shell.Shell(4.4, 4.9, 2.6)
    hole = shell.WallOpening(2.55, 4.05, 0.88, 2.2)
    room.build(
        maker,
        floor=materials.floorboards((0.3, 0.17, 0.085)),
        paint={
            "all": materials.plaster((0.62, 0.56, 0.45)),
            "far": materials.plaster((0.42, 0.45, 0.4)),
        },
        openings={"left": hole},
    )
    left, _ = room.wall(maker, "left")
    far, _ = room.wall(maker, "far")
    shell.window(left, hole, daylight=95, view=3.5, casements=2)
    linen = materials.fabric((0.5, 0.43, 0.33), 240, 0.15)
    shell.curtains(left, hole, linen, width=0.5, floor_gap=0.03)
    shell.sun((33, -97), 22)
    shell.ceiling_lamp(maker.at(2.1, 2.6), room.height, 50)
    gray = materials.fabric((0.13, 0.15, 0.17), 230, 0.35)
    seat = left.at(3.3, -0.28)
    furniture.sofa(seat, 2.1, gray)
    _cushions(seat)
    _television_wall(far)
    _bookcase(far.at(3.72, 0))
    furniture.painting(far, 0.72, 1.3, (0.5, 0.66), 3)
    clutter.floor_lamp(maker.at(0.38, 4.5), 9)
    furniture.rug(
        maker.at(1.95, 2.75), (1.7, 2.3), materials.rug((0.4, 0.33, 0.24), (0.26, 0.045, 0.035))
    )
    _coffee_table(maker.at(1.85, 2.75, 0.012, turn=88))
    rust = materials.fabric((0.33, 0.12, 0.05), 230, 0.3)
    armchair = maker.at(3.75, 2.75, turn=-68)
    furniture.sofa(armchair, 0.92, rust)
    clutter.cushion(armchair.at(0.03, -0.4, 0.46, turn=6), linen, size=0.4)
    clutter.plant(maker.at(2.98, 4.55), 1.15, 26, pot=0.15)
    motion = Motion((3.45, 0.3, 1.47), (23, -13), velocity=(-0.22, 0.2, 0.03), turn=(-5, 1.5))
    return Shot(motion, 0.4, samples=16)  # fine patterns in deep shadow need more


def _cushions(seat: Maker) -> None:
    """Cushions and a throw on the living room's sofa."""
    mustard = materials.fabric((0.5, 0.28, 0.04), 240, 0.2)
    stripes = materials.striped((0.62, 0.58, 0.5), (0.08, 0.14, 0.22), 0.05)
    clutter.cushion(seat.at(-0.62, -0.42, 0.47, turn=-14), mustard)
    clutter.cushion(seat.at(0.3, -0.4, 0.47, turn=5), stripes, lean=64)
    clutter.cushion(seat.at(0.66, -0.44, 0.47, turn=18), mustard, size=0.4)
    throw = materials.fabric((0.45, 0.4, 0.34), 200, 0.3)
    seat = seat.at(-0.95, -0.46, 0.35)
    seat.soft((0.26, 0.6, 0.3), (0, 0, 0), throw, radius=0.08, puff=0.01, wrinkle=0.05)


def _television_wall(far: Maker) -> None:
    """A sideboard with a television, a vase and books."""
    side = far.at(2.02, -0.015)
    furniture.cupboard(side, (1.6, 0.42, 0.52), OAK, doors=3, legs=0.09)
    furniture.television(side.at(0.05, -0.2, 0.52), 1.02)
    clutter.vase(side.at(-0.66, -0.2, 0.52), (0.05, 0.16, 0.2), 0.3)
    clutter.pile(side.at(0.68, -0.22, 0.52), 3)


def _bookcase(place: Maker) -> None:
    """A full bookcase."""
    shelves = furniture.bookcase(place, (0.96, 0.3, 2.02), 5, WALNUT)
    clutter.carton(shelves[0].at(-0.22, 0.13), (0.38, 0.24, 0.26), (0.35, 0.3, 0.22))
    clutter.carton(shelves[0].at(0.22, 0.13), (0.38, 0.24, 0.26), (0.12, 0.16, 0.18))
    clutter.books(shelves[1], -0.44, 0.36, 0.31)
    clutter.books(shelves[2], -0.44, -0.06, 0.3)
    clutter.bowl(shelves[2].at(0.24, 0.14), (0.55, 0.5, 0.42), fruit=False)
    clutter.books(shelves[3], -0.3, 0.38, 0.29)
    clutter.books(shelves[4], -0.44, 0.1, 0.27)
    clutter.vase(shelves[4].at(0.3, 0.14), (0.5, 0.16, 0.05), 0.24)
    clutter.plant(shelves[5].at(-0.2, 0.14), 0.34, 18, pot=0.07)
    clutter.pile(shelves[5].at(0.22, 0.14), 4)


def _coffee_table(place: Maker) -> None:
    """A coffee table with mugs, books, a bowl and papers."""
    furniture.low_table(place, (1.1, 0.6, 0.43), OAK)
    top = place.at(0, 0, 0.43)
    clutter.mug(top.at(-0.28, 0.08, turn=200), (0.62, 0.6, 0.55))
    clutter.mug(top.at(-0.12, -0.17, turn=20), (0.05, 0.16, 0.25))
    clutter.pile(top.at(0.33, -0.08, turn=20), 3)
    clutter.bowl(top.at(0.08, 0.1), (0.5, 0.48, 0.42))
    clutter.papers(top.at(-0.35, -0.1, turn=70), 2)
    clutter.pile(place.at(0.1, 0, 0.14), 4)


def bedroom(random: Random) -> Shot:
    """A double bed, a wardrobe, nightstands with a lamp, a chair with clothes."""
    maker = Maker(random)
    room = shell.Shell(4.1, 4.3, 2.5)
    hole = shell.WallOpening(0.45, 1.6, 0.9, 2.1)
    room.build(
        maker,
        floor=materials.carpet((0.32, 0.27, 0.21)),
        paint={
            "all": materials.plaster((0.6, 0.61, 0.58)),
            "far": materials.plaster((0.3, 0.38, 0.44)),
        },
        openings={"right": hole},
    )
    right, _ = room.wall(maker, "right")
    far, _ = room.wall(maker, "far")
    shell.window(right, hole, daylight=85, view=3.5, casements=2)
    cloth = materials.striped((0.6, 0.55, 0.46), (0.42, 0.2, 0.12), 0.09)
    shell.curtains(right, hole, cloth, width=0.42, floor_gap=0.04)
    shell.radiator(right, 0.5, 1.55)
    clutter.plant(right.at(1.2, 0.02, hole.sill), 0.34, 18, pot=0.06)
    shell.sun((38, 99), 22)
    shell.ceiling_lamp(maker.at(1.9, 2.0), room.height, 40)
    duvet = materials.striped((0.62, 0.62, 0.6), (0.16, 0.23, 0.3), 0.11)
    bed = far.at(2.15, -0.02)
    furniture.bed(bed, 1.55, OAK, duvet)
    clutter.cushion(bed.at(0.1, -0.66, 0.56, turn=8), materials.fabric((0.42, 0.14, 0.08)), lean=50)
    throw = materials.fabric((0.36, 0.27, 0.12), 210, 0.3)
    bed.of("bed").soft(
        (1.74, 0.55, 0.27), (0, -1.72, 0.335), throw, radius=0.1, puff=0.035, wrinkle=0.05
    )
    clutter.pile(bed.at(-0.35, -1.15, 0.605, turn=30), 1)
    _nightstands(far)
    furniture.painting(far, 2.15, 1.4, (0.95, 0.6), 8)
    furniture.cupboard(far.at(0.56, -0.01), (1.04, 0.58, 2.06), PINE, doors=2)
    clutter.carton(far.at(0.4, -0.3, 2.06), (0.5, 0.36, 0.22), (0.3, 0.26, 0.2))
    _clothes_chair(maker.at(3.45, 2.0, turn=-120))
    clutter.slippers(maker.at(1.2, 2.3, turn=40), (0.12, 0.13, 0.16))
    clutter.basket(maker.at(0.42, 2.95), (0.35, 0.33, 0.28))
    furniture.rug(
        maker.at(1.05, 2.5, turn=3), (0.75, 1.3), materials.rug((0.5, 0.47, 0.4), (0.1, 0.17, 0.22))
    )
    motion = Motion((0.6, 0.3, 1.42), (-24, -13), velocity=(0.18, 0.14, -0.04), turn=(6, -1))
    return Shot(motion, 0.2)


def _nightstands(far: Maker) -> None:
    """Nightstands on both sides of the bed and what lies on them."""
    for x in (1.16, 3.2):
        furniture.cupboard(far.at(x, -0.02), (0.44, 0.38, 0.52), OAK, doors=0, drawers=2)
    clutter.table_lamp(far.at(1.14, -0.2, 0.52), 7)
    clutter.mug(far.at(1.3, -0.3, 0.52, turn=-60), (0.6, 0.57, 0.5))
    clutter.table_lamp(far.at(3.26, -0.2, 0.52), 0)
    clutter.pile(far.at(3.12, -0.24, 0.52), 4)


def _clothes_chair(place: Maker) -> None:
    """A chair with clothes on it."""
    furniture.chair(place, WALNUT, materials.fabric((0.4, 0.36, 0.28)))
    shirt = materials.fabric((0.1, 0.15, 0.26), 200, 0.25)
    place.soft((0.4, 0.1, 0.36), (0, 0.235, 0.55), shirt, radius=0.045, wrinkle=0.05)
    denim = materials.fabric((0.08, 0.1, 0.14), 260, 0.3)
    place.soft((0.36, 0.3, 0.07), (0.02, -0.02, 0.5), denim, radius=0.033, wrinkle=0.04)


def study(random: Random) -> Shot:
    """A desk with a monitor, a table with chairs, shelves on the wall, a door."""
    maker = Maker(random)
    room = shell.Shell(4.6, 4.5, 2.6)
    hole = shell.WallOpening(2.3, 3.7, 0.95, 2.2)
    room.build(
        maker,
        floor=materials.floorboards((0.4, 0.27, 0.15)),
        paint={
            "all": materials.plaster((0.66, 0.65, 0.6)),
            "right": materials.plaster((0.55, 0.42, 0.24)),
        },
        openings={"left": hole},
    )
    left, _ = room.wall(maker, "left")
    far, _ = room.wall(maker, "far")
    right, _ = room.wall(maker, "right")
    shell.window(left, hole, daylight=90, view=3.5, casements=2)
    shell.curtains(left, hole, materials.fabric((0.2, 0.3, 0.27)), width=0.38, floor_gap=0.04)
    shell.radiator(left, 2.4, 3.6)
    clutter.plant(left.at(3.2, 0.02, hole.sill), 0.32, 18, pot=0.06)
    shell.sun((40, -60), 22)
    shell.ceiling_lamp(maker.at(2.4, 2.3), room.height, 40)
    _desk(far.at(1.2, -0.4))
    _wall_shelves(far)
    shell.door(far, 2.62)
    shell.switch(far, 2.42, 1.08)
    clutter.clock(far, 3.05, 2.3)
    furniture.painting(far, 2.27, 1.32, (0.4, 0.54), 12)
    _table_with_chairs(maker.at(2.85, 2.45, turn=12))
    cabinet = right.at(0.72, -0.01)
    furniture.cupboard(cabinet, (1.1, 0.42, 0.86), None, doors=2, drawers=1)
    clutter.plant(cabinet.at(-0.3, -0.2, 0.86), 0.55, 20, pot=0.09)
    clutter.carton(cabinet.at(0.2, -0.2, 0.86), (0.34, 0.26, 0.2), (0.34, 0.28, 0.18))
    furniture.painting(right, 0.75, 1.55, (0.7, 0.5), 5)
    clutter.plant(maker.at(0.42, 2.1), 1.0, 24, pot=0.16)
    motion = Motion((2.2, 0.3, 1.5), (6, -13), velocity=(0.2, 0.16, 0.03), turn=(-5, 2))
    return Shot(motion, 0.0)


def _desk(place: Maker) -> None:
    """A desk with a monitor, a lamp, books and an office chair."""
    furniture.table(place, (1.6, 0.75, 0.74), PINE)
    furniture.cupboard(place.at(0.52, 0.3), (0.42, 0.55, 0.6), None, doors=0, drawers=3)
    top = place.at(0, 0, 0.74)
    clutter.monitor(top.at(-0.05, 0.16, turn=4))
    clutter.keyboard(top.at(-0.08, -0.17))
    clutter.desk_lamp(top.at(-0.62, 0.18, turn=-20))
    clutter.mug(top.at(0.4, -0.12, turn=-30), (0.5, 0.1, 0.05))
    clutter.papers(top.at(0.6, -0.12, turn=5), 4)
    clutter.pile(top.at(0.58, 0.2), 4)
    black = materials.fabric((0.035, 0.037, 0.042), 240, 0.4)
    furniture.office_chair(place.at(-0.1, -0.62, turn=160), black)
    clutter.basket(place.at(0.98, 0.1), (0.06, 0.06, 0.065))


def _wall_shelves(far: Maker) -> None:
    """Two boards above the desk with books and boxes."""
    low = furniture.wall_shelf(far, 1.2, 1.48, 1.5)
    clutter.books(low, -0.7, 0.0, 0.27)
    clutter.plant(low.at(0.25, 0.1), 0.26, 16, pot=0.06)
    clutter.carton(low.at(0.54, 0.1), (0.28, 0.18, 0.16), (0.2, 0.25, 0.25))
    high = furniture.wall_shelf(far, 1.3, 1.9, 1.3)
    clutter.carton(high.at(-0.44, 0.1), (0.3, 0.19, 0.2), (0.32, 0.12, 0.07))
    clutter.books(high, -0.22, 0.3, 0.29)
    clutter.vase(high.at(0.5, 0.1), (0.55, 0.52, 0.45), 0.22)


def _table_with_chairs(place: Maker) -> None:
    """A table with four chairs at random angles, cups, a laptop."""
    furniture.table(place, (1.35, 0.85, 0.75), OAK)
    blue = materials.fabric((0.07, 0.14, 0.22), 230, 0.3)
    for x, y, turn in ((-0.32, -0.62, 172), (0.4, -0.56, 188), (-0.3, 0.55, 6), (0.36, 0.66, -14)):
        furniture.chair(place.at(x, y, turn=turn), WALNUT, blue)
    top = place.at(0, 0, 0.75)
    clutter.bowl(top.at(0.05, 0.1), (0.2, 0.3, 0.32))
    clutter.mug(top.at(-0.5, -0.2, turn=100), (0.62, 0.6, 0.55))
    clutter.mug(top.at(0.42, 0.2, turn=-50), (0.62, 0.6, 0.55))
    clutter.papers(top.at(-0.45, 0.12, turn=80), 3)
    clutter.laptop(top.at(-0.08, -0.2, turn=14))
    clutter.pile(top.at(0.45, -0.2), 2)


ROOMS: dict[str, Callable[[Random], Shot]] = {
    "bedroom": bedroom,
    "living": living_room,
    "study": study,
}
"""Builders, by the name that image ids begin with."""
