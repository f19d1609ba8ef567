"""Small objects; each stands on its maker's origin."""

from __future__ import annotations

import math
from itertools import pairwise

import bpy
import numpy as np

from nunet_models.rendering import images, materials, shell
from nunet_models.rendering.shapes import Maker

BOOK_COLORS = (
    (0.28, 0.03, 0.03),
    (0.03, 0.08, 0.22),
    (0.02, 0.13, 0.09),
    (0.5, 0.42, 0.3),
    (0.06, 0.05, 0.05),
    (0.42, 0.2, 0.04),
    (0.6, 0.58, 0.54),
    (0.13, 0.22, 0.3),
    (0.24, 0.12, 0.2),
    (0.55, 0.33, 0.08),
)
BANDS = ((0.7, 0.62, 0.4), (0.75, 0.74, 0.7), (0.1, 0.08, 0.07))


def _book(maker: Maker) -> bpy.types.Material:
    return images.book(maker.random.choice(BOOK_COLORS), maker.random.choice(BANDS))


def books(maker: Maker, start: float, end: float, tallest: float) -> None:
    """A row of standing books from x = start to end, the last one leaning."""
    maker, random = maker.of("books"), maker.random
    x = start
    while x < end - 0.05:
        thick = random.uniform(0.014, 0.042)
        tall = tallest * random.uniform(0.68, 0.97)
        deep = random.uniform(0.14, 0.19)
        back = random.uniform(0, 0.025)
        maker.box((thick, deep, tall), (x + thick / 2, deep / 2 + back, 0), _book(maker))
        x += thick + 0.001
    lean = math.radians(random.uniform(8, 14))
    tall = tallest * 0.8
    at = (x + 0.014 + tall * math.sin(lean) * 0.02, 0.1, 0.004)
    maker.box((0.024, 0.16, tall), at, _book(maker), tilt=(0, -math.degrees(lean), 0))


def pile(maker: Maker, count: int) -> None:
    """Books lying on each other."""
    maker, random, z = maker.of("books"), maker.random, 0.0
    for _ in range(count):
        thick = random.uniform(0.016, 0.034)
        size = (random.uniform(0.19, 0.25), random.uniform(0.14, 0.18), thick)
        turned = maker.at(random.uniform(-0.015, 0.015), 0, z, turn=random.uniform(-14, 14))
        turned.box(size, (0, 0, 0), images.book(random.choice(BOOK_COLORS), BANDS[1]))
        z += thick


def mug(maker: Maker, color: materials.Color) -> None:
    """A mug with a handle."""
    glaze = materials.paint(color, 0.2)
    outline = [(0.03, 0), (0.038, 0.008), (0.04, 0.095), (0.036, 0.095), (0.034, 0.012)]
    maker.lathe(outline, (0, 0, 0), glaze)
    points = [(0.038, 0.075), (0.062, 0.07), (0.066, 0.045), (0.055, 0.025), (0.038, 0.02)]
    for (x0, z0), (x1, z1) in pairwise(points):
        maker.rod((x0, 0, z0), (x1, 0, z1), 0.0055, glaze)


def bowl(maker: Maker, color: materials.Color, *, fruit: bool = True) -> None:
    """A bowl, with apples and oranges."""
    outline = [(0.05, 0), (0.06, 0.01), (0.13, 0.07), (0.124, 0.07), (0.05, 0.02)]
    maker.lathe(outline, (0, 0, 0), materials.paint(color, 0.25))
    colors = ((0.45, 0.05, 0.03), (0.7, 0.28, 0.03), (0.35, 0.4, 0.06))
    for i in range(6 if fruit else 0):
        angle = i * 1.25
        radius = 0.06 if i < 5 else 0.0
        at = (radius * math.cos(angle), radius * math.sin(angle), 0.03 if i < 5 else 0.065)
        maker.soft((0.075, 0.075, 0.07), at, materials.paint(colors[i % 3], 0.4), radius=0.036)


def vase(maker: Maker, color: materials.Color, height: float = 0.28) -> None:
    """A bellied vase."""
    shape = [(0.2, 0), (0.24, 0.03), (0.36, 0.35), (0.3, 0.6), (0.13, 0.85), (0.17, 1), (0.14, 1)]
    maker.lathe([(r * height, z * height) for r, z in shape], (0, 0, 0), materials.paint(color))


def plant(maker: Maker, height: float, leaves: int, *, pot: float = 0.15) -> None:
    """A plant in a pot, arching leaves."""
    random = maker.random
    clay = materials.paint((0.55, 0.5, 0.44), 0.7)
    tall = pot * 1.7
    outline = [(pot * 0.7, 0), (pot, tall), (pot * 0.92, tall), (pot * 0.88, tall * 0.88)]
    maker.lathe(outline, (0, 0, 0), clay)
    greens = ((0.035, 0.11, 0.025), (0.06, 0.15, 0.03), (0.03, 0.085, 0.03))
    for i in range(leaves):
        angle = i * 2.4 + random.uniform(-0.3, 0.3)
        rise = (height - tall) * random.uniform(0.55, 1.0)
        reach = rise * random.uniform(0.25, 0.75)
        _leaf(maker, (angle, rise, reach, tall * 0.9), materials.leaf(greens[i % 3]))


def _leaf(
    maker: Maker, course: tuple[float, float, float, float], green: bpy.types.Material
) -> None:
    """A bent leaf: angle around the stem, how high, how far, where it starts."""
    angle, rise, reach, start = course
    steps, wide = 9, 0.035 + 0.05 * rise
    points = []
    for i in range(steps):
        t = i / (steps - 1)
        out, up = reach * t**1.6, start + rise * (t - 0.35 * t**3.2)
        half = wide * math.sin(math.pi * min(1, 0.06 + 0.94 * t)) ** 0.8 * (t > 0.3) + 0.004
        for side in (-1, 0, 1):
            x = out * math.cos(angle) - side * half * math.sin(angle)
            y = out * math.sin(angle) + side * half * math.cos(angle)
            points.append((x, y, up + abs(side) * half * 0.35))
    faces = [
        (3 * i + k, 3 * i + k + 1, 3 * i + k + 4, 3 * i + k + 3)
        for i in range(steps - 1)
        for k in (0, 1)
    ]
    maker.add(np.array(points), faces, green)


def cushion(
    maker: Maker,
    cloth: bpy.types.Material,
    *,
    lean: float = 68,
    roll: float = 0,
    size: float = 0.45,
) -> None:
    """A cushion leaning back toward +y."""
    maker.soft(
        (size, size, 0.15),
        (0, 0, size * 0.34),
        cloth,
        radius=0.07,
        puff=0.03,
        pinch=0.7,
        wrinkle=0.012,
        tilt=(lean, roll, 0),
    )


def table_lamp(maker: Maker, watts: float, height: float = 0.46) -> None:
    """A ceramic foot and a cloth shade that glows."""
    foot = [(0.07, 0), (0.075, 0.02), (0.05, 0.06), (0.07, 0.14), (0.02, height * 0.55)]
    maker.lathe(foot, (0, 0, 0), materials.paint((0.1, 0.2, 0.22), 0.25))
    maker.rod((0, 0, 0.2), (0, 0, height * 0.7), 0.008, materials.metal())
    shade = [(0.15, height * 0.56), (0.105, height), (0.103, height), (0.148, height * 0.56)]
    maker.lathe(shade, (0, 0, 0), materials.glowing((1.0, 0.66, 0.34), 2.2))
    shell.bulb(maker, (0, 0, height + 0.1), watts)


def desk_lamp(maker: Maker) -> None:
    """A jointed lamp that is switched off."""
    black = materials.paint((0.03, 0.03, 0.035), 0.35)
    maker.cylinder(0.085, 0.02, (0, 0, 0), black)
    maker.rod((0, 0, 0.02), (-0.06, 0, 0.3), 0.007, black)
    maker.rod((-0.06, 0, 0.3), (0.16, -0.06, 0.46), 0.007, black)
    hood = [(0.02, 0.07), (0.03, 0.05), (0.075, -0.02), (0.07, -0.02)]
    maker.lathe(hood, (0.17, -0.065, 0.43), black, tilt=(10, -25, 0))


def floor_lamp(maker: Maker, watts: float) -> None:
    """A standing lamp with a cloth shade."""
    black = materials.metal((0.1, 0.095, 0.09))
    maker.cylinder(0.14, 0.025, (0, 0, 0), black)
    maker.rod((0, 0, 0.02), (0, 0, 1.4), 0.012, black)
    shade = [(0.22, 1.28), (0.15, 1.58), (0.148, 1.58), (0.218, 1.28)]
    maker.lathe(shade, (0, 0, 0), materials.glowing((1.0, 0.7, 0.4), 1.6))
    shell.bulb(maker, (0, 0, 1.68), watts)


def monitor(
    maker: Maker,
    width: float = 0.56,
    tall: float = 0.301,
    *,
    lift: float = 0.1,
    color: materials.Color = (0.015, 0.015, 0.016),
    shown: bpy.types.Material | None = None,
) -> None:
    """A monitor on a foot, its screen (`tall`) toward -y; it is off if nothing is `shown`."""
    maker = maker.of("tv")
    case, gray = materials.paint(color, 0.4), materials.metal((0.4, 0.4, 0.42))
    maker.box((0.22, 0.18, 0.012), (0, 0.02, 0), gray)
    maker.box((0.05, 0.03, min(0.3, lift + 0.9 * tall)), (0, 0.05, 0.01), gray)
    maker.box((width, 0.03, tall + 0.035), (0, 0.02, lift), case, bevel=0.005)
    inner = (width - 0.02, 0.003, tall)
    maker.box(inner, (0, 0.0045, lift + 0.022), shown or images.screen(), bevel=0.001)


def keyboard(maker: Maker) -> None:
    """A keyboard and a mouse."""
    body, keys = materials.paint((0.04, 0.04, 0.042), 0.5), materials.paint((0.09, 0.09, 0.1), 0.6)
    maker.box((0.44, 0.14, 0.016), (0, 0, 0), body)
    for row in range(5):
        count = 15 if row else 6
        for i in range(count):
            wide = 0.42 / count
            at = (-0.21 + wide * (i + 0.5), 0.052 - 0.026 * (4 - row), 0.014)
            maker.box((wide - 0.004, 0.021, 0.008), at, keys, bevel=0.002)
    maker.soft((0.06, 0.1, 0.034), (0.31, 0, 0), body, radius=0.016)


def papers(maker: Maker, count: int) -> None:
    """Sheets of paper at slightly different angles."""
    white = materials.paint((0.78, 0.77, 0.74), 0.9)
    for i in range(count):
        sheet = maker.at(0.006 * i, 0.004 * i, 0.0012 * i, turn=maker.random.uniform(-12, 12))
        sheet.box((0.21, 0.297, 0.001), (0, 0, 0.0002), white, bevel=0)


def carton(maker: Maker, size: tuple[float, float, float], color: materials.Color) -> None:
    """A cardboard or cloth box."""
    cloth = materials.fabric(color, 150, 0.12)
    maker.soft(size, (0, 0, 0), cloth, radius=0.012)
    maker.soft((size[0] + 0.012, size[1] + 0.012, 0.03), (0, 0, size[2] - 0.02), cloth, radius=0.01)


def basket(maker: Maker, color: materials.Color) -> None:
    """A paper basket."""
    outline = [(0.11, 0), (0.14, 0.3), (0.132, 0.3), (0.105, 0.015)]
    maker.lathe(outline, (0, 0, 0), materials.paint(color, 0.6))


def clock(facing: Maker, x: float, z: float) -> None:
    """A wall clock (`facing`: see `Shell.wall`)."""
    black, white = materials.paint((0.02, 0.02, 0.02)), materials.paint((0.8, 0.8, 0.78), 0.6)
    facing = facing.of("objects")
    facing.lathe([(0.15, 0), (0.15, 0.03), (0.135, 0.035)], (x, 0, z), black, tilt=(90, 0, 0))
    facing.lathe([(0.135, 0), (0.13, 0.004)], (x, -0.035, z), white, tilt=(90, 0, 0))
    facing.rod((x, -0.042, z), (x + 0.04, -0.042, z + 0.06), 0.005, black)
    facing.rod((x, -0.042, z), (x - 0.09, -0.042, z + 0.03), 0.004, black)


def slippers(maker: Maker, color: materials.Color) -> None:
    """A pair of slippers."""
    felt = materials.fabric(color)
    for x, turn in ((-0.07, 6), (0.06, -9)):
        shoe = maker.at(x, 0, turn=turn)
        shoe.soft((0.095, 0.26, 0.025), (0, 0, 0), felt, radius=0.012)
        shoe.soft((0.095, 0.14, 0.07), (0, 0.055, 0.0), felt, radius=0.033, puff=0.01)


def laptop(maker: Maker) -> None:
    """An open laptop, its keys toward -y."""
    gray, black = materials.metal((0.5, 0.5, 0.52), 0.45), materials.paint((0.03, 0.03, 0.032), 0.6)
    maker.box((0.32, 0.22, 0.014), (0, 0, 0), gray, bevel=0.005)
    maker.box((0.27, 0.1, 0.002), (0, 0.03, 0.013), black, bevel=0.0005)
    maker.box((0.32, 0.008, 0.215), (0, 0.112, 0.012), gray, bevel=0.003, tilt=(-18, 0, 0))
    shown = images.landscape(4, glow=0.25)
    maker.box((0.3, 0.002, 0.19), (0, 0.107, 0.024), shown, bevel=0, tilt=(-18, 0, 0))
