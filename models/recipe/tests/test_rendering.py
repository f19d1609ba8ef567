"""What `render` does without Blender: options, cameras, places, the dataset's folder."""

import csv
import errno
import importlib.util
import json
import multiprocessing
import subprocess
import sys
from functools import partial
from pathlib import Path
from random import Random
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from nunet_models.cli import main
from nunet_models.errors import DataError
from nunet_models.rendering import command
from nunet_models.rendering import folder as folder_module
from nunet_models.rendering.floorplan import FloorPlan, Rectangle
from nunet_models.rendering.folder import (
    Placement,
    Rendered,
    RoomsFolder,
    is_test_room,
    read_rows,
)
from nunet_models.rendering.intrinsics import HFOV_DEG, IMAGE_SIZES, random_intrinsics
from nunet_models.rendering.outcome import render_missing
from nunet_models.rendering.robot_path import RobotPath
from nunet_models.rendering.sensor import Metered, Sensor
from nunet_models.rendering.sequence import write_camera

NEEDS_BLENDER = pytest.mark.skipif(
    importlib.util.find_spec("bpy") is None, reason="needs Blender's module bpy"
)
CAMERA = random_intrinsics(Random(1))
VIEW = (CAMERA, Placement("low", 0.25, 3.0, -1.5))


def rendered():
    shape = (CAMERA.height, CAMERA.width)
    depth_m = np.full(shape, 1.5)
    depth_m[0, 0] = np.nan
    rgb = Image.new("RGB", (CAMERA.width, CAMERA.height), (90, 120, 60))
    return Rendered(rgb, depth_m, np.full(shape, 4, np.uint8), CAMERA, 90)


def write_room(folder, room, views=2):
    for view in range(views):
        folder.write_image(f"{room}v{view:02d}", rendered())
    folder.finish_room(room, {f"{room}v{view:02d}": VIEW for view in range(views)}, "rendered")


def test_without_blender_the_error_names_the_package_to_install(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert main(["render", "--rooms", "1", "--out", str(tmp_path / "out")]) == 1
    stderr = capsys.readouterr().err
    assert "`bpy` is not installed" in stderr
    assert "hint: pip install 'bpy==4.5.*'" in stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--rooms", "0"], "`--rooms` is 0, expected 1 to 100000"),
        (["--flat-images", "0"], "`--flat-images` is 0, expected 1 to 100000"),
        (["--rooms", "5", "--start", "-1"], "`--start` is -1, expected 0 to 99995"),
        (["--rooms", "5", "--views", "0"], "`--views` is 0, expected 1 to 100"),
        (["--rooms", "5", "--threads", "0"], "`--threads` is 0, expected 1 to 1024"),
        (["--rooms", "5", "--test-share", "1.5"], "`--test-share` is 1.5, expected 0 to 1"),
        (["--videos", "0"], "`--videos` is 0, expected 1 to 100000"),
        (["--videos", "2", "--start", "99999"], "`--start` is 99999, expected 0 to 99998"),
        (["--videos", "2", "--frames", "1"], "`--frames` is 1, expected 2 to 10000"),
        (["--videos", "2", "--view-kinds", "low"], "`--view-kinds` is for `--rooms` alone"),
        (["--rooms", "2", "--frames", "9"], "`--frames` is for `--videos` alone"),
        (
            ["--flat-images", "5", "--kinds", "office"],
            "`--kinds` is for `--rooms` and `--videos` alone",
        ),
        (["--flat-images", "5", "--view-kinds", "low"], "`--view-kinds` is for `--rooms` alone"),
    ],
)
def test_a_value_that_cannot_be_is_a_bad_argument(arguments, message, capsys, tmp_path):
    assert main(["render", "--out", str(tmp_path), *arguments]) == 2
    assert message in capsys.readouterr().err


def test_an_output_folder_is_required_and_may_not_be_a_file(capsys, tmp_path):
    assert main(["render", "--drive"]) == 2
    assert "`--out` is missing" in capsys.readouterr().err
    (tmp_path / "file").write_text("")
    assert main(["render", "--drive", "--out", str(tmp_path / "file")]) == 2
    assert "is a file, expected a folder" in capsys.readouterr().err


def test_rendering_alone_prints_errors_as_every_subcommand_does(monkeypatch, capsys, tmp_path):
    def missing(options):
        raise FileNotFoundError(errno.ENOENT, "No such file or directory", "photo.jpg")

    monkeypatch.setattr(command, "validate", missing)
    arguments = ["--drive", "--out", str(tmp_path)]
    printed = []
    for run in (lambda: command.main(arguments), lambda: main(["render", *arguments])):
        assert run() == 1
        printed.append(capsys.readouterr().err)
    assert printed == ["nunet_models: `photo.jpg`: no such file or directory\n"] * 2


def test_the_command_line_does_not_import_blender():
    code = "import sys; sys.modules['bpy'] = None; import nunet_models.cli"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_a_room_is_written_with_truth_and_one_row_per_image(tmp_path):
    folder = RoomsFolder(tmp_path, 0.0)
    write_room(folder, "s0r00001")
    rows = read_rows(tmp_path / "intrinsics.csv")
    assert [row["id"] for row in rows] == ["s0r00001v00", "s0r00001v01"]
    assert {row["scene"] for row in rows} == {"s0r00001"}
    assert float(rows[0]["fx"]) == CAMERA.fx_px
    assert (tmp_path / "train.txt").read_text().split() == ["s0r00001v00", "s0r00001v01"]
    views = (tmp_path / "views.csv").read_text().splitlines()
    assert views[:2] == ["id,kind,height_m,pitch_deg,roll_deg", "s0r00001v00,low,0.250,3.00,-1.50"]
    depth = np.array(Image.open(tmp_path / "depth/s0r00001v00.png"))
    assert depth.dtype == np.uint16
    assert (depth[0, 0], depth[5, 5]) == (0, 1500)
    assert np.array(Image.open(tmp_path / "labels/s0r00001v01.png")).max() == 4
    assert not list(tmp_path.rglob("*.part"))


def test_a_run_that_was_killed_continues_and_keeps_each_row_once(tmp_path, monkeypatch):
    folder = RoomsFolder(tmp_path, 0.0)
    write_room(folder, "s0r00000")
    appended = folder_module.append_lines

    def killed_before_the_table(path, lines, **options):
        if path.name == "intrinsics.csv":
            raise KeyboardInterrupt
        appended(path, lines, **options)

    monkeypatch.setattr(folder_module, "append_lines", killed_before_the_table)
    with pytest.raises(KeyboardInterrupt):
        write_room(folder, "s0r00001")
    monkeypatch.undo()
    again = RoomsFolder(tmp_path, 0.0)
    assert again.is_complete("s0r00000")
    assert not again.is_complete("s0r00001")
    write_room(again, "s0r00001")
    assert RoomsFolder(tmp_path, 0.0).is_complete("s0r00001")
    assert len(read_rows(tmp_path / "intrinsics.csv")) == 4
    assert len((tmp_path / "train.txt").read_text().split()) == 4


def _add_rooms(path, names):
    folder = RoomsFolder(path, 0.5)
    for name in names:
        folder.finish_room(name, {f"{name}v00": VIEW}, "rendered")


def test_processes_that_share_a_folder_lose_no_room(tmp_path):
    names = [[f"s{seed}r{number:05d}" for number in range(40)] for seed in range(3)]
    workers = [multiprocessing.Process(target=_add_rooms, args=(tmp_path, each)) for each in names]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join(60)
    rows = read_rows(tmp_path / "intrinsics.csv")
    assert sorted(row["scene"] for row in rows) == sorted(name for each in names for name in each)


def test_processes_may_write_the_same_file_at_the_same_moment(tmp_path, monkeypatch):
    write, other = Path.write_bytes, []

    def write_while_another_process_does(path, content):
        written = write(path, content)
        if not other:
            other.append(path)
            write_camera(tmp_path, CAMERA, 10)
        return written

    monkeypatch.setattr(Path, "write_bytes", write_while_another_process_does)
    write_camera(tmp_path, CAMERA, 10)
    assert json.loads((tmp_path / "camera.json").read_text())["fx"] == CAMERA.fx_px
    assert [path.name for path in tmp_path.iterdir()] == ["camera.json"]


def test_a_camera_file_that_is_the_same_is_kept_and_another_one_is_replaced(tmp_path):
    write_camera(tmp_path, CAMERA, 10)
    before = (tmp_path / "camera.json").stat()
    write_camera(tmp_path, CAMERA, 10)
    assert (tmp_path / "camera.json").stat().st_ino == before.st_ino
    write_camera(tmp_path, CAMERA, 30)
    assert json.loads((tmp_path / "camera.json").read_text())["frames_per_second"] == 30


def test_a_file_that_cannot_be_written_leaves_nothing_behind(tmp_path):
    (tmp_path / "camera.json").mkdir()
    with pytest.raises(OSError, match="camera"):
        write_camera(tmp_path, CAMERA, 10)
    assert [path.name for path in tmp_path.iterdir()] == ["camera.json"]


def fake_blender(monkeypatch, images):
    """Blender whose rooms and videos give as many images as `images` says by their name."""

    def render(kind, options):
        names = [f"s0{kind}{i:05d}" for i in range(options.start, options.start + options.rooms)]
        folder = RoomsFolder(options.out, 0.0)

        def render_one(name):
            if count := images.get(name, 2):
                write_room(folder, name, count)
            return count

        return render_missing(names, folder, render_one)

    class Options(SimpleNamespace):
        def of_kinds(self, names):
            return self

        of_view_kinds = of_kinds

    modules = {
        "generator": SimpleNamespace(Options=Options, render_rooms=partial(render, "r")),
        "videos": SimpleNamespace(VideoOptions=Options, render_videos=partial(render, "v")),
    }
    monkeypatch.setattr(command, "_blender_module", modules.get)


@pytest.mark.parametrize(
    ("option", "kind", "lacks"), [("rooms", "r", "view"), ("videos", "v", "path")]
)
def test_rooms_without_a_view_or_a_path_are_counted_and_fail(
    option, kind, lacks, monkeypatch, tmp_path, capsys
):
    fake_blender(monkeypatch, {f"s0{kind}00004": 0, f"s0{kind}00006": 0})
    arguments = ["render", f"--{option}", "3", "--out", str(tmp_path)]
    for _ in range(2):  # also where all others are complete already
        assert main([*arguments, "--start", "4"]) == 1
        assert (
            f"nunet_models: 1 of 3 {option} are complete; no {lacks} was found for 2: "
            f"`s0{kind}00004`, `s0{kind}00006`; hint: `--{option} 2 --start 7` renders as many"
        ) in capsys.readouterr().err
    assert main([*arguments, "--start", "7"]) == 0


def test_nothing_rendered_at_all_fails_and_names_some_of_the_rooms(monkeypatch, tmp_path, capsys):
    fake_blender(monkeypatch, {f"s0r{number:05d}": 0 for number in range(9)})
    assert main(["render", "--rooms", "9", "--out", str(tmp_path)]) == 1
    stderr = capsys.readouterr().err
    assert "0 of 9 rooms are complete; no view was found for 9: `s0r00000`, " in stderr
    assert "`s0r00004` ...; hint: " in stderr and "`s0r00005`" not in stderr


def test_rooms_are_split_by_name_and_no_room_is_in_both_lists(tmp_path):
    folder = RoomsFolder(tmp_path, 0.3)
    names = [f"s7r{number:05d}" for number in range(40)]
    for name in names:
        folder.finish_room(name, {f"{name}v00": VIEW, f"{name}v01": VIEW}, "rendered")
    lists = [(tmp_path / f"{split}.txt").read_text().split() for split in ("train", "test")]
    train, test = ({identity[:8] for identity in ids} for ids in lists)
    assert not train & test
    assert test == {name for name in names if is_test_room(name, 0.3)}
    assert 4 <= len(test) <= 20


def test_a_damaged_table_is_reported_with_file_and_line(tmp_path):
    table = tmp_path / "intrinsics.csv"
    table.write_text("id,fx\n")
    with pytest.raises(
        DataError, match=r"intrinsics\.csv:1: columns are `id,fx`, expected `id,fx,"
    ):
        RoomsFolder(tmp_path, 0.1)
    table.write_text("id,fx,fy,cx,cy,width,height,sensor,scene\na,1,2,3,4,5,6,rendered,r\nb,1\n")
    with pytest.raises(DataError, match=r"intrinsics\.csv:3: 2 values, expected 9"):
        RoomsFolder(tmp_path, 0.1)


def test_random_cameras_keep_to_their_ranges_and_repeat_with_their_seed():
    cameras = [random_intrinsics(Random(seed)) for seed in range(300)]
    assert cameras == [random_intrinsics(Random(seed)) for seed in range(300)]
    fields = np.array([camera.hfov_deg for camera in cameras])
    assert HFOV_DEG[0] - 0.5 < fields.min() < 52
    assert 100 < fields.max() < HFOV_DEG[1] + 0.5
    assert {(camera.width, camera.height) for camera in cameras} == set(IMAGE_SIZES)
    for camera in cameras:
        assert abs(camera.cx_px - (camera.width - 1) / 2) <= 0.011 * camera.width
        assert abs(camera.fx_px / camera.fy_px - 1) < 0.006


def test_scaled_intrinsics_see_the_same_points():
    small, point = CAMERA.scaled(0.5), np.array([0.3, -0.2, 2.0])
    u, v = CAMERA.project(point)
    assert small.project(point) == pytest.approx(((u + 0.5) / 2 - 0.5, (v + 0.5) / 2 - 0.5))


@pytest.mark.parametrize("turn_deg", [0, 30, 90, 137])
def test_rectangles_overlap_as_their_corners_say(turn_deg):
    base = Rectangle(0, 0, 2, 1, turn_deg)
    along, across = base.axes()
    for distance, overlaps in ((0.99, True), (1.01, False)):
        beside = Rectangle(*(across * distance), 2, 1, turn_deg)
        assert base.overlaps(beside) is overlaps
        behind = Rectangle(*(along * 2 * distance), 2, 1, turn_deg)
        assert base.overlaps(behind) is overlaps


def test_furniture_stays_in_the_room_and_apart():
    plan = FloorPlan(4.0, 3.0, Random(5))
    for _ in range(30):
        plan.against_wall(0.6, 0.5)
        plan.free_place(0.5, 0.4)
    assert len(plan.taken) > 12
    for index, place in enumerate(plan.taken):
        assert (place.corners() > -1e-6).all()
        assert (place.corners() < (4 + 1e-6, 3 + 1e-6)).all()
        assert not any(place.overlaps(other) for other in plan.taken[:index])


def test_a_full_room_takes_nothing_more():
    plan = FloorPlan(1.0, 1.0, Random(0))
    plan.reserve(Rectangle(0.5, 0.5, 0.9, 0.9))
    assert plan.free_place(0.3, 0.3) is None
    assert plan.against_wall(1.2, 0.3) is None


def test_the_robot_passes_its_waypoints_at_constant_speed():
    waypoints = np.array([(0, 0), (1, 0.5), (1.5, 2), (1.4, 3)])
    path = RobotPath(waypoints)
    points = path.samples(0.05)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert steps == pytest.approx(0.05, abs=2e-3)
    for waypoint in waypoints:
        assert np.linalg.norm(path.samples(0.01) - waypoint, axis=1).min() < 0.02
    assert path.heading_deg(path.length_m) == pytest.approx(5.7, abs=5)


@pytest.mark.parametrize("scale", [0.001, 1.0, 300.0])
def test_automatic_exposure_brings_any_light_into_range(scale):
    random = np.random.default_rng(3)
    light = random.uniform(0.05, 1.0, (60, 80, 3)) * scale
    image = np.array(Sensor(0, 0.5, 0.5, 1.0, 1.0, 0.2, 0.0, 0.0, 90).develop(light, random))
    assert 60 < image.mean() < 190
    assert image.std() > 10


def test_the_same_seed_develops_the_same_image_and_noise_follows_its_factor():
    light = np.full((60, 80, 3), 0.4)

    def develop(noise, seed):
        sensor = Sensor(0, 0, 0, 1.0, 1.0, noise, 0.0, 0.0, 90)
        return np.array(sensor.develop(light, np.random.default_rng(seed)), float)

    assert (develop(1.0, 4) == develop(1.0, 4)).all()
    assert develop(2.0, 4).std() > 1.5 * develop(0.7, 4).std()


def test_exposure_that_adapts_slowly_is_between_its_images():
    dark, bright = Metered.of(np.full((4, 4, 3), 0.1)), Metered.of(np.full((4, 4, 3), 0.9))
    assert dark.brightness < Metered.mean([dark, bright]).brightness < bright.brightness


@NEEDS_BLENDER
def test_a_monitor_has_a_screen_of_the_size_and_height_that_are_asked_for():
    # Needs Blender as soon as they are imported.
    from nunet_models.rendering import clutter, scene, shapes  # noqa: PLC0415

    scene.clear()
    clutter.monitor(shapes.Maker(Random(1)), 0.62, 0.4, lift=0.15)
    *_, screen = shapes.bpy.data.objects
    corners = np.array([screen.matrix_world @ vertex.co for vertex in screen.data.vertices])
    assert np.ptp(corners, axis=0) == pytest.approx([0.6, 0.003, 0.4], abs=1e-4)
    assert corners[:, 2].min() == pytest.approx(0.172, abs=1e-4)


@NEEDS_BLENDER
def test_an_unknown_kind_of_room_is_a_bad_argument(tmp_path, capsys):
    arguments = ["--rooms", "1", "--out", str(tmp_path / "out"), "--kinds", "office,castle"]
    assert main(["render", *arguments]) == 2
    assert "`--kinds` has `castle`, expected some of: living, " in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@NEEDS_BLENDER
def test_an_unknown_kind_of_view_is_a_bad_argument(tmp_path, capsys):
    arguments = ["--rooms", "1", "--out", str(tmp_path / "out"), "--view-kinds", "low,high"]
    assert main(["render", *arguments]) == 2
    expected = "`--view-kinds` has `high`, expected some of: low, driving, near, seated, standing"
    assert expected in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@NEEDS_BLENDER
def test_views_of_one_kind_alone_can_be_drawn(tmp_path):
    arguments = ["--rooms", "1", "--views", "6", "--samples", "1", "--view-kinds", "low,driving"]
    assert main(["render", "--out", str(tmp_path), *arguments]) == 0
    with (tmp_path / "views.csv").open() as table:
        views = list(csv.DictReader(table))
    assert {view["kind"] for view in views} == {"low", "driving"}
    assert all(0.1 <= float(view["height_m"]) <= 0.4 for view in views)


@NEEDS_BLENDER
def test_a_workplace_has_views_of_things_on_desks(tmp_path):
    arguments = ["--rooms", "2", "--views", "3", "--samples", "1", "--test-share", "0"]
    assert main(["render", "--out", str(tmp_path), "--kinds", "workplace", *arguments]) == 0
    with (tmp_path / "views.csv").open() as table:
        kinds = [row["kind"] for row in csv.DictReader(table)]
    assert len(kinds) == 6
    assert kinds.count("seated") >= 2
    for path in (tmp_path / "depth").iterdir():
        assert 0.25 < np.median(np.array(Image.open(path))) / 1000 < 6


@NEEDS_BLENDER
def test_depth_and_pixels_of_the_clip_s_and_of_random_cameras_are_right():
    done = subprocess.run(
        [sys.executable, "-m", "nunet_models.rendering", "--check"],
        capture_output=True,
        text=True,
        check=False,
        timeout=600,
    )
    assert done.returncode == 0, done.stdout
