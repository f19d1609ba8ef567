"""Renders random rooms into a dataset's folder."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from random import Random

import bpy
import numpy as np
from PIL import Image

from nunet_models.errors import OptionError
from nunet_models.rendering import clip_rooms
from nunet_models.rendering.camera import add_camera, set_intrinsics
from nunet_models.rendering.fast import FastRenderer
from nunet_models.rendering.folder import Placement, Rendered, RoomsFolder, replace_image
from nunet_models.rendering.intrinsics import Intrinsics
from nunet_models.rendering.kinds import DEFAULT_KINDS, KINDS, build
from nunet_models.rendering.outcome import Outcome, render_missing
from nunet_models.rendering.scene import clear
from nunet_models.rendering.sensor import Sensor
from nunet_models.rendering.viewpoints import VIEW_KINDS, View, ViewFinder

LOG = logging.getLogger(__name__)
SENSOR_NAME = "rendered"
PHOTOS_PER_ROOM = 4
AMBIENT = (0.15, 0.15, 0.15)


@dataclass(frozen=True)
class Options:
    """What to render."""

    out: Path
    rooms: int
    start: int = 0
    seed: int = 0
    views: int = 10
    samples: int = 3
    threads: int = 1
    test_share: float = 0.1
    kinds: tuple[str, ...] = DEFAULT_KINDS
    view_kinds: tuple[str, ...] | None = None
    """None: those of the kind of room."""

    def of_kinds(self, names: Sequence[str] | None) -> Options:
        """The same with rooms of these kinds alone; None keeps the kinds."""
        for name in names or ():
            if name not in KINDS:
                raise OptionError(f"`--kinds` has `{name}`, expected some of: {', '.join(KINDS)}")
        return self if names is None else replace(self, kinds=tuple(names))

    def of_view_kinds(self, names: Sequence[str] | None) -> Options:
        """The same with views of these kinds alone, equally often; None keeps the kinds."""
        for name in names or ():
            if name not in VIEW_KINDS:
                expected = ", ".join(VIEW_KINDS)
                raise OptionError(f"`--view-kinds` has `{name}`, expected some of: {expected}")
        if names is None:
            return self
        return replace(self, view_kinds=tuple(kind for kind in VIEW_KINDS if kind in names))

    def view_shares(self, room: Mapping[str, float]) -> Mapping[str, float]:
        """How often each kind of view is drawn, where a kind of room has these shares."""
        return room if self.view_kinds is None else dict.fromkeys(self.view_kinds, 1.0)


def render_rooms(options: Options) -> Outcome:
    """Render all rooms that are not complete yet."""
    folder = RoomsFolder(options.out, options.test_share)
    photos = render_photos(options)
    numbers = range(options.start, options.start + options.rooms)
    names = (f"s{options.seed}r{index:05d}" for index in numbers)
    return render_missing(names, folder, lambda name: _render_room(name, folder, photos, options))


def _render_room(name: str, folder: RoomsFolder, photos: list[str], options: Options) -> int:
    started = time.monotonic()
    clear()
    room, random = build(name, photos, options.kinds)
    finder = ViewFinder(random, room.size, options.view_shares(room.views))
    views = [view for _ in range(options.views) if (view := finder.find())]
    if not views:
        LOG.warning("%s (%s): no view found", name, room.kind)
        return 0
    built = time.monotonic() - started
    renderer = FastRenderer(options.samples, options.threads, room.ambient)
    written = _render_views(name, views, renderer, folder)
    folder.finish_room(name, written, SENSOR_NAME)
    count, seconds = len(written), time.monotonic() - started
    message = "%s %s: %d images, %.2f s each (built in %.1f s)"
    LOG.info(message, name, room.kind, count, seconds / count, built)
    return count


def _render_views(
    name: str, views: list[View], renderer: FastRenderer, folder: RoomsFolder
) -> dict[str, tuple[Intrinsics, Placement]]:
    """Render and write a room's views; what `finish_room` needs."""
    camera = add_camera(views[0].intrinsics, bpy.context.scene)
    written = {}
    for number, view in enumerate(views):
        identity = f"{name}v{number:02d}"
        set_intrinsics(view.intrinsics, bpy.context.scene)
        camera.matrix_world = view.pose
        folder.write_image(identity, _render_view(identity, view, renderer))
        written[identity] = (view.intrinsics, view.placement)
    return written


def _render_view(identity: str, view: View, renderer: FastRenderer) -> Rendered:
    random = Random(identity)
    light = renderer.light(random.randrange(1 << 30))
    depth_m, labels = renderer.truth()
    sensor = Sensor.draw(random)
    rgb = sensor.develop(light, np.random.default_rng(random.randrange(1 << 30)))
    return Rendered(rgb, depth_m, labels, view.intrinsics, sensor.quality)


def render_photos(options: Options) -> list[str]:
    """Images of the clip's furnished rooms, for posters, murals and screens of other rooms."""
    wanted = {
        f"{room}{frame}": partial(_photo, room, frame, options)
        for room in sorted(clip_rooms.ROOMS)
        for frame in range(PHOTOS_PER_ROOM)
    }
    return keep_photos(options.out, wanted)


def keep_photos(out: Path, wanted: Mapping[str, Callable[[], Image.Image]]) -> list[str]:
    """Paths of named images in `out/photos`; those that are not there yet are made."""
    folder = out / "photos"
    folder.mkdir(parents=True, exist_ok=True)
    paths = {folder / f"{name}.jpg": made for name, made in wanted.items()}
    for path, made in paths.items():
        if not path.exists():
            replace_image(path, made(), quality=90)
    return [str(path.resolve()) for path in paths]


def _photo(room: str, frame: int, options: Options) -> Image.Image:
    clear()
    shot = clip_rooms.ROOMS[room](Random(f"photo {room}"))
    camera = add_camera(Intrinsics().scaled(0.5), bpy.context.scene)
    camera.matrix_world = shot.motion.pose(12 * frame)
    renderer = FastRenderer(options.samples, options.threads, AMBIENT)
    sensor = Sensor(0.2, 0.7, 0.5, 1.0, 1.0, 0.5, 0.0, 0.1, 90)
    return sensor.develop(renderer.light(frame), np.random.default_rng(frame))
