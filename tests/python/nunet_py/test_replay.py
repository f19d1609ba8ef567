"""Recordings through a model in this process."""

import hashlib
import json
import subprocess
import sys

import numpy as np
import nunet_py as nunet
import pytest
import test_recordings
from support import ON_THE_COMMAND_LINE, RECURRENT, TINY, hint_of, model
from test_recordings import FIRST_NANOS, FRAMES, PERIOD_NANOS, SIZE, K, compressed, image, make_bag
from test_scale import CALIBRATION


def hash_of(results):
    """What `nunetd replay --json` prints as the hash of depth and labels."""
    total = hashlib.sha256()
    for result in results:
        total.update(result.depth.tobytes())
        total.update(result.labels.tobytes())
    return total.hexdigest()


def replayed_by_nunetd(nunetd, path, out, file):
    command = [
        nunetd,
        "-q",
        "replay",
        str(path),
        str(out),
        "--json",
        "--model",
        str(file),
        *ON_THE_COMMAND_LINE,
    ]
    done = subprocess.run(command, check=True, capture_output=True, timeout=120)
    return json.loads(done.stdout)["depth_and_labels_sha256"]


@pytest.mark.parametrize("form", ["png", "rgb8", "bgr8"])
@pytest.mark.parametrize("file", [TINY, RECURRENT], ids=["without a memory", "with a memory"])
def test_a_recording_gives_what_nunetd_replay_gives(nunetd, tmp_path, form, file):
    bag = make_bag(tmp_path / "bag", form)
    out = tmp_path / "out.mcap"
    expected = replayed_by_nunetd(nunetd, bag, out, file)
    assert hash_of(nunet.replay(bag, model(file))) == expected
    if form == "png":  # images that came raw were recorded as JPEG
        assert hash_of(nunet.replay(out, model(file))) == expected, "our own recordings are read too"


def test_results_have_the_time_and_the_topic_of_their_images(tmp_path, tiny):
    replay = nunet.replay(make_bag(tmp_path / "bag", "png"), tiny)
    assert (replay.topic, replay.images) == ("/eye/image_raw/compressed", FRAMES)
    results = list(replay)
    assert [result.sequence for result in results] == list(range(FRAMES))
    assert [result.capture_nanos for result in results] == [
        FIRST_NANOS + i * PERIOD_NANOS for i in range(FRAMES)
    ]
    assert {(result.topic, result.frame_id) for result in results} == {(replay.topic, "eye_optical")}
    camera = results[0].camera
    assert (camera.fx, camera.size) == (pytest.approx(K[0] * 128 / 640), (128, 96))
    assert {result.scale_source for result in results} == {"focal_scaled"}
    assert list(replay) == [], "a recording that has ended stays ended"


def test_images_are_processed_on_demand(tmp_path, tiny):
    replay = nunet.replay(make_bag(tmp_path / "bag", "png"), tiny)
    first = next(replay)
    later = tiny.infer(np.zeros((96, 128, 3), np.uint8))
    second = next(iter(replay))
    assert (first.sequence, later.sequence, second.sequence) == (0, None, 1)


def test_another_image_in_between_resets_the_state(tmp_path):
    net = model(RECURRENT)
    bag = make_bag(tmp_path / "bag", "png")
    stream = [result.depth.tobytes() for result in nunet.replay(bag, net)]
    replay = nunet.replay(bag, net)
    assert next(replay).depth.tobytes() == stream[0]
    alone = net.infer(np.zeros((480, 640, 3), np.uint8))
    second = next(replay)
    assert second.depth.tobytes() != stream[1]
    assert net.infer(second.rgb, camera=second.camera).depth.tobytes() == second.depth.tobytes()
    assert alone.sequence is None


def test_the_camera_argument_overrides_that_of_the_recording(tmp_path, tiny):
    bag = make_bag(tmp_path / "bag", "png")
    camera = nunet.Camera(1050, 1052, 640, 480, (1280, 960))
    own, given = (next(nunet.replay(bag, tiny, camera=c)) for c in (None, camera))
    np.testing.assert_allclose(given.depth, own.depth * np.float32(525 / K[0]), rtol=1e-5)
    square = nunet.replay(bag, tiny, camera=nunet.Camera(100, 100, 50, 50, (100, 100)))
    with pytest.raises(nunet.CameraError, match="100x100"):
        next(square)
    assert list(square) == []


def test_a_skipped_image_is_reported_as_unreadable_only_if_it_is(tmp_path, tiny, monkeypatch):
    images = [image(0), image(1)[:, : SIZE[1]], image(2)]
    bag = make_bag(tmp_path / "bag", "png", images=images, info=False)
    camera = nunet.Camera(525, 525, 320, 240, SIZE)
    with pytest.warns(UserWarning, match="cannot process image 1 of .*480x480"):
        results = list(nunet.replay(bag, tiny, camera=camera))
    assert [result.sequence for result in results] == [0, 2]
    signature = 8  # bytes of it; the second file lacks it

    def spoiled(rgb, form):
        return compressed(rgb, form)[signature * np.array_equal(rgb, images[1]) :]

    monkeypatch.setattr(test_recordings, "compressed", spoiled)
    bag = make_bag(tmp_path / "spoiled", "png", images=images, info=False)
    with pytest.warns(UserWarning, match="cannot read image 1 of"):
        results = list(nunet.replay(bag, tiny, camera=camera))
    assert [result.sequence for result in results] == [0, 2]


def test_a_factor_of_another_model_is_ignored_with_a_warning(tmp_path):
    path = tmp_path / "front.yaml"
    path.write_text(CALIBRATION.replace("factor: 0.5", f'factor: 0.5, model_sha256: "{"0a" * 32}"'))
    camera = nunet.Camera.from_yaml(path)
    replay = nunet.replay(make_bag(tmp_path / "bag", "png"), model(), camera=camera)
    with pytest.warns(UserWarning, match="measured with another model"):
        assert next(replay).scale_source == "focal_scaled"


def test_a_damaged_recording_yields_every_complete_image_and_then_an_error(tmp_path, tiny):
    whole = make_bag(tmp_path / "bag", "rgb8").read_bytes()
    expected = [result.depth.tobytes() for result in nunet.replay(make_bag(tmp_path / "again", "rgb8"), tiny)]
    cut = tmp_path / "cut.mcap"
    counts = set()
    for share in (0.3, 0.6, 0.9):
        cut.write_bytes(whole[: int(len(whole) * share)])
        replay, got = nunet.replay(cut, tiny), []
        with pytest.raises(nunet.NunetError, match=r"cut\.mcap|cut off|damaged"):
            for result in replay:
                got.append(result.depth.tobytes())
        assert got == expected[: len(got)]
        assert list(replay) == []
        counts.add(len(got))
    assert len(counts) == 3, "what lies before the cut is given"


def test_bad_recordings_raise_the_exception_of_their_kind(tmp_path, tiny):
    text = tmp_path / "text.mcap"
    text.write_text("no recording")
    with pytest.raises(nunet.NunetError, match="MCAP"):
        nunet.replay(text, tiny)
    with pytest.raises(FileNotFoundError, match=r"missing\.mcap"):
        nunet.replay(tmp_path / "missing.mcap", tiny)
    with pytest.raises(ValueError, match=r"`/nose`.*\nhint: "):
        nunet.replay(make_bag(tmp_path / "bag", "png"), tiny, topic="/nose")
    with pytest.raises(TypeError, match=r"`model` is `'wnet_c\.onnx'`; expected a Model") as error:
        nunet.replay(text, "wnet_c.onnx")
    hint_of(error)


def test_ctrl_c_ends_a_replay(tmp_path):
    """The signal comes between two images, or while one is computed."""
    bag = make_bag(tmp_path / "bag", "png")
    code = """
import os, signal, sys, threading, nunet_py as nunet
net = nunet.Model(sys.argv[2], provider="cpu")
started = threading.Event()
def interrupt():
    started.wait()
    os.kill(os.getpid(), signal.SIGINT)
threading.Thread(target=interrupt).start()
try:
    while True:
        for result in nunet.replay(sys.argv[1], net):
            started.set()
except KeyboardInterrupt:
    print("interrupted")
"""
    command = [sys.executable, "-W", "ignore", "-c", code, str(bag), str(TINY)]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (0, "interrupted\n"), done.stderr


@pytest.mark.parametrize("degrees", [90, 180, 270])
def test_a_rotated_recording_gives_what_nunetd_replay_gives(nunetd, tmp_path, degrees):
    bag, file = make_bag(tmp_path / "bag", "png"), TINY
    command = [nunetd, "-q", "replay", str(bag), str(tmp_path / "out.mcap"), "--json", "--model", str(file)]
    command += [*ON_THE_COMMAND_LINE, "--rotate", str(degrees)]
    done = subprocess.run(command, check=True, capture_output=True, timeout=120)
    results = list(nunet.replay(bag, model(file), rotate=degrees))
    assert hash_of(results) == json.loads(done.stdout)["depth_and_labels_sha256"]
    assert hash_of(results) != hash_of(nunet.replay(bag, model(file)))
    assert all(result.frame_id is None for result in results)


@pytest.mark.parametrize("rotate", [0, 45, -90])
def test_another_angle_is_refused(tmp_path, rotate):
    bag = make_bag(tmp_path / "bag", "png")
    with pytest.raises(ValueError, match="expected 90, 180 or 270"):
        nunet.replay(bag, model(TINY), rotate=rotate)
