"""Renders flat images of furniture in empty rooms: the test for depth that is not there.

Each room has one pane: a poster, a mural, a screen or a mirror. It is rendered twice from one
place, with the pane as it is (`rgb/`) and with a gray pane (`plain/`). Depth is the same in both,
so whatever a network predicts differently comes from what the pane shows.
"""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass
from functools import partial
from random import Random

import bpy
import numpy as np
from mathutils import Matrix, Vector
from PIL import Image

from nunet_models.rendering import equipment, kinds, materials
from nunet_models.rendering.camera import add_camera, turned
from nunet_models.rendering.fast import FastRenderer
from nunet_models.rendering.floorplan import SIDES
from nunet_models.rendering.folder import Rendered, RoomsFolder, replace_image
from nunet_models.rendering.furnisher import Furnisher
from nunet_models.rendering.generator import SENSOR_NAME, Options, keep_photos
from nunet_models.rendering.intrinsics import Intrinsics, random_intrinsics
from nunet_models.rendering.panes import MIRROR, MURAL, PANE_KINDS, PANES, PLAIN, POSTER, SCREEN
from nunet_models.rendering.scene import clear
from nunet_models.rendering.sensor import Metered, Sensor
from nunet_models.rendering.viewpoints import STANDING, View, ViewFinder

LOG = logging.getLogger(__name__)
PHOTOS = 8
FURNISHED = ("living", "bedroom", "office", "kitchen")
PANE_INDEX = 200  # of the pane's object; labels end at 13
GRAY = (0.4, 0.4, 0.4)
MARGIN_M = 0.3  # between the camera and the walls
ATTEMPTS = 50
LOW_SHARE = 0.4
"""Share of views from 0.1 to 0.4 m above the floor."""

SIZES = {
    POSTER: ((0.5, 1.0), (0.7, 1.4), (0.9, 1.3)),
    MURAL: ((1.6, 3.0), (0.6, 0.75), (0.05, 0.3)),
    SCREEN: ((0.6, 1.4), (0.6, 0.6), (0.7, 1.1)),
    MIRROR: ((0.5, 1.2), (1.2, 2.0), (0.05, 0.5)),
}
"""Ranges of a pane's width, of its height by its width, and of its lower edge, in meters."""


@dataclass(frozen=True)
class Pane:
    """A pane on a wall: its object, the wall's frame, and its middle in that frame."""

    thing: bpy.types.Object
    wall: Matrix
    middle: Vector
    width: float


def render_flat_images(options: Options) -> int:
    """Render all rooms that are not complete yet; the number of rooms that were rendered."""
    folder = RoomsFolder(options.out, test_share=1.0)
    for name in (PLAIN, PANES):
        (options.out / name).mkdir(exist_ok=True)
    photos, count = _photos(options), 0
    for index in range(options.start, options.start + options.rooms):
        name = f"f{options.seed}r{index:05d}"
        if not folder.is_complete(name):
            _render_room(name, PANE_KINDS[index % len(PANE_KINDS)], folder, photos, options)
            count += 1
    return count


def _render_room(
    name: str, kind: str, folder: RoomsFolder, photos: list[str], options: Options
) -> None:
    clear()
    random = Random(name)
    furnisher, room = kinds.build_unfurnished("empty", random, photos)
    pane = _hang(kind, furnisher)
    view = _find_view(kind, pane, room, random)
    renderer = FastRenderer(options.samples, options.threads, room.ambient)
    camera = add_camera(view.intrinsics, bpy.context.scene)
    camera.matrix_world = view.pose
    _write(name, pane, view, renderer, folder)
    folder.finish_room(name, {name: (view.intrinsics, view.placement)}, SENSOR_NAME)
    LOG.info("%s: %s of %.2f m", name, kind, pane.width)


def _hang(kind: str, f: Furnisher) -> Pane:
    """Hang a pane on a wall that has neither a window nor a door."""
    random, room = f.random, f.room
    taken = {side for side, _, _ in f.walls_taken}
    side = random.choice([side for side in SIDES if side not in taken])
    facing, length = room.wall(f.maker, side)
    width, ratio, z = (random.uniform(*limits) for limits in SIZES[kind])
    width = min(width, length - 0.4)
    height = min(width * ratio, room.height - z - 0.1)
    x = random.uniform(width / 2 + 0.1, length - width / 2 - 0.1)
    if kind == MIRROR:
        thing = equipment.mirror(facing, x, z, (width, height))
    else:
        glow = random.uniform(0.5, 2) if kind == SCREEN else 0
        thing = equipment.poster(facing, x, z, (width, height), random.choice(f.photos), glow)
    return Pane(thing, facing.frame, Vector((x, 0, z + height / 2)), width)


def _find_view(kind: str, pane: Pane, room: kinds.Room, random: Random) -> View:
    """A camera in the room that looks at the pane, from nearer if that does not fit."""
    reach = 1.0
    for _ in range(ATTEMPTS):
        distance = reach * pane.width * random.uniform(0.8, 2.2) + 0.4
        aside = math.radians(random.uniform(-40, 40))
        low = random.random() < LOW_SHARE
        eye_z = random.uniform(0.1, 0.4) if low else random.uniform(0.6, 1.8)
        x = pane.middle.x + distance * math.sin(aside)
        eye = pane.wall @ Vector((x, -distance * math.cos(aside), eye_z))
        floor = zip(eye[:2], room.size[:2], strict=True)
        if all(MARGIN_M < at < limit - MARGIN_M for at, limit in floor):
            break
        reach *= 0.95
    return View(kind, random_intrinsics(random), _toward(pane.wall @ pane.middle, eye, random))


def _toward(target: Vector, eye: Vector, random: Random) -> Matrix:
    """A pose at `eye` that looks roughly at `target`."""
    aim = (target - eye).normalized()
    yaw, pitch = math.degrees(math.atan2(-aim.x, aim.y)), math.degrees(math.asin(aim.z))
    rotation = turned(yaw + random.gauss(0, 4), pitch + random.gauss(0, 3), random.gauss(0, 2))
    return Matrix.Translation(eye) @ rotation


def _write(name: str, pane: Pane, view: View, renderer: FastRenderer, folder: RoomsFolder) -> None:
    """The image, the same with a gray pane, depth, labels, and where the pane is."""
    random = Random(name)
    seed, sensor = random.randrange(1 << 30), Sensor.draw(random)
    label, pane.thing.pass_index = pane.thing.pass_index - 1, PANE_INDEX
    depth_m, labels = renderer.truth()
    mask = labels == PANE_INDEX - 1
    labels[mask] = label
    light = renderer.light(seed)
    pane.thing.data.materials[0] = materials.paint(GRAY, 0.5)
    plain = renderer.light(seed)
    # Exposure and noise of both images are equal, so that they differ by the pane alone.
    metered = Metered.of(light)
    rgb, gray = (
        sensor.develop(image, np.random.default_rng(seed), metered) for image in (light, plain)
    )
    folder.write_image(name, Rendered(rgb, depth_m, labels, view.intrinsics, sensor.quality))
    replace_image(folder.path / f"{PLAIN}/{name}.jpg", gray, quality=sensor.quality)
    shown = Image.fromarray(np.where(mask, 255, 0).astype(np.uint8))
    replace_image(folder.path / f"{PANES}/{name}.png", shown)


def _photos(options: Options) -> list[str]:
    """Images of furnished random rooms that no other subcommand renders."""
    wanted = {
        f"room{number:02d}": partial(_photo, f"flat photo {number}", options)
        for number in range(PHOTOS)
    }
    return keep_photos(options.out, wanted)


def _photo(seed_text: str, options: Options) -> Image.Image:
    """An image of a furnished room, 640x480."""
    view, attempt = None, 0
    while view is None:
        clear()
        room, random = kinds.build(f"{seed_text} {attempt}", [], FURNISHED)
        view = ViewFinder(random, room.size).find(kind=STANDING)
        attempt += 1
    camera = add_camera(Intrinsics(), bpy.context.scene)
    camera.matrix_world = view.pose
    renderer = FastRenderer(options.samples, options.threads, room.ambient)
    sensor = Sensor(0.2, 0.7, 0.5, 1.0, 1.0, 0.3, 0.0, 0.1, 90)
    return sensor.develop(renderer.light(1), np.random.default_rng(1))
