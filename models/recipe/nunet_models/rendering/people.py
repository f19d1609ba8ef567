"""Clothed mannequins as obstacles that look like people."""

from __future__ import annotations

from dataclasses import dataclass
from random import Random

import bpy

from nunet_models.rendering import materials
from nunet_models.rendering.shapes import Maker

Material = bpy.types.Material
SKINS = ((0.55, 0.33, 0.22), (0.35, 0.19, 0.11), (0.62, 0.42, 0.31), (0.14, 0.07, 0.04))
TROUSERS = ((0.03, 0.05, 0.12), (0.05, 0.05, 0.05), (0.25, 0.2, 0.14))
HAIR = ((0.02, 0.015, 0.01), (0.12, 0.06, 0.02), (0.35, 0.3, 0.25))
TORSO = (
    (0.1, -0.1),
    (0.155, -0.06),
    (0.14, 0.12),
    (0.17, 0.38),
    (0.15, 0.52),
    (0.07, 0.58),
    (0.055, 0.64),
)
"""Radius and height above the hip."""


@dataclass(frozen=True)
class _Body:
    """Size, posture and clothes."""

    scale: float
    hip: float
    """Height of the hip before scaling."""
    skin: Material
    shirt: Material
    trousers: Material
    hair: Material

    @classmethod
    def draw(cls, random: Random, *, sitting: bool) -> _Body:
        """A random body."""
        return cls(
            scale=random.uniform(0.87, 1.12),
            hip=0.47 if sitting else 0.9,
            skin=materials.paint(random.choice(SKINS), 0.6),
            shirt=materials.fabric(tuple(random.uniform(0.02, 0.6) for _ in range(3)), 220, 0.2),
            trousers=materials.fabric(random.choice(TROUSERS)),
            hair=materials.fabric(random.choice(HAIR)),
        )


def person(maker: Maker, *, sitting: bool = False) -> None:
    """A person 1.5 to 1.95 m tall who faces -y."""
    body = _Body.draw(maker.random, sitting=sitting)
    for side in (-1, 1):
        _leg(maker, body, side, sitting=sitting)
        _arm(maker, body, side)
    scale = body.scale
    maker.lathe([(r * scale, z * scale) for r, z in TORSO], (0, 0, body.hip * scale), body.shirt)
    head = (0, -0.02, (body.hip + 0.62) * scale)
    maker.soft((0.16, 0.19, 0.24), head, body.skin, radius=0.08)
    maker.soft((0.175, 0.19, 0.14), (0, 0.01, head[2] + 0.12), body.hair, radius=0.07)


def _leg(maker: Maker, body: _Body, side: int, *, sitting: bool) -> None:
    stride = 0 if sitting else maker.random.uniform(-0.18, 0.18)
    x, scale = side * 0.1 * body.scale, body.scale
    knee = (x * 1.3, -0.45 * scale, 0.5 * scale) if sitting else (x, stride / 2 - 0.05, 0.5 * scale)
    foot = (x * 1.2, knee[1] + stride * 0.6, 0.08)
    _limb(maker, (x, 0, body.hip * scale), knee, (0.085, 0.06), body.trousers)
    _limb(maker, knee, foot, (0.06, 0.045), body.trousers)
    shoe = materials.paint((0.03, 0.03, 0.03), 0.5)
    maker.soft((0.1, 0.27, 0.09), (foot[0], foot[1] - 0.07, 0), shoe, radius=0.04)


def _arm(maker: Maker, body: _Body, side: int) -> None:
    random, scale = maker.random, body.scale
    shoulder = (side * 0.2 * scale, 0, (body.hip + 0.52) * scale)
    out, ahead = random.uniform(0.24, 0.34), random.uniform(-0.15, 0.12)
    elbow = (side * out, ahead, (body.hip + 0.24) * scale)
    inwards, reach = random.uniform(0.6, 1.1), random.uniform(0, 0.22)
    hand = (elbow[0] * inwards, elbow[1] - reach, (body.hip + 0.05) * scale)
    _limb(maker, shoulder, elbow, (0.055, 0.045), body.shirt)
    _limb(maker, elbow, hand, (0.042, 0.032), random.choice((body.shirt, body.skin)))
    palm = (hand[0], hand[1], hand[2] - 0.08)
    maker.soft((0.08, 0.09, 0.11), palm, body.skin, radius=0.035)


def _limb(
    maker: Maker, start: tuple, end: tuple, radii: tuple[float, float], material: Material
) -> None:
    """A limb with round ends."""
    maker.rod(start, end, sum(radii) / 2, material)
    for (x, y, z), radius in ((start, radii[0]), (end, radii[1])):
        maker.soft((2 * radius,) * 3, (x, y, z - radius), material, radius=radius)
