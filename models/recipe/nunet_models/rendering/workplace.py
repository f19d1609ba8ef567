"""Desks as people leave them: screens that are on, papers, binders, cables, a partition behind."""

from __future__ import annotations

import bpy

from nunet_models.rendering import clutter, equipment, furniture, images, materials
from nunet_models.rendering.floorplan import FloorPlan, Rectangle
from nunet_models.rendering.furnisher import Furnisher
from nunet_models.rendering.shapes import Maker

DESK_HEIGHT_M = 0.74
BLACK, WHITE = (0.02, 0.02, 0.022), (0.7, 0.7, 0.68)


def busy_desk(f: Furnisher) -> None:
    """A desk at a wall or a partition, full of things."""
    random = f.random
    width, depth = random.uniform(1.0, 1.9), random.uniform(0.6, 0.9)
    place = f.at_wall(width + 0.05, depth + 0.75)
    if place is None:
        return
    place = place.at(0, -depth / 2)
    furniture.table(place, (width, depth, DESK_HEIGHT_M), f.tone)
    top = place.at(0, 0, DESK_HEIGHT_M)
    if random.random() < 0.5:
        _partition(f, place.at(0, depth / 2 + 0.012), width)
    _screens(f, top, width, depth)
    _in_front(f, top, depth)
    _around(f, top, width, depth)
    if random.random() < 0.6:
        chair = place.at(random.uniform(-0.4, 0.4), -depth / 2 - random.uniform(0.25, 0.5))
        f.any_chair(chair.at(0, 0, turn=180 + random.gauss(0, 40)))


def _partition(f: Furnisher, place: Maker, width: float) -> None:
    """A panel behind the desk, of cloth or paint, in a frame."""
    random = f.random
    height = random.uniform(1.05, 1.6)
    panel = f.cloth() if random.random() < 0.6 else materials.paint(WHITE, 0.7)
    wall = place.of("wall")
    wall.box((width, 0.02, height - 0.02), (0, 0, 0), panel, bevel=0.002)
    wall.box((width, 0.024, 0.03), (0, 0, height - 0.03), materials.metal(), bevel=0.002)
    for _ in range(random.randint(0, 4)):
        at = (random.uniform(-0.4, 0.4) * width, -0.011, random.uniform(0.8, height - 0.3))
        paper = materials.paint((random.uniform(0.5, 0.8),) * 3, 0.9)
        place.of("picture").box((0.21, 0.002, 0.28), at, paper, bevel=0)


def _screens(f: Furnisher, top: Maker, width: float, depth: float) -> None:
    """One or two monitors, most of them on, or a laptop."""
    random = f.random
    kind = random.random()
    if kind < 0.12:
        return
    if kind < 0.3:
        clutter.laptop(top.at(random.uniform(-0.2, 0.2), random.uniform(-0.1, 0.1)))
        return
    size = random.uniform(0.45, 0.68)
    shown = images.photo(random.choice(f.photos), random.uniform(0.6, 2.0)) if f.photos else None
    rise = random.choice((0.0, 0.0, 0.09))
    places = (-0.53 * size, 0.53 * size) if width > 2.3 * size and random.random() < 0.5 else (0.0,)
    shift = random.uniform(-0.1, 0.1)
    for x in places:
        turn = -25 * x + random.uniform(-8, 8)
        stand = top.at(x + shift, depth * random.uniform(0.12, 0.25), rise, turn=turn)
        if rise:
            board = materials.wood(f.tone, "x")
            stand.at(0, 0, -rise).of("furniture").box((0.5, 0.24, rise), (0, 0, 0), board)
        _monitor(stand, size, shown)


def _monitor(maker: Maker, width: float, shown: bpy.types.Material | None) -> None:
    """A monitor of any height and color; three of four show what is `shown`."""
    random = maker.random
    shown = shown if random.random() < 0.75 else None
    color = random.choice((BLACK, BLACK, (0.25, 0.25, 0.26), WHITE))
    lift, tall = random.uniform(0.06, 0.16), width * random.choice((0.5625, 0.6, 0.42))
    clutter.monitor(maker, width, tall, lift=lift, color=color, shown=shown)


def _in_front(f: Furnisher, top: Maker, depth: float) -> None:
    """What lies between the person and the screen."""
    random = f.random
    x, y = random.uniform(-0.15, 0.15), -depth * random.uniform(0.12, 0.28)
    if random.random() < 0.3:
        mat = materials.fabric(tuple(random.uniform(0.01, 0.2) for _ in range(3)))
        top.box((0.8, 0.3, 0.003), (x, y, 0), mat, bevel=0.001)
    if random.random() < 0.8:
        clutter.keyboard(top.at(x, y, 0.003, turn=random.gauss(0, 4)))
    for _ in range(random.randint(0, 2)):
        phone(top.at(random.uniform(-0.45, 0.45), y - 0.05, 0.004, turn=random.uniform(0, 180)))
    for _ in range(random.randint(0, 3)):
        pen(top.at(random.uniform(-0.45, 0.45), y, 0.004, turn=random.uniform(0, 180)))


def _around(f: Furnisher, top: Maker, width: float, depth: float) -> None:
    """Things along the edges of the desk, side by side, and cables under them."""
    random = f.random
    for _ in range(random.randint(0, 3)):
        length = random.uniform(0.3, 0.8)
        start = top.at(random.uniform(-0.5, 0.2) * width, random.uniform(-0.1, 0.35) * depth)
        equipment.cable(start.at(0, 0, turn=random.uniform(-25, 25)), length)
    things = (
        binders,
        binders,
        lambda at: clutter.papers(at, random.randint(1, 8)),
        lambda at: clutter.pile(at, random.randint(1, 6)),
        pen_holder,
        equipment.small_thing,
        equipment.small_thing,
        equipment.small_thing,
        clutter.desk_lamp,
    )
    plan = FloorPlan(width, depth, random)
    plan.reserve(Rectangle(width / 2, depth * 0.45, 0.75, depth * 0.55))
    for _ in range(random.randint(4, 14)):
        place = plan.free_place(0.22, 0.2, turn_deg=0)
        if place is not None:
            at = top.at(place.x - width / 2, place.y - depth / 2, turn=random.gauss(0, 12))
            random.choice(things)(at)


def binders(maker: Maker) -> None:
    """A row of standing binders or magazine files, their backs toward -y."""
    random = maker.random
    maker = maker.of("books")
    tones = [tuple(random.uniform(0.01, 0.5) for _ in range(3)) for _ in range(2)]
    x = -0.11
    while x < 0.1:
        thick = random.choice((0.035, 0.05, 0.08))
        size = (thick - 0.002, random.uniform(0.2, 0.28), random.uniform(0.25, 0.32))
        maker.box(size, (x + thick / 2, 0, 0), materials.paint(random.choice(tones), 0.5))
        label = (thick * 0.6, 0.002, 0.1)
        front = (x + thick / 2, -size[1] / 2 - 0.001, 0.12)
        maker.box(label, front, materials.paint(WHITE, 0.8), bevel=0)
        x += thick


def phone(maker: Maker) -> None:
    """A smartphone that lies on its back."""
    color = maker.random.choice((BLACK, WHITE, (0.03, 0.06, 0.2)))
    maker.box((0.073, 0.148, 0.009), (0, 0, 0), materials.paint(color, 0.2), bevel=0.004)
    maker.box((0.066, 0.14, 0.001), (0, 0, 0.0088), images.screen(), bevel=0)


def pen(maker: Maker) -> None:
    """A pen that lies."""
    color = tuple(maker.random.uniform(0.01, 0.6) for _ in range(3))
    maker.rod((-0.07, 0, 0.005), (0.07, 0, 0.005), 0.0045, materials.paint(color, 0.3))


def pen_holder(maker: Maker) -> None:
    """A cup with pens."""
    random = maker.random
    cup = materials.paint(tuple(random.uniform(0.02, 0.6) for _ in range(3)), 0.4)
    maker.lathe([(0.035, 0), (0.038, 0.1), (0.035, 0.1), (0.033, 0.01)], (0, 0, 0), cup)
    for _ in range(random.randint(2, 7)):
        lean = (random.uniform(-0.035, 0.035), random.uniform(-0.035, 0.035), 0.15)
        tone = materials.paint(tuple(random.uniform(0.01, 0.6) for _ in range(3)), 0.3)
        maker.rod((0, 0, 0.01), lean, 0.004, tone)
