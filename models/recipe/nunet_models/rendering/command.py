"""The subcommand `render`: rooms, videos, flat images, the drive and the clip, with exact depth."""

from __future__ import annotations

import argparse
import contextlib
import importlib
import importlib.util
import logging
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

from nunet_models.errors import ConfigError, OptionError
from nunet_models.program import EXIT_FAILURE, run_program
from nunet_models.rendering.outcome import MAX_ROOMS, require_all

DEFAULT_FRAMES = 40
MAX_FRAMES = 10_000
"""Frames of a video are numbered with four digits."""


def add_parser(subcommands: argparse._SubParsersAction) -> None:
    """Add `render` to the command line."""
    made = subcommands.add_parser(
        "render", help="render rooms with exact depth and labels (needs bpy)", description=__doc__
    )
    add_options(made)


def add_options(made: argparse.ArgumentParser) -> None:
    """The options of `render`."""
    what = made.add_mutually_exclusive_group(required=True)
    what.add_argument("--rooms", type=int, metavar="N", help="render N random rooms")
    what.add_argument(
        "--flat-images", type=int, metavar="N", help="render N empty rooms with a flat image each"
    )
    what.add_argument(
        "--videos", type=int, metavar="N", help="render N videos of a robot in random rooms"
    )
    what.add_argument("--drive", action="store_true", help="render the drive (models/drive)")
    what.add_argument("--clip", action="store_true", help="render the clip (models/clip)")
    what.add_argument("--check", action="store_true", help="measure depth and pixels; no images")
    made.add_argument("--out", type=Path, help="output folder; images that exist are kept")
    made.add_argument("--threads", type=int, default=1, help="render threads (default 1)")
    _add_room_options(made)
    made.set_defaults(carry_out=carry_out)


def _add_room_options(made: argparse.ArgumentParser) -> None:
    """What is for random rooms, flat images and videos."""
    rooms = made.add_argument_group("random rooms, flat images and videos")
    rooms.add_argument("--start", type=int, default=0, metavar="I", help="first room (default 0)")
    rooms.add_argument(
        "--seed", type=int, default=0, help="the same seed and number give the same room"
    )
    rooms.add_argument(
        "--views", type=int, default=10, metavar="K", help="images per room (default 10)"
    )
    rooms.add_argument(
        "--samples", type=int, default=3, help="rays per pixel before denoising (default 3)"
    )
    rooms.add_argument(
        "--test-share", type=float, default=0.1, help="share of rooms in test.txt (default 0.1)"
    )
    rooms.add_argument(
        "--kinds",
        metavar="KIND,...",
        help="draw from these kinds of rooms alone (default: all but workplace)",
    )
    rooms.add_argument(
        "--view-kinds",
        metavar="KIND,...",
        help="draw from these kinds of views alone: low, driving, near, seated, standing "
        "(default: those of the kind of room)",
    )
    rooms.add_argument(
        "--frames", type=int, metavar="K", help="frames per video, at 10 Hz (default 40)"
    )


def carry_out(options: argparse.Namespace) -> int:
    """Render or check; the exit code."""
    validate(options)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", stream=sys.stderr)
    problems = []
    with _without_blenders_progress():
        if options.check:
            problems = _blender_module("check").problems()
        elif options.drive:
            _blender_module("drive").render_drive(options.out, threads=options.threads)
        elif options.clip:
            _blender_module("clip").render_clip(options.out, threads=options.threads)
        else:
            _render_rooms(options)
    if options.check:
        print("\n".join(problems) or "depth, labels and pixels are right")
    return EXIT_FAILURE if problems else 0


def _render_rooms(options: argparse.Namespace) -> None:
    """Random rooms, rooms with flat images, or videos of rooms."""
    names = ("out", "start", "seed", "views", "samples", "threads", "test_share")
    values = {name: getattr(options, name) for name in names}
    generator = _blender_module("generator")
    if options.flat_images is not None:
        wanted = generator.Options(rooms=options.flat_images, **values)
        _blender_module("flat_images").render_flat_images(wanted)
    elif options.videos is not None:
        videos = _blender_module("videos")
        frames = DEFAULT_FRAMES if options.frames is None else options.frames
        wanted = videos.VideoOptions(rooms=options.videos, frames=frames, **values)
        outcome = videos.render_videos(wanted.of_kinds(_listed(options.kinds)))
        require_all(outcome, option="--videos", lacks="path", start=options.start)
    else:
        kinds, view_kinds = _listed(options.kinds), _listed(options.view_kinds)
        wanted = generator.Options(rooms=options.rooms, **values)
        outcome = generator.render_rooms(wanted.of_kinds(kinds).of_view_kinds(view_kinds))
        require_all(outcome, option="--rooms", lacks="view", start=options.start)


def _listed(names: str | None) -> list[str] | None:
    return names.split(",") if names is not None else None


@contextlib.contextmanager
def _without_blenders_progress() -> Iterator[None]:
    """Blender writes several lines per image to file descriptor 1, past Python's `sys.stdout`."""
    sys.stdout.flush()
    kept = os.dup(1)
    try:
        with Path(os.devnull).open("w") as nowhere:
            os.dup2(nowhere.fileno(), 1)
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)


def validate(options: argparse.Namespace) -> None:
    """Raise `OptionError` for values that cannot be."""
    if not options.check and options.out is None:
        raise OptionError("`--out` is missing: it names the output folder")
    if options.out is not None and options.out.exists() and not options.out.is_dir():
        raise OptionError(f"`--out {options.out}` is a file, expected a folder")
    for flag, count in _counts(options).items():
        if count is not None:
            _require_range(flag, count, 1, MAX_ROOMS)
            _require_range("--start", options.start, 0, MAX_ROOMS - count)
    _require_range("--views", options.views, 1, 100)
    _require_range("--samples", options.samples, 1, 4096)
    _require_range("--threads", options.threads, 1, 1024)
    if options.frames is not None:
        _require_range("--frames", options.frames, 2, MAX_FRAMES)
    _require_use(options)
    if not 0 <= options.test_share <= 1:
        raise OptionError(f"`--test-share` is {options.test_share}, expected 0 to 1")


def _counts(options: argparse.Namespace) -> dict[str, int | None]:
    return {
        "--rooms": options.rooms,
        "--flat-images": options.flat_images,
        "--videos": options.videos,
    }


def _require_use(options: argparse.Namespace) -> None:
    """Refuse options that what is rendered does not use."""
    if options.kinds is not None and options.rooms is None and options.videos is None:
        raise OptionError("`--kinds` is for `--rooms` and `--videos` alone")
    if options.view_kinds is not None and options.rooms is None:
        raise OptionError("`--view-kinds` is for `--rooms` alone")
    if options.frames is not None and options.videos is None:
        raise OptionError("`--frames` is for `--videos` alone")


def _require_range(flag: str, value: int, low: int, high: int) -> None:
    if not low <= value <= high:
        raise OptionError(f"`{flag}` is {value}, expected {low} to {high}")


def _blender_module(name: str) -> ModuleType:
    """A module of this package that imports `bpy`."""
    if importlib.util.find_spec("bpy") is None:
        raise ConfigError(
            "cannot render: Blender's Python module `bpy` is not installed",
            hint="pip install 'bpy==4.5.*' (Python 3.11)",
        )
    return importlib.import_module(f"nunet_models.rendering.{name}")


def main(arguments: list[str] | None = None) -> int:
    """Run `render` alone and return the exit code."""
    parser = argparse.ArgumentParser(prog="nunet_models render", description=__doc__)
    add_options(parser)
    return run_program(parser, arguments)
