"""Renders videos: a robot drives through random rooms, whose furniture leaves its path free."""

from __future__ import annotations

import logging
import time
from collections import deque
from collections.abc import Container
from dataclasses import dataclass
from random import Random

import bpy
import numpy as np
from mathutils import Matrix

from nunet_models.rendering import kinds, sequence
from nunet_models.rendering.camera import CV_FROM_BLENDER, add_camera
from nunet_models.rendering.drive import ADAPTATION_FRAMES, CAMERA, FRAMES_PER_SECOND, Robot, pose
from nunet_models.rendering.fast import FastRenderer
from nunet_models.rendering.floorplan import Rectangle
from nunet_models.rendering.folder import Rendered, RoomsFolder
from nunet_models.rendering.furnisher import Furnisher
from nunet_models.rendering.generator import SENSOR_NAME, Options, render_photos
from nunet_models.rendering.outcome import Outcome, render_missing
from nunet_models.rendering.robot_path import RobotPath, checked_frames, random_path
from nunet_models.rendering.scene import clear
from nunet_models.rendering.sensor import Metered, Sensor
from nunet_models.rendering.viewpoints import LOW, MIN_THINGS_DRIVING, View, ViewFinder

LOG = logging.getLogger(__name__)
SPEED = (0.25, 0.8)
"""Range of the robots' speed, meters per second."""
SLOWER = (1.0, 0.7, 0.4, 0.2)
"""Factors on the speed that are tried in turn until a path fits into the room."""
CLEARANCE_M = 0.56
"""Furniture leaves a lane of this width."""
ATTEMPTS = 20


@dataclass(frozen=True)
class VideoOptions(Options):
    """What to render; `rooms` counts videos, each of a room of its own."""

    frames: int = 40


@dataclass(frozen=True)
class Ride:
    """A robot on its way."""

    path: RobotPath
    robot: Robot

    def view(self, frame: int) -> View:
        """The camera at a frame."""
        return View(LOW, CAMERA, pose(self.path, frame, self.robot))


def render_videos(options: VideoOptions) -> Outcome:
    """Render all videos that are not complete yet."""
    folder = RoomsFolder(options.out, options.test_share)
    (options.out / "poses").mkdir(exist_ok=True)
    sequence.write_camera(options.out, CAMERA, FRAMES_PER_SECOND)
    photos = render_photos(options)
    numbers = range(options.start, options.start + options.rooms)
    names = (f"s{options.seed}v{index:05d}" for index in numbers)
    return render_missing(names, folder, lambda name: _render_video(name, folder, photos, options))


def _render_video(name: str, folder: RoomsFolder, photos: list[str], options: VideoOptions) -> int:
    started = time.monotonic()
    for attempt in range(ATTEMPTS):
        random = Random(f"{name} {attempt}")
        room, ride = _build(random, photos, options)
        if ride is not None and _is_watchable(ride, random, room, options.frames):
            break
    else:
        LOG.warning("%s: no path found", name)
        return 0
    renderer = FastRenderer(options.samples, options.threads, room.ambient)
    views = {f"{name}_{frame:04d}": ride.view(frame) for frame in range(options.frames)}
    _remove_frames_besides(views, name, folder)
    _render_frames(views, renderer, folder, random)
    poses = {each: _world_from_camera(view.pose) for each, view in views.items()}
    sequence.write_poses(folder.path, poses, name=f"poses/{name}.csv")
    rows = {each: (view.intrinsics, view.placement) for each, view in views.items()}
    folder.finish_room(name, rows, SENSOR_NAME)
    count, seconds = len(views), time.monotonic() - started
    speed = ride.robot.speed
    message = "%s %s: %d frames at %.2f m/s, %.2f s each"
    LOG.info(message, name, room.kind, count, speed, seconds / count)
    return count


def _remove_frames_besides(views: Container[str], name: str, folder: RoomsFolder) -> None:
    """Remove frames that an interrupted run with more of them left."""
    for part in ("rgb", "depth", "labels"):
        for path in (folder.path / part).glob(f"{name}_*"):
            if path.stem not in views:
                path.unlink()


def _build(
    random: Random, photos: list[str], options: VideoOptions
) -> tuple[kinds.Room, Ride | None]:
    """A random room in the open scene, and a way through it; none if the room is too small."""
    clear()
    kind = kinds.draw(random, options.kinds)
    furnisher, room = kinds.build_unfurnished(kind, random, photos)
    ride = _random_ride(random, room.size[:2], options.frames)
    if ride is not None:
        _keep_free(ride.path, furnisher)
    kinds.furnish(furnisher, room)
    return room, ride


def _random_ride(random: Random, size: tuple[float, float], frames: int) -> Ride | None:
    """A robot whose path is as long as it drives in so many frames, if one fits."""
    speed, height_m = random.uniform(*SPEED), random.uniform(0.12, 0.4)
    pitch_deg = random.gauss(1, 4)
    for factor in SLOWER:
        slower = speed * factor
        path = random_path(random, size, slower * frames / FRAMES_PER_SECOND)
        if path is not None:
            return Ride(path, Robot(slower, height_m, pitch_deg))
    return None


def _keep_free(path: RobotPath, furnisher: Furnisher) -> None:
    """Reserve the robot's lane, to its end."""
    for x, y in (*path.samples(0.15), path.point(path.length_m)):
        furnisher.plan.reserve(Rectangle(x, y, CLEARANCE_M, CLEARANCE_M))


def _is_watchable(ride: Ride, random: Random, room: kinds.Room, frames: int) -> bool:
    """Whether the video shows things to its end, and no frame is inside of one or too near."""
    finder = ViewFinder(random, room.size)
    return all(
        finder.is_good(CAMERA, ride.view(frame).pose, 0.0, MIN_THINGS_DRIVING if shows else 0)
        for frame, shows in checked_frames(frames)
    )


def _render_frames(
    views: dict[str, View], renderer: FastRenderer, folder: RoomsFolder, random: Random
) -> None:
    """Render and write the frames of one camera, whose exposure adapts slowly."""
    camera = add_camera(CAMERA, bpy.context.scene)
    sensor = Sensor.draw(random)
    metered: deque[Metered] = deque(maxlen=ADAPTATION_FRAMES + 1)
    for identity, view in views.items():
        camera.matrix_world = view.pose
        light = renderer.light(random.randrange(1 << 30))
        depth_m, labels = renderer.truth()
        metered.append(Metered.of(light))
        noise = np.random.default_rng(random.randrange(1 << 30))
        rgb = sensor.develop(light, noise, Metered.mean(list(metered)))
        image = Rendered(rgb, depth_m, labels, view.intrinsics, sensor.quality)
        folder.write_image(identity, image)


def _world_from_camera(camera: Matrix) -> np.ndarray:
    """`[3, 4]`, of a camera that looks along +z."""
    return np.array(camera @ CV_FROM_BLENDER)[:3]
