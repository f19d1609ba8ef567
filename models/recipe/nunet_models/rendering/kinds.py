"""Random rooms: their size, surfaces, light, doors, and what stands in them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from random import Random

from nunet_models.rendering import equipment, shell, surroundings, workplace
from nunet_models.rendering.floorplan import SIDES
from nunet_models.rendering.furnisher import Furnisher
from nunet_models.rendering.shapes import Maker
from nunet_models.rendering.viewpoints import NEAR, SEATED, SHARES, STANDING

Range = tuple[float, float]


@dataclass(frozen=True)
class RoomKind:
    """What rooms of a kind have in common: ranges in meters, shares from 0 to 1."""

    width: Range
    depth: Range
    height: Range
    furnish: Callable[[Furnisher], None]
    windows: float = 0.8
    panels: float = 0.2
    """How likely the ceiling has light panels in a grid."""
    weight: float = 1.0
    views: Mapping[str, float] = field(default_factory=lambda: SHARES)
    """How often each kind of view is drawn."""


@dataclass(frozen=True)
class Room:
    """A room that has been built in the open scene."""

    kind: str
    size: tuple[float, float, float]
    ambient: tuple[float, float, float]
    views: Mapping[str, float]


def _living(f: Furnisher) -> None:
    f.some(f.sofa, 1, 3)
    f.some(f.cupboard, 1, 2)
    f.some(f.bookcase, 0, 2)
    f.some(f.low_table, 1, 2)
    f.some(f.table, 0, 2)
    f.some(f.floor_lamp, 0, 2)
    f.some(f.rug, 0, 1)
    f.some(f.chair, 0, 3)


def _bedroom(f: Furnisher) -> None:
    f.some(f.bed, 1, 2)
    f.some(f.cupboard, 1, 4)
    f.some(f.desk, 0, 1)
    f.some(f.bookcase, 0, 1)
    f.some(f.rug, 0, 1)
    f.some(f.chair, 0, 2)


def _office(f: Furnisher) -> None:
    f.some(f.desk, 2, 5)
    f.some(f.cupboard, 0, 2)
    f.some(f.bookcase, 0, 2)
    f.some(f.table, 0, 2)
    f.some(f.chair, 0, 3)


def _kitchen(f: Furnisher) -> None:
    f.some(f.kitchen, 1, 3)
    f.some(f.fridge, 0, 1)
    f.some(f.table, 1, 1)
    f.some(f.cupboard, 0, 2)


def _corridor(f: Furnisher) -> None:
    f.some(f.cupboard, 1, 3)
    f.some(f.boxes, 0, 2)
    f.some(f.chair, 0, 1)
    f.some(f.bookcase, 0, 1)


def _stairwell(f: Furnisher) -> None:
    f.some(f.stairs, 1, 2)
    f.some(f.boxes, 0, 2)
    f.some(f.cupboard, 0, 1)


def _warehouse(f: Furnisher) -> None:
    f.some(f.rack_row, 1, 5)
    f.some(f.rack, 1, 6)
    for _ in range(f.random.randint(0, 4)):
        place = f.on_floor(1.3, 0.9)
        if place is not None:
            equipment.pallet(place)
    f.some(f.boxes, 2, 8)


def _workshop(f: Furnisher) -> None:
    f.some(f.rack, 1, 3)
    f.some(f.table, 1, 2)
    f.some(f.desk, 0, 2)
    f.some(f.boxes, 1, 5)
    f.some(f.cupboard, 0, 2)


def _workplace(f: Furnisher) -> None:
    for _ in range(f.random.randint(3, 8)):
        workplace.busy_desk(f)
    f.some(f.bookcase, 0, 2)
    f.some(f.cupboard, 0, 1)


def _empty(f: Furnisher) -> None:
    for _ in range(f.random.randint(1, 6)):
        f.wall_decoration(flat=0.85)
    f.some(f.boxes, 0, 2)


KINDS: dict[str, RoomKind] = {
    "living": RoomKind((3, 7), (3, 7), (2.3, 3.0), _living, weight=1.4),
    "bedroom": RoomKind((2.6, 5), (2.8, 5), (2.3, 2.8), _bedroom),
    "office": RoomKind((3, 10), (3, 8), (2.5, 3.2), _office, panels=0.7, weight=1.4),
    "kitchen": RoomKind((2.2, 5), (2.6, 5), (2.3, 2.8), _kitchen),
    "corridor": RoomKind((1.3, 2.8), (5, 14), (2.3, 3.0), _corridor, windows=0.3, panels=0.6),
    "stairwell": RoomKind((2.5, 6), (4, 8), (2.6, 4.0), _stairwell, windows=0.5),
    "warehouse": RoomKind((7, 16), (8, 18), (3.5, 6.5), _warehouse, windows=0.3, panels=0.9),
    "workshop": RoomKind((4, 9), (4, 9), (2.6, 4.0), _workshop, panels=0.7),
    "empty": RoomKind((2.5, 8), (2.5, 8), (2.3, 3.2), _empty, weight=0.7),
    "workplace": RoomKind(
        (2.5, 7),
        (2.5, 6),
        (2.4, 3.0),
        _workplace,
        panels=0.5,
        views={SEATED: 0.75, NEAR: 0.15, STANDING: 0.1},
    ),
}

DEFAULT_KINDS = tuple(kind for kind in KINDS if kind != "workplace")
"""Drawn where no kinds are named. `workplace` is newer than seeds that files were trained on."""


def build(
    seed_text: str, photos: list[str], among: Sequence[str] = DEFAULT_KINDS
) -> tuple[Room, Random]:
    """Build a random room in the open scene; the generator that continues for its views."""
    random = Random(seed_text)
    furnisher, room = build_unfurnished(draw(random, among), random, photos)
    furnish(furnisher, room)
    return room, random


def draw(random: Random, among: Sequence[str]) -> str:
    """One of these kinds of rooms, by their weight."""
    return random.choices(among, [KINDS[kind].weight for kind in among])[0]


def furnish(furnisher: Furnisher, room: Room) -> None:
    """Put what a room of its kind contains where the furnisher's plan is free."""
    KINDS[room.kind].furnish(furnisher)
    _common(furnisher)


def build_unfurnished(name: str, random: Random, photos: list[str]) -> tuple[Furnisher, Room]:
    """Walls, openings and light of a room of this kind, and what furnishes it."""
    kind = KINDS[name]
    size = tuple(random.uniform(*limits) for limits in (kind.width, kind.depth, kind.height))
    room = shell.Shell(*size)
    maker = Maker(random)
    furnisher = Furnisher(maker, room, photos)
    holes, doorway = surroundings.add_openings(furnisher, kind.windows)
    paint = {"all": surroundings.wall_surface(random)}
    if random.random() < 0.4:
        paint[random.choice(SIDES)] = surroundings.wall_surface(random)
    openings = {side: [hole] for side, hole in holes.items()}
    if doorway:
        openings.setdefault(doorway[0], []).append(doorway[1])
    room.build(maker, floor=surroundings.floor_surface(random), paint=paint, openings=openings)
    if doorway:
        surroundings.add_annex(furnisher, *doorway)
    ambient = surroundings.add_light(furnisher, kind.panels, holes)
    return furnisher, Room(name, size, ambient, kind.views)


def _common(f: Furnisher) -> None:
    """What may be in every room."""
    random = f.random
    f.some(f.person, 0, random.choice((0, 0, 1, 1)))
    f.some(f.boxes, 0, random.choice((1, 2, 3)))
    f.some(f.floor_thing, 1, 5)
    f.some(f.cable, 0, random.choice((0, 1, 2)))
    f.some(f.wall_decoration, 1, 5)
    if random.random() < 0.12:
        width = min(random.uniform(1.0, 3.0), f.room.width - 0.4)
        place = f.on_floor(width, 0.15, random.choice((0, 90)))
        if place is not None:
            equipment.glass_wall(place, width, min(2.2, f.room.height - 0.05))
    if f.room.width * f.room.depth > 30 and random.random() < 0.4:
        place = f.on_floor(0.6, 0.6)
        if place is not None:
            equipment.column(place, f.room.height)
