"""Furniture; each piece stands on its maker's origin with its back toward +y."""

from __future__ import annotations

import bpy

from nunet_models.rendering import images, materials
from nunet_models.rendering.shapes import Maker

Material = bpy.types.Material


def sofa(maker: Maker, width: float, cloth: Material) -> None:
    """A sofa with loose seat and back cushions, its back at y = 0."""
    maker = maker.of("sofa")
    dark = materials.wood((0.09, 0.05, 0.03), "z")
    arm, depth = 0.2, 0.92
    for x in (-width / 2 + 0.1, width / 2 - 0.1):
        for y in (-depth + 0.1, -0.1):
            maker.cylinder(0.025, 0.1, (x, y, 0), dark)
    maker.soft((width, depth, 0.24), (0, -depth / 2, 0.09), cloth, radius=0.03)
    maker.soft((width, 0.22, 0.74), (0, -0.11, 0.09), cloth, radius=0.07)
    for x in (-width / 2 + arm / 2, width / 2 - arm / 2):
        maker.soft((arm, depth, 0.52), (x, -depth / 2, 0.1), cloth, radius=0.07, wrinkle=0.004)
    seats = 3 if width > 1.9 else (2 if width > 1.3 else 1)
    seat = (width - 2 * arm) / seats
    for i in range(seats):
        x = -width / 2 + arm + seat * (i + 0.5)
        size = (seat - 0.008, depth - 0.2, 0.17)
        at = (x, -depth / 2 - 0.09, 0.31)
        maker.soft(size, at, cloth, radius=0.05, puff=0.02, wrinkle=0.006)
        size, at = (seat - 0.012, 0.43, 0.17), (x, -0.25, 0.68)
        maker.soft(size, at, cloth, radius=0.07, puff=0.035, wrinkle=0.012, tilt=(78, 0, 0))


def table(maker: Maker, size: tuple[float, float, float], tone: materials.Color) -> None:
    """A table with four legs."""
    maker = maker.of("table")
    width, depth, height = size
    top, leg = materials.wood(tone, "x", 0.6), materials.wood(tone, "z", 0.6)
    maker.box((width, depth, 0.032), (0, 0, height - 0.032), top, bevel=0.006)
    for y in (-depth / 2 + 0.09, depth / 2 - 0.09):
        maker.box((width - 0.16, 0.022, 0.07), (0, y, height - 0.102), top)
    for x in (-width / 2 + 0.07, width / 2 - 0.07):
        maker.box((0.022, depth - 0.16, 0.07), (x, 0, height - 0.102), leg)
        for y in (-depth / 2 + 0.07, depth / 2 - 0.07):
            maker.box((0.055, 0.055, height - 0.032), (x, y, 0), leg, bevel=0.008)


def low_table(maker: Maker, size: tuple[float, float, float], tone: materials.Color) -> None:
    """A coffee table with a shelf."""
    table(maker, size, tone)
    width, depth, _ = size
    shelf = materials.wood(tone, "x", 0.6)
    maker.of("table").box((width - 0.14, depth - 0.14, 0.02), (0, 0, 0.12), shelf)


def chair(maker: Maker, tone: materials.Color, cloth: Material | None = None) -> None:
    """A dining chair that faces -y."""
    maker = maker.of("chair")
    upright, level = materials.wood(tone, "z", 0.55), materials.wood(tone, "x", 0.55)
    for x in (-0.19, 0.19):
        maker.rod((x, -0.19, 0), (x * 0.95, -0.17, 0.44), 0.018, upright)
        maker.rod((x, 0.22, 0), (x * 0.95, 0.18, 0.46), 0.019, upright)
        maker.rod((x * 0.95, 0.18, 0.45), (x * 0.9, 0.26, 0.88), 0.018, upright)
        maker.rod((x, -0.18, 0.2), (x, 0.2, 0.2), 0.011, upright)
    maker.soft((0.44, 0.43, 0.03), (0, 0, 0.435), level, radius=0.014)
    if cloth:
        maker.soft((0.41, 0.4, 0.05), (0, 0, 0.46), cloth, radius=0.022, puff=0.008)
    maker.soft((0.38, 0.022, 0.09), (0, 0.243, 0.79), level, radius=0.01, tilt=(-10, 0, 0))
    for x in (-0.11, -0.037, 0.037, 0.11):
        maker.rod((x, 0.185, 0.46), (x, 0.25, 0.82), 0.009, upright)


def office_chair(maker: Maker, cloth: Material) -> None:
    """A swivel chair on five castors that faces -y."""
    maker = maker.of("chair")
    black = materials.paint((0.02, 0.02, 0.022), 0.5)
    for i in range(5):
        arm = maker.at(0, 0, turn=72 * i + 13)
        arm.rod((0, 0, 0.1), (0.3, 0, 0.07), 0.018, black)
        arm.lathe([(0.02, 0), (0.028, 0.012), (0.028, 0.035), (0.02, 0.05)], (0.3, 0, 0), black)
    maker.cylinder(0.028, 0.36, (0, 0, 0.08), black)
    maker.soft((0.49, 0.48, 0.09), (0, 0, 0.42), cloth, radius=0.04, puff=0.015)
    maker.soft((0.46, 0.55, 0.08), (0, 0.27, 0.85), cloth, radius=0.038, puff=0.02, tilt=(82, 0, 0))
    maker.rod((0, 0.2, 0.44), (0, 0.3, 0.72), 0.025, black)
    for x in (-0.27, 0.27):
        maker.rod((x, 0.08, 0.44), (x, 0.08, 0.66), 0.016, black)
        maker.soft((0.06, 0.27, 0.03), (x, 0.02, 0.66), black, radius=0.014)


def bookcase(
    maker: Maker, size: tuple[float, float, float], shelves: int, tone: materials.Color
) -> list[Maker]:
    """An open bookcase, its back at y = 0; returns a maker on each shelf, lowest first."""
    maker = maker.of("furniture")
    width, depth, height = size
    upright, level = materials.wood(tone, "z", 0.45), materials.wood(tone, "x", 0.45)
    board = 0.022
    for x in (-width / 2 + board / 2, width / 2 - board / 2):
        maker.box((board, depth, height), (x, -depth / 2, 0), upright, bevel=0.002)
    maker.box((width, 0.008, height), (0, -0.004, 0), upright, bevel=0)
    maker.box((width - 2 * board, depth, 0.06), (0, -depth / 2 + 0.01, 0), level, bevel=0.002)
    inside = width - 2 * board
    places = []
    for i in range(shelves + 1):
        z = 0.06 + (height - 0.06 - board) * i / shelves
        maker.box((inside, depth - 0.01, board), (0, -depth / 2 + 0.005, z), level, bevel=0.002)
        places.append(maker.at(0, -depth + 0.02, z + board))
    return places


def cupboard(
    maker: Maker,
    size: tuple[float, float, float],
    tone: materials.Color | None,
    *,
    doors: int,
    drawers: int = 0,
    legs: float = 0.06,
) -> None:
    """A cabinet, its back at y = 0: drawers above, doors below; white where `tone` is None."""
    maker = maker.of("furniture")
    width, depth, height = size
    if tone is None:
        body = front = materials.paint((0.7, 0.69, 0.66), 0.4)
    else:
        body, front = materials.wood(tone, "x", 0.5), materials.wood(tone, "z", 0.5)
    knob = materials.metal((0.3, 0.28, 0.26))
    maker.box((width - 0.06, depth - 0.06, legs), (0, -depth / 2, 0), body)
    maker.box((width, depth, height - legs), (0, -depth / 2, legs), body)
    drawer = 0.2 if drawers and doors else (height - legs - 0.04) / max(drawers, 1)
    columns = doors or 1
    top, face = height - 0.02, -depth - 0.009
    for i in range(columns):
        wide = (width - 0.03) / columns
        x = -width / 2 + 0.015 + wide * (i + 0.5)
        for k in range(drawers):
            z = top - drawer * (k + 1)
            maker.box((wide - 0.006, 0.018, drawer - 0.006), (x, face, z), front)
            maker.box((0.12, 0.02, 0.012), (x, face - 0.02, z + drawer * 0.6), knob)
        if doors:
            tall = top - drawer * bool(drawers) * drawers - legs - 0.02
            maker.box((wide - 0.006, 0.018, tall - 0.006), (x, face, legs + 0.02), front)
            side = wide * (0.4 if i % 2 == 0 else -0.4)
            z = legs + tall * (0.5 if height > 1.2 else 0.75)
            maker.box((0.012, 0.025, 0.14), (x + side, face - 0.02, z), knob)


def bed(maker: Maker, width: float, tone: materials.Color, duvet: Material) -> None:
    """A made bed, its head at y = 0, two pillows and a throw."""
    maker = maker.of("bed")
    length, flat, upright = 2.06, materials.wood(tone, "x", 0.5), materials.wood(tone, "y", 0.5)
    linen = materials.fabric((0.68, 0.66, 0.62), 320, 0.06)
    maker.box((width + 0.12, 0.05, 1.02), (0, -0.025, 0), flat, bevel=0.015)
    maker.box((width + 0.1, 0.035, 0.22), (0, -length - 0.02, 0.14), flat, bevel=0.01)
    for x in (-width / 2 - 0.03, width / 2 + 0.03):
        maker.box((0.03, length, 0.18), (x, -length / 2, 0.17), upright, bevel=0.006)
        maker.box((0.06, 0.06, 0.4), (x, -length, 0), flat, bevel=0.01)
    maker.soft((width, length - 0.06, 0.24), (0, -length / 2, 0.26), linen, radius=0.06)
    maker.soft(
        (width + 0.15, length - 0.62, 0.26),
        (0, -length / 2 - 0.3, 0.32),
        duvet,
        radius=0.1,
        puff=0.03,
        wrinkle=0.05,
    )
    maker.soft(
        (width + 0.13, 0.34, 0.12),
        (0, -0.7, 0.47),
        linen,
        radius=0.055,
        puff=0.015,
        wrinkle=0.02,
    )
    for x in (-width / 4, width / 4):
        maker.of("objects").soft(
            (0.66, 0.42, 0.18),
            (x, -0.3, 0.55),
            linen,
            radius=0.085,
            puff=0.03,
            pinch=0.5,
            wrinkle=0.02,
            tilt=(32, 0, 3),
        )


def television(maker: Maker, width: float) -> None:
    """A flat television on a foot, its screen toward -y."""
    maker = maker.of("tv")
    black = materials.paint((0.012, 0.012, 0.013), 0.35)
    tall = width * 0.58
    maker.box((width * 0.4, 0.2, 0.015), (0, 0, 0), black)
    maker.box((0.08, 0.03, 0.1), (0, 0.02, 0.01), black)
    maker.box((width, 0.035, tall), (0, 0, 0.07), black, bevel=0.006)
    maker.box((width - 0.03, 0.004, tall - 0.035), (0, -0.019, 0.09), images.screen(), bevel=0.001)


def painting(facing: Maker, x: float, z: float, size: tuple[float, float], seed: int) -> None:
    """A framed painting on a wall (`facing`: see `Shell.wall`), its lower edge at `z`."""
    facing = facing.of("picture")
    width, height = size
    frame = materials.wood((0.1, 0.06, 0.035), "x", 0.5)
    for dz in (0, height - 0.03):
        facing.box((width, 0.03, 0.03), (x, -0.015, z + dz), frame)
    for dx in (-width / 2 + 0.015, width / 2 - 0.015):
        facing.box((0.03, 0.0295, height), (x + dx, -0.015, z), frame)
    white = materials.paint((0.78, 0.76, 0.7), 0.8)
    facing.box((width - 0.04, 0.012, height - 0.04), (x, -0.007, z + 0.02), white, bevel=0)
    inner = (width * 0.72, 0.014, height * 0.7)
    facing.box(inner, (x, -0.008, z + height * 0.15), images.landscape(seed), bevel=0)


def wall_shelf(facing: Maker, x: float, z: float, width: float) -> Maker:
    """A board on a wall; returns a maker at the front of its upper side."""
    facing = facing.of("furniture")
    facing.box((width, 0.22, 0.025), (x, -0.11, z), materials.wood((0.42, 0.28, 0.15), "x"))
    for dx in (-width * 0.35, width * 0.35):
        facing.box((0.02, 0.16, 0.1), (x + dx, -0.08, z - 0.1), materials.metal((0.1, 0.1, 0.1)))
    return facing.at(x, -0.2, z + 0.025)


def rug(maker: Maker, size: tuple[float, float], cloth: Material) -> None:
    """A rug; NYU's map of classes counts floor mats as floor."""
    maker.of("floor").box((*size, 0.012), (0, 0, 0.0005), cloth, bevel=0.005)
