"""Objects of offices, kitchens and halls; each stands on its maker's origin."""

from __future__ import annotations

import math
from itertools import pairwise

import bpy

from nunet_models.rendering import clutter, images, materials
from nunet_models.rendering.shapes import Maker

Material = bpy.types.Material
CARDBOARD = ((0.36, 0.24, 0.13), (0.42, 0.3, 0.18), (0.3, 0.19, 0.1), (0.5, 0.48, 0.44))


def box(maker: Maker, size: tuple[float, float, float]) -> None:
    """A cardboard box with tape, or a plastic crate."""
    random = maker.random
    width, depth, height = size
    if random.random() < 0.75:
        maker.box(size, (0, 0, 0), materials.paint(random.choice(CARDBOARD), 0.8), bevel=0.003)
        tape = materials.paint((0.5, 0.4, 0.25), 0.3)
        maker.box((width + 0.002, 0.05, 0.002), (0, 0, height), tape, bevel=0)
        maker.box(
            (0.05, depth + 0.002, height * 0.25), (width * 0.1, 0, height * 0.76), tape, bevel=0
        )
        return
    color = tuple(random.uniform(0.03, 0.5) for _ in range(3))
    shell = materials.paint(color, 0.4)
    maker.box(size, (0, 0, 0), shell, bevel=0.01)
    # The rim ends below the top: two surfaces in one plane would render black.
    maker.box((width + 0.03, depth + 0.03, 0.03), (0, 0, height - 0.04), shell, bevel=0.005)


def box_stack(maker: Maker, width: float, depth: float, height: float) -> None:
    """Boxes on each other, up to a height."""
    random, z = maker.random, 0.0
    while z < height - 0.1:
        tall = min(random.uniform(0.12, 0.45), height - z)
        share = random.uniform(0.75, 1.0)
        at = maker.at(random.uniform(-0.02, 0.02), 0, z, turn=random.uniform(-5, 5))
        box(at, (width * share * 0.95, depth * share * 0.95, tall))
        z += tall + 0.003
        width, depth = width * share, depth * share


def rack(maker: Maker, size: tuple[float, float, float], levels: int) -> None:
    """A warehouse's rack with boxes, its back at y = 0."""
    random = maker.random
    frame = maker.of("furniture")
    width, depth, height = size
    steel = materials.paint(
        random.choice(((0.05, 0.1, 0.3), (0.3, 0.31, 0.32), (0.5, 0.12, 0.02))), 0.4
    )
    board = materials.wood((0.5, 0.38, 0.22), "x") if random.random() < 0.5 else steel
    for x in (-width / 2 + 0.02, width / 2 - 0.02):
        for y in (-depth + 0.02, -0.02):
            frame.box((0.04, 0.04, height), (x, y, 0), steel, bevel=0)
        for k in range(int(height / 0.6)):
            frame.rod((x, -depth + 0.02, 0.1 + 0.6 * k), (x, -0.02, 0.6 + 0.6 * k), 0.008, steel)
    for level in range(levels):
        z = 0.08 + (height - 0.1) * level / max(levels - 1, 1)
        frame.box((width, depth, 0.03), (0, -depth / 2, z), board, bevel=0)
        room_above = (height - 0.1) / max(levels - 1, 1) - 0.08
        _fill_level(maker.of("objects").at(0, -depth / 2, z + 0.03), width, depth, room_above)


def _fill_level(maker: Maker, width: float, depth: float, height: float) -> None:
    random, x = maker.random, -width / 2 + 0.06
    while x < width / 2 - 0.2:
        wide = min(random.uniform(0.2, 0.6), width / 2 - 0.06 - x)
        if random.random() < 0.75 and wide > 0.1:
            size = (
                wide * 0.95,
                depth * random.uniform(0.5, 0.95),
                height * random.uniform(0.3, 0.95),
            )
            box(
                maker.at(x + wide / 2, random.uniform(-0.04, 0.04), turn=random.uniform(-4, 4)),
                size,
            )
        x += wide


def kitchen(maker: Maker, width: float, *, upper: bool) -> None:
    """Base cabinets with a worktop, sink and stove, wall cabinets above; the back at y = 0."""
    random = maker.random
    unit = maker.of("furniture")
    tone = tuple(random.uniform(0.05, 0.7) for _ in range(3)) if random.random() < 0.5 else None
    front = materials.paint(tone or (0.75, 0.74, 0.72), 0.3)
    top = random.choice(
        (materials.concrete((0.2, 0.2, 0.2)), materials.wood((0.4, 0.25, 0.12), "x"))
    )
    steel, black = materials.metal(), materials.paint((0.01, 0.01, 0.012), 0.1)
    unit.box((width, 0.5, 0.1), (0, -0.25, 0), materials.paint((0.05, 0.05, 0.05)), bevel=0)
    unit.box((width, 0.58, 0.76), (0, -0.29, 0.1), front)
    unit.box((width + 0.02, 0.63, 0.04), (0, -0.315, 0.86), top)
    count = max(1, round(width / 0.6))
    for i in range(count):
        wide = width / count
        x = -width / 2 + wide * (i + 0.5)
        unit.box((wide - 0.008, 0.02, 0.72), (x, -0.59, 0.12), front)
        unit.box((wide * 0.5, 0.02, 0.012), (x, -0.61, 0.76), steel)
        if upper and random.random() < 0.85:
            unit.box((wide - 0.006, 0.35, 0.7), (x, -0.175, 1.45), front)
            unit.box((0.012, 0.02, 0.12), (x + wide * 0.38, -0.36, 1.5), steel)
    maker.of("objects").box((0.58, 0.5, 0.006), (-width * 0.25, -0.31, 0.9), black)
    maker.of("objects").box((0.5, 0.42, 0.004), (width * 0.25, -0.31, 0.9), steel)
    maker.of("objects").rod((width * 0.25, -0.08, 0.9), (width * 0.25, -0.08, 1.15), 0.012, steel)
    maker.of("objects").rod((width * 0.25, -0.08, 1.15), (width * 0.25, -0.28, 1.12), 0.012, steel)
    for _ in range(random.randint(1, 5)):
        small_thing(
            maker.at(random.uniform(-width, width) * 0.45, -random.uniform(0.12, 0.5), 0.905)
        )


def fridge(maker: Maker) -> None:
    """A refrigerator, its back at y = 0."""
    random = maker.random
    body = random.choice(
        (materials.metal((0.6, 0.6, 0.6), 0.3), materials.paint((0.75, 0.75, 0.75), 0.25))
    )
    height = random.uniform(1.2, 1.95)
    unit = maker.of("furniture")
    unit.box((0.6, 0.6, height), (0, -0.32, 0.02), body, bevel=0.012)
    unit.box((0.59, 0.04, height * 0.62), (0, -0.64, height * 0.36), body, bevel=0.01)
    unit.box((0.59, 0.04, height * 0.32), (0, -0.64, 0.05), body, bevel=0.01)
    unit.rod((-0.24, -0.69, height * 0.45), (-0.24, -0.69, height * 0.7), 0.012, materials.metal())


def stairs(maker: Maker, width: float, steps: int) -> None:
    """Stairs that rise toward +x along a wall, their side at y = 0, the first step at x = 0."""
    random = maker.random
    rise, run = random.uniform(0.16, 0.19), random.uniform(0.24, 0.3)
    tread = materials.wood((random.uniform(0.15, 0.5), 0.2, 0.1), "y")
    riser = random.choice((materials.paint((0.7, 0.7, 0.68)), tread))
    solid = random.random() < 0.7
    for i in range(steps):
        at = (run * (i + 0.5), -width / 2)
        low = 0 if solid else rise * (i + 1) - 0.12
        maker.box((run, width, rise * (i + 1) - 0.03 - low), (*at, low), riser, bevel=0)
        maker.box((run + 0.03, width, 0.03), (at[0] - 0.015, at[1], rise * (i + 1) - 0.03), tread)
    steel = materials.metal((0.2, 0.2, 0.2))
    y = -width + 0.04
    for i in range(0, steps, 2):
        foot = rise * (i + 1)
        maker.rod((run * (i + 0.5), y, foot), (run * (i + 0.5), y, foot + 0.9), 0.012, steel)
    start, end = (run * 0.5, y, rise + 0.9), (run * (steps - 0.5), y, rise * steps + 0.9)
    maker.rod(start, end, 0.022, tread)


def cable(maker: Maker, length: float) -> None:
    """A cable that winds along the floor toward +x."""
    random = maker.random
    radius = random.uniform(0.003, 0.009)
    color = random.choice(
        ((0.01, 0.01, 0.01), (0.7, 0.7, 0.68), (0.6, 0.15, 0.02), (0.02, 0.1, 0.3))
    )
    rubber = materials.paint(color, 0.5)
    steps, wave, phase = int(length / 0.06) + 2, random.uniform(0.05, 0.25), random.uniform(0, 6)
    points = [
        (length * i / steps, wave * math.sin(phase + 5.0 * length * i / steps / (1 + wave)), radius)
        for i in range(steps)
    ]
    for start, end in pairwise(points):
        maker.rod(start, end, radius, rubber)
    if random.random() < 0.4:
        maker.at(*points[-1][:2], turn=random.uniform(0, 90)).box(
            (0.28, 0.06, 0.045), (0, 0, 0), materials.paint((0.75, 0.75, 0.73), 0.4)
        )


def mirror(facing: Maker, x: float, z: float, size: tuple[float, float]) -> bpy.types.Object:
    """A mirror on a wall, and its pane; its truth is the pane itself."""
    width, height = size
    facing = facing.of("objects")
    if facing.random.random() < 0.7:
        frame = materials.wood((0.2, 0.12, 0.06), "x")
        facing.box((width + 0.08, 0.02, height + 0.08), (x, -0.01, z - 0.04), frame)
    return facing.box((width, 0.012, height), (x, -0.02, z), materials.mirror(), bevel=0)


def poster(
    facing: Maker, x: float, z: float, size: tuple[float, float], photo: str, glow: float = 0
) -> bpy.types.Object:
    """A flat image on a wall, and its pane: a poster, a mural, or a screen that shines."""
    width, height = size
    if glow:
        facing.of("tv").box(
            (width + 0.03, 0.04, height + 0.03),
            (x, -0.02, z - 0.015),
            materials.paint((0.01, 0.01, 0.01), 0.3),
        )
        return facing.of("tv").box(
            (width, 0.004, height), (x, -0.042, z), images.photo(photo, glow), bevel=0
        )
    return facing.of("picture").box(
        (width, 0.004, height), (x, -0.003, z), images.photo(photo), bevel=0
    )


def glass_wall(maker: Maker, width: float, height: float) -> None:
    """Panes in frames across x, a glass door among them; at y = 0."""
    random = maker.random
    frame = materials.metal((0.15, 0.15, 0.16), 0.4)
    count = max(1, round(width / random.uniform(0.8, 1.3)))
    post = maker.of("wall")
    for i in range(count + 1):
        post.box((0.05, 0.05, height), (-width / 2 + width * i / count, 0, 0), frame)
    for z in (0, height - 0.05):
        post.box((width, 0.05, 0.05), (0, 0, z), frame)
    pane = maker.of("window").box(
        (width, 0.008, height - 0.1), (0, 0, 0.05), materials.pane(), bevel=0
    )
    pane.visible_shadow = pane.visible_diffuse = False
    if random.random() < 0.6:
        film = materials.paint((0.7, 0.72, 0.72), 0.8)
        maker.of("window").box(
            (width, 0.012, 0.08), (0, 0, random.uniform(0.9, 1.3)), film, bevel=0
        )
    maker.of("objects").rod((0.2, -0.05, 0.9), (0.2, -0.05, 1.2), 0.012, frame)


def pallet(maker: Maker) -> None:
    """A pallet, often with goods on it."""
    random, pine = maker.random, materials.wood((0.5, 0.36, 0.2), "x")
    for y in (-0.35, 0, 0.35):
        maker.box((1.2, 0.1, 0.1), (0, y, 0), pine, bevel=0)
    for i in range(7):
        maker.box((0.12, 0.8, 0.022), (-0.53 + 0.177 * i, 0, 0.1), pine, bevel=0)
    if random.random() < 0.8:
        for x in (-0.3, 0.3):
            for y in (-0.2, 0.2):
                box_stack(maker.at(x, y, 0.122), 0.55, 0.38, random.uniform(0.2, 1.2))


def column(maker: Maker, height: float) -> None:
    """A round or square column."""
    wall = maker.of("wall")
    paint = materials.plaster((0.6, 0.6, 0.58))
    radius = maker.random.uniform(0.12, 0.3)
    if maker.random.random() < 0.5:
        wall.lathe([(radius, 0), (radius, height)], (0, 0, 0), paint)
    else:
        wall.box((2 * radius, 2 * radius, height), (0, 0, 0), paint, bevel=0.005)


def small_thing(maker: Maker) -> None:
    """One small object, as found on tables and floors."""
    random = maker.random
    color = tuple(random.uniform(0.02, 0.65) for _ in range(3))
    maker = maker.at(0, 0, turn=random.uniform(0, 360))
    size = tuple(random.uniform(0.06, 0.28) for _ in range(3))
    tall, pot = random.uniform(0.12, 0.5), random.uniform(0.05, 0.09)
    makers = (
        lambda: clutter.mug(maker, color),
        lambda: clutter.pile(maker, random.randint(1, 5)),
        lambda: clutter.bowl(maker, color, fruit=random.random() < 0.6),
        lambda: clutter.vase(maker, color, min(tall, 0.35)),
        lambda: clutter.plant(maker, max(tall, 0.2), random.randint(8, 16), pot=pot),
        lambda: bottle(maker, color),
        lambda: clutter.papers(maker, random.randint(1, 6)),
        lambda: box(maker, size),
        lambda: ball(maker, color),
        lambda: clutter.laptop(maker),
        lambda: clutter.keyboard(maker),
    )
    random.choice(makers)()


def ball(maker: Maker, color: materials.Color) -> None:
    """A ball."""
    radius = maker.random.uniform(0.03, 0.12)
    maker.soft((2 * radius,) * 3, (0, 0, 0), materials.paint(color, 0.4), radius=radius)


def bottle(maker: Maker, color: materials.Color) -> None:
    """A bottle or a can."""
    height, radius = maker.random.uniform(0.1, 0.32), maker.random.uniform(0.025, 0.05)
    outline = [
        (radius, 0),
        (radius, height * 0.6),
        (radius * 0.35, height * 0.8),
        (radius * 0.35, height),
    ]
    if maker.random.random() < 0.4:
        outline = [(radius, 0), (radius, height)]
    maker.lathe(outline, (0, 0, 0), materials.paint(color, 0.15))


def bag(maker: Maker) -> None:
    """A backpack or a bag on the floor."""
    color = tuple(maker.random.uniform(0.02, 0.3) for _ in range(3))
    size = tuple(
        maker.random.uniform(low, high) for low, high in ((0.25, 0.45), (0.15, 0.25), (0.3, 0.5))
    )
    maker.soft(size, (0, 0, 0), materials.fabric(color), radius=0.07, puff=0.03, wrinkle=0.03)
