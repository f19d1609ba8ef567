"""Rendered videos: a random path without Blender, and what `render --videos` writes with it."""

import csv
import importlib.util
import itertools
from random import Random

import numpy as np
import pytest
from PIL import Image
from sequences import Sequence

from nunet_models.classes import IGNORE
from nunet_models.rendering import command
from nunet_models.rendering.robot_path import MARGIN_M, checked_frames, random_path

NEEDS_BLENDER = pytest.mark.skipif(
    importlib.util.find_spec("bpy") is None, reason="needs Blender's module bpy"
)
VIDEOS, FRAMES = ("s3v00000", "s3v00001"), 4
ROOM = (3.0, 4.0)


def test_a_random_path_is_long_enough_smooth_and_away_from_the_walls():
    paths = [random_path(Random(seed), ROOM, 2.5) for seed in range(20)]
    for path in paths:
        assert path.length_m >= 2.5
        points = path.samples(0.05)
        assert (points >= MARGIN_M).all() and (points <= np.array(ROOM) - MARGIN_M).all()
        headings = [path.heading_deg(s) for s in np.arange(0, 2.5, 0.05)]
        turns = np.diff(np.unwrap(headings, period=360))
        assert np.abs(turns).max() < 20
    starts = {tuple(path.point(0.0)) for path in paths}
    assert len(starts) == 20


def test_a_random_path_repeats_with_its_seed():
    first, again = (random_path(Random(5), ROOM, 2.0).samples(0.1) for _ in range(2))
    assert (first == again).all()


def test_no_path_fits_into_a_room_that_is_too_small():
    assert random_path(Random(0), (1.2, 1.2), 2.0) is None
    assert random_path(Random(0), (1.2, 9.0), 2.0) is not None


@pytest.mark.parametrize("frames", [2, 3, 7, 40, 10_000])
def test_a_video_is_checked_from_its_first_to_its_last_frame(frames):
    checked = checked_frames(frames)
    assert checked[0] == (frames - 1, True), "the end refuses most paths"
    showing = sorted(frame for frame, shows in checked if shows)
    assert showing[0] == 0 and len(showing) == min(frames, 5)
    gaps = np.diff(showing)
    assert gaps.max() - gaps.min() <= 1
    every = sorted(frame for frame, _ in checked)
    assert len(set(every)) == len(every) and np.diff(every).max() <= 3


@pytest.fixture(scope="module")
def videos(tmp_path_factory):
    folder = tmp_path_factory.mktemp("videos")
    assert render(folder, "--videos", "2") == 0
    return folder


def render(folder, *more):
    known = ["--frames", str(FRAMES), "--samples", "1", "--seed", "3", "--test-share", "0"]
    return command.main(["--out", str(folder), *known, *more])


def table(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@NEEDS_BLENDER
def test_a_video_is_a_dataset_with_one_camera_and_a_pose_per_frame(videos):
    ids = [f"{video}_{frame:04d}" for video in VIDEOS for frame in range(FRAMES)]
    assert (videos / "train.txt").read_text().split() == ids
    rows = table(videos / "intrinsics.csv")
    assert [row["id"] for row in rows] == ids
    assert [row["scene"] for row in rows] == [name for name in VIDEOS for _ in range(FRAMES)]
    assert {tuple(row[name] for name in ("fx", "fy", "width", "height")) for row in rows} == {
        ("262.0", "262.0", "320", "240")
    }
    for number, video in enumerate(VIDEOS):
        its = ids[number * FRAMES : (number + 1) * FRAMES]
        assert [row["id"] for row in table(videos / f"poses/{video}.csv")] == its


@NEEDS_BLENDER
def test_depth_carried_by_the_poses_of_a_video_meets_its_own(videos):
    for video in VIDEOS:
        (videos / "poses.csv").write_text((videos / f"poses/{video}.csv").read_text())
        sequence = Sequence(videos)
        before, after = f"{video}_0000", f"{video}_{FRAMES - 1:04d}"
        places = [sequence.poses[name][:, 3] for name in (before, after)]
        assert np.linalg.norm(places[1] - places[0]) > 0.01
        predicted, own = sequence.carried(before, after)
        assert predicted.size > 0.3 * 320 * 240
        # As in the drive: depth is rounded to millimeters.
        assert np.median(np.abs(predicted - own)) < 0.0006


@NEEDS_BLENDER
def test_the_robot_is_never_inside_of_a_thing(videos):
    for path in (videos / "depth").iterdir():
        depth_m = np.array(Image.open(path)) / 1000
        assert (depth_m > 0).mean() > 0.97
        assert (depth_m[depth_m > 0] < 0.22).mean() < 0.05
        labels = np.array(Image.open(videos / f"labels/{path.name}"))
        assert (labels != IGNORE).mean() > 0.97


@NEEDS_BLENDER
def test_exposure_changes_slowly(videos):
    for video in VIDEOS:
        frames = [f"{videos}/rgb/{video}_{frame:04d}.jpg" for frame in range(FRAMES)]
        means = [np.array(Image.open(frame).convert("L"), float).mean() for frame in frames]
        assert all(abs(b - a) < 12 for a, b in itertools.pairwise(means))


@NEEDS_BLENDER
def test_the_same_command_keeps_complete_videos_and_a_video_is_the_same_alone(videos, tmp_path):
    times = {path: path.stat().st_mtime_ns for path in (videos / "rgb").iterdir()}
    assert render(videos, "--videos", "2") == 0
    assert {path: path.stat().st_mtime_ns for path in (videos / "rgb").iterdir()} == times
    assert render(tmp_path, "--videos", "1", "--start", "1") == 0
    name = f"{VIDEOS[1]}_{FRAMES - 1:04d}"
    for image in (f"depth/{name}.png", f"labels/{name}.png"):
        first, alone = (np.array(Image.open(folder / image)) for folder in (videos, tmp_path))
        assert (first == alone).all()
    poses = [(folder / f"poses/{VIDEOS[1]}.csv").read_text() for folder in (videos, tmp_path)]
    assert poses[0] == poses[1]
