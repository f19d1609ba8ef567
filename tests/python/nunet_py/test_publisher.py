"""Publishers of images: what is sent, what is refused, and who receives it."""

import json
import os
import subprocess
import time

import numpy as np
import nunet_py as nunet
import pytest
from conftest import MODEL
from streaming import TIMEOUT, attached, eventually, start_python, unique_name
from support import hint_of


def write(kept):
    """Writes through what was kept, if it allows that."""
    if isinstance(kept, list):
        with pytest.raises(ValueError, match="read-only"):
            kept[0][:] = 9
    elif isinstance(kept, memoryview):
        kept[0, 0, 0] = 9
    else:
        kept[0] = 9


SIZE = (64, 48)
SHAPE = (48, 64, 3)


def noise(shape=SHAPE, seed=0):
    return np.random.default_rng(seed).integers(0, 256, shape, np.uint8)


def test_an_image_arrives_as_it_was_sent_with_a_header_that_fits(pair):
    publisher, frames = pair
    assert (publisher.size, publisher.shape, publisher.encoding) == (SIZE, SHAPE, "rgb8")
    taken = time.monotonic_ns() - 1_000_000_000
    assert publisher.publish(noise(), capture_nanos=taken) == 0
    frame = frames.next()
    assert np.array_equal(frame.rgb, noise()) and np.array_equal(frame.image, noise())
    header = frame.header
    assert (header.sequence, header.capture_nanos, header.capture_clock) == (0, taken, "monotonic")
    assert (header.width, header.height, header.row_stride_bytes) == (64, 48, 64 * 3)
    assert (header.encoding, header.units, header.frame_id) == ("rgb8", "none", "front_optical")
    assert header.model_hash is None and header.fx == 0 and frame.camera is None
    assert abs(header.capture_unix_nanos - (time.time_ns() - (time.monotonic_ns() - taken))) < 1_000_000_000
    assert frame.age > 1
    assert publisher.publish(noise()) == 1
    assert publisher.publish(noise(), sequence=77) == 77
    assert publisher.publish(noise()) == 78


def test_an_attitude_is_published_and_wrong_angles_are_refused():
    name = unique_name()
    with nunet.AttitudePublisher(name) as attitude:
        assert attitude.camera == name and name in repr(attitude)
        attitude.publish(0.02, -0.1)
        attitude.publish(roll=0.0, pitch=0.1, capture_nanos=time.monotonic_ns())
        for wrong in (90.0, float("nan")):
            with pytest.raises(ValueError, match="attitude: pitch is"):
                attitude.publish(0.0, wrong)
        with pytest.raises(TypeError, match=r"`roll` is `'0.1'`; expected a number of radians"):
            attitude.publish("0.1", 0.0)
        with pytest.raises(nunet.NunetError, match="already published"):
            nunet.AttitudePublisher(name)
    attitude.close()
    for use in (lambda: attitude.publish(0.0, 0.0), attitude.__enter__):
        with pytest.raises(nunet.NunetError, match="is closed") as error:
            use()
        hint_of(error)
    with pytest.raises(ValueError, match="no position in a recording"):
        nunet.AttitudePublisher(name, clock="media")


@pytest.mark.parametrize(
    ("arguments", "exception", "message"),
    [
        ({"capture_nanos": -1}, ValueError, "`capture_nanos` is `-1`, expected 0 or more"),
        ({"capture_nanos": 1.5}, TypeError, "`capture_nanos` is `1.5`"),
        ({"capture_nanos": 1 << 63}, TypeError, f"`capture_nanos` is `{1 << 63}`"),
        ({"sequence": -1}, TypeError, "`sequence` is `-1`; expected a whole number, 0 or more"),
        ({"sequence": 1 << 64}, TypeError, f"`sequence` is `{1 << 64}`"),
    ],
)
def test_wrong_times_and_numbers_are_refused(pair, arguments, exception, message):
    publisher, frames = pair
    for use in (lambda: publisher.publish(noise(), **arguments), lambda: publisher.loan(**arguments)):
        with pytest.raises(exception, match=message) as error:
            use()
        hint_of(error)
    if "capture_nanos" in arguments:
        with publisher.loan() as image:
            image[:] = 1
            loan = publisher.loan()
            with pytest.raises(exception, match=message):
                loan.capture_nanos = arguments["capture_nanos"]
        assert frames.next().header.capture_nanos > 0
    with (
        nunet.AttitudePublisher(unique_name()) as attitude,
        pytest.raises(ValueError, match="`capture_nanos` is `-1`"),
    ):
        attitude.publish(0.0, 0.0, capture_nanos=-1)
    assert frames.latest() is None


@pytest.mark.parametrize("clock", ["unix", "media"])
def test_capture_times_use_the_chosen_clock(clock):
    with attached(clock=clock) as (publisher, frames):
        publisher.publish(noise(), capture_nanos=1_500_000_000)
        header = frames.next().header
        assert (header.capture_clock, header.capture_nanos) == (clock, 1_500_000_000)


@pytest.mark.parametrize(
    ("encoding", "size", "shape"),
    [
        ("bgr8", SIZE, (48, 64, 3)),
        ("mono8", SIZE, (48, 64)),
        ("yuyv", SIZE, (48, 64, 2)),
        ("nv12", SIZE, (72, 64)),
        ("bgr8", (33, 25), (25, 33, 3)),
        ("mono8", (33, 25), (25, 33)),
        ("yuyv", (33, 25), (25, 34, 2)),
        ("nv12", (33, 25), (38, 34)),
        ("nv12", (32, 25), (38, 32)),
        ("nv12", (33, 24), (36, 34)),
    ],
)
def test_every_encoding_is_read_back_as_it_was_sent(encoding, size, shape):
    with nunet.publisher(unique_name(), size=size, encoding=encoding) as publisher:
        assert publisher.shape == shape
        with nunet.subscribe(publisher.camera, topics=["rgb"], timeout=TIMEOUT) as frames:
            sent = noise(shape)
            publisher.publish(sent)
            frame = frames.next()
            assert np.array_equal(frame.image, sent)
            assert (frame.header.width, frame.header.height) == size
            assert frame.header.payload_bytes == sent.size
            if encoding == "bgr8":
                assert np.array_equal(frame.rgb, sent[..., ::-1])
            elif encoding == "mono8":
                assert np.array_equal(frame.rgb, np.repeat(sent[..., None], 3, axis=2))
            else:
                with pytest.raises(nunet.NunetError, match="must be converted") as error:
                    _ = frame.rgb
                assert "frame.image" in hint_of(error)


@pytest.mark.parametrize(
    ("image", "exception", "message", "hint"),
    [
        (None, TypeError, "`NoneType`", "asarray"),
        ([[1, 2], [3, 4]], TypeError, "`list`", "asarray"),
        (np.zeros(SHAPE, np.float32), TypeError, "float32", "astype"),
        (np.zeros(SHAPE, np.int8), TypeError, "int8", "astype"),
        (np.zeros((48, 64), np.uint8), ValueError, r"\(48, 64\)", "resize"),
        (np.zeros((0, 64, 3), np.uint8), ValueError, r"\(0, 64, 3\)", "resize"),
        (np.zeros((480, 640, 3), np.uint8), ValueError, r"\(480, 640, 3\)", "resize"),
        (np.zeros((48, 64, 4), np.uint8), ValueError, r"\(48, 64, 4\)", "resize"),
        (np.zeros(SHAPE, np.uint8)[:, ::-1], ValueError, "contiguous", "ascontiguousarray"),
        (np.zeros((48, 64, 4), np.uint8)[..., :3], ValueError, "contiguous", "ascontiguousarray"),
        (np.asfortranarray(np.zeros(SHAPE, np.uint8)), ValueError, "contiguous", "ascontiguousarray"),
    ],
)
def test_an_image_that_does_not_fit_is_refused_with_a_fix(pair, image, exception, message, hint):
    publisher, frames = pair
    with pytest.raises(exception, match=message) as error:
        publisher.publish(image)
    assert hint in hint_of(error)
    assert frames.latest() is None


@pytest.mark.parametrize(
    ("arguments", "exception", "message"),
    [
        ({"camera": "left/arm"}, ValueError, "/"),
        ({"camera": 5}, TypeError, "`camera` is `5`; expected the name of a camera"),
        ({"size": (0, 48)}, ValueError, "`size` is `0x48`"),
        ({"size": (64, 100_000)}, ValueError, "`size` is `64x100000`"),
        ({"size": (64, 32_769)}, ValueError, "`size` is `64x32769`"),
        (
            {"size": (480, 640, 3)},
            TypeError,
            r"`size` is `\(480, 640, 3\)`; expected a tuple \(width, height\)",
        ),
        ({"size": (64.0, 48)}, TypeError, "whole pixels"),
        ({"size": 64}, TypeError, "`size` is `64`"),
        ({"intrinsics": (1, 1, 0, 0)}, TypeError, "`intrinsics` is .* expected a Camera"),
        ({"frame_id": None}, TypeError, "`frame_id` is `None`"),
        ({"frame_id": "ä" * 33}, ValueError, "`frame_id` has 66 bytes; expected at most 64"),
        ({"encoding": 3}, TypeError, "`encoding` is `3`"),
        ({"readers": -1}, TypeError, "`readers` is `-1`"),
        ({"encoding": "rgba8"}, ValueError, "`encoding` is `rgba8`"),
        ({"encoding": "depth_f32"}, ValueError, "`encoding` is `depth_f32`"),
        ({"clock": "wall"}, ValueError, "`wall`"),
        ({"readers": 0}, ValueError, "max_readers"),
    ],
)
def test_wrong_arguments_are_refused(arguments, exception, message):
    with pytest.raises(exception, match=message) as error:
        nunet.publisher(**{"camera": unique_name(), "size": SIZE} | arguments)
    hint_of(error)


def test_the_camera_is_sent_with_the_images_at_their_size():
    camera = nunet.Camera(
        fx=500.0, fy=501.0, cx=320.0, cy=240.0, size=(640, 480), distortion=[-0.3, 0.1, 0, 0, 0]
    )
    with attached(intrinsics=camera.at_size(320, 240)) as (publisher, frames):
        publisher.publish(noise())
        frame = frames.next()
        assert frame.camera == camera.at_size(*SIZE)
        assert frame.header.fx == 50.0 and frame.header.distortion_model == "brown_conrady"
        assert frame.header.distortion[:2] == [-0.3, 0.1]


def test_a_camera_of_another_shape_is_refused():
    with pytest.raises(nunet.CameraError) as error:
        square = nunet.Camera(fx=500.0, fy=500.0, cx=240.0, cy=240.0, size=(480, 480))
        nunet.publisher(unique_name(), size=SIZE, intrinsics=square)
    hint_of(error)


def test_a_second_publisher_of_a_camera_is_refused_and_names_the_first(pair):
    publisher, _ = pair
    with pytest.raises(nunet.NunetError, match=f"{os.getpid()}") as error:
        nunet.publisher(publisher.camera, size=SIZE)
    hint_of(error)


def test_a_closed_publisher_raises_errors_and_frees_its_name():
    name = unique_name()
    with nunet.publisher(name, size=SIZE) as publisher:
        with publisher.loan() as image:
            image[:] = 3
        late = publisher.loan()
    assert publisher.closed
    publisher.close()
    uses = (publisher.loan, publisher.refresh, publisher.__enter__, late.__enter__)
    for use in (lambda: publisher.publish(noise()), *uses):
        with pytest.raises(nunet.NunetError, match="is closed") as error:
            use()
        hint_of(error)
    # `image` still shows what was sent; it must not keep the camera.
    with nunet.publisher(name, size=SIZE) as successor:
        successor.publish(noise())
        assert (image == 3).all()


def test_a_late_subscriber_receives_the_last_image_after_a_refresh():
    with nunet.publisher(unique_name(), size=SIZE) as publisher:
        publisher.publish(noise())
        assert not publisher.has_readers
        with nunet.subscribe(publisher.camera, topics=["rgb"], timeout=TIMEOUT) as frames:
            assert publisher.has_readers
            publisher.refresh()
            assert np.array_equal(frames.next().rgb, noise())


def test_a_late_subscriber_receives_the_last_image_of_an_idle_publisher():
    name = unique_name()
    publisher = nunet.publisher(name, size=SIZE)
    publisher.publish(noise())
    for _ in range(2):
        with nunet.subscribe(name, topics=["rgb"], timeout=TIMEOUT) as frames:
            assert np.array_equal(frames.next().rgb, noise())
    # A publisher without references has released the camera.
    for _ in range(20):
        del publisher
        publisher = nunet.publisher(name, size=SIZE)
        assert publisher.publish(noise()) == 0


def test_the_daemon_reads_what_is_published(nunetd, tmp_path):
    stats = tmp_path / "stats.json"
    with nunet.publisher(unique_name(), size=(128, 96)) as publisher:
        command = [nunetd, "-q", "--model", str(MODEL), "--source", f"shm:{publisher.camera}"]
        command += ["--camera", publisher.camera, "--frames", "3", "--stats-json", str(stats)]
        process = subprocess.Popen(command, stderr=subprocess.DEVNULL)

        def sends_until_it_ends():
            with publisher.loan() as image:
                image[:] = 100
            time.sleep(0.01)
            return process.poll() is not None

        eventually("the end of the daemon", sends_until_it_ends)
        assert process.returncode == 0
    assert json.loads(stats.read_text())["bytes_copied_per_frame"] == 0


def test_a_subscriber_continues_with_the_successor_of_a_killed_publisher():
    name = unique_name()
    code = (
        "import sys, time, numpy, nunet_py\n"
        "with nunet_py.publisher(sys.argv[1], size=(64, 48)) as publisher:\n"
        "    while True:\n"
        "        publisher.publish(numpy.full((48, 64, 3), int(sys.argv[2]), numpy.uint8))\n"
        "        time.sleep(0.01)\n"
    )
    frames = None
    for value in ("1", "2", "3"):
        process = start_python(code, name, value)
        try:
            frames = frames or nunet.subscribe(name, topics=["rgb"], timeout=TIMEOUT)
            for _ in range(1000):
                if frames.next().rgb[0, 0, 0] == int(value):
                    break
            else:
                raise AssertionError("no image of this process")
        finally:
            process.kill()
            process.communicate(timeout=TIMEOUT)
        # Another process on this machine may have cleaned up after it first.
        with pytest.raises(TimeoutError, match=f"process {process.pid}, .* is dead|no longer published"):
            for _ in range(1000):
                frames.next(timeout=0.2)
    frames.close()


def test_a_fork_gets_an_error_and_does_not_affect_its_parent(pair):
    publisher, frames = pair
    loan = publisher.loan()
    image = loan.__enter__()
    image[:] = 4
    read_end, write_end = os.pipe()
    child = os.fork()
    if child == 0:
        texts = []
        uses = (publisher.close, publisher.refresh, lambda: loan.__exit__(None, None, None))
        for use in (lambda: publisher.publish(noise()), *uses):
            try:
                use()
                texts.append("no error")
            except nunet.NunetError as error:
                texts.append(str(error))
        del publisher, loan, image
        os.write(write_end, "\0".join(texts).encode())
        os._exit(0)
    os.close(write_end)
    with os.fdopen(read_end) as pipe:
        texts = pipe.read().split("\0")
    assert os.waitpid(child, 0)[1] == 0
    assert len(texts) == 4
    for text in texts:
        assert f"belongs to process {os.getpid()}" in text and "\nhint: " in text
    loan.__exit__(None, None, None)
    assert (frames.next().rgb == 4).all()
    publisher.publish(noise())
    assert np.array_equal(frames.next().rgb, noise())
