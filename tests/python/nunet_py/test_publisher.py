"""Pictures for a daemon: sent with one copy or none, and never changed behind a reader's back."""

import contextlib
import ctypes
import gc
import json
import os
import subprocess
import time
import types
import weakref

import numpy as np
import nunet_py as nunet
import pytest
from conftest import MODEL
from streaming import PATIENCE, address, attached, eventually, mapping, run_python, start_python, unique_name
from support import hint_of

SIZE = (64, 48)
SHAPE = (48, 64, 3)


@pytest.fixture
def pair():
    """A publisher, and a subscriber to its pictures."""
    with attached(frame_id="front_optical") as both:
        yield both


def noise(shape=SHAPE, seed=0):
    return np.random.default_rng(seed).integers(0, 256, shape, np.uint8)


def test_a_picture_arrives_as_it_was_sent_with_a_header_that_fits(pair):
    publisher, frames = pair
    assert (publisher.size, publisher.shape, publisher.encoding) == (SIZE, SHAPE, "rgb8")
    taken = time.monotonic_ns() - 1_000_000_000
    assert publisher.publish(noise(), capture_nanos=taken) == 0
    frame = frames.next()
    assert np.array_equal(frame.rgb, noise()) and np.array_equal(frame.picture, noise())
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


@pytest.mark.parametrize("clock", ["unix", "media"])
def test_capture_times_are_of_the_clock_that_was_named(clock):
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
        with nunet.subscribe(publisher.camera, topics=["rgb"], timeout=PATIENCE) as frames:
            sent = noise(shape)
            publisher.publish(sent)
            frame = frames.next()
            assert np.array_equal(frame.picture, sent)
            assert (frame.header.width, frame.header.height) == size
            assert frame.header.payload_bytes == sent.size
            if encoding == "bgr8":
                assert np.array_equal(frame.rgb, sent[..., ::-1])
            elif encoding == "mono8":
                assert np.array_equal(frame.rgb, np.repeat(sent[..., None], 3, axis=2))
            else:
                with pytest.raises(nunet.NunetError, match="must be converted") as error:
                    _ = frame.rgb
                assert "frame.picture" in hint_of(error)


def test_a_loan_is_the_memory_that_readers_see(pair):
    publisher, frames = pair
    with publisher.loan() as picture:
        assert (picture.shape, picture.dtype, picture.flags.writeable) == (SHAPE, np.uint8, True)
        picture[:] = noise()
        path, inode, offset = mapping(address(picture))
        assert path.startswith("/dev/shm/")
        assert frames.latest() is None, "nothing is sent before the end of the block"
    frame = frames.next()
    assert np.array_equal(frame.rgb, noise())
    assert mapping(address(frame.rgb))[1:] == (inode, offset), "the same bytes of the same file"
    assert publisher.copied == 0


def test_the_array_of_a_loan_cannot_write_after_it_was_sent(pair):
    publisher, frames = pair
    with publisher.loan() as picture:
        picture[:] = 1
    with pytest.raises(ValueError, match="read-only"):
        picture[0] = 2
    with pytest.raises(ValueError, match="WRITEABLE"):
        picture.flags.writeable = True
    with pytest.raises(ValueError, match="read-only"):
        picture[::2][0] = 2
    assert (frames.next().rgb == 1).all()


def interface(array):
    """A writeable array over the same memory, which numpy does not count among the array's views."""
    return np.asarray(types.SimpleNamespace(__array_interface__=array.__array_interface__, base=array))


# Each keeps something of `picture` as `kept`, and says what writes to it.
KEEPS = {
    "view": lambda picture: picture[..., 0],
    "flat view": lambda picture: picture.reshape(-1),
    "memoryview": memoryview,
    "ctypes": lambda picture: (ctypes.c_uint8 * picture.nbytes).from_buffer(picture),
    "interface": interface,
    "list": lambda picture: [picture],
}


def write(kept):
    """Writes through what was kept, as far as it lets."""
    if isinstance(kept, list):
        with pytest.raises(ValueError, match="read-only"):
            kept[0][:] = 9
    elif isinstance(kept, memoryview):
        kept[0, 0, 0] = 9
    else:
        kept[0] = 9


@pytest.mark.parametrize("name", ["kept", "deleted", "rebound"])
@pytest.mark.parametrize("keep", KEEPS.values(), ids=KEEPS)
def test_what_still_looks_at_a_loan_cannot_change_what_was_sent(pair, keep, name):
    publisher, frames = pair
    with publisher.loan() as picture:
        picture[:] = 1
        kept = keep(picture)
        if name == "deleted":
            del picture
        elif name == "rebound":
            picture = kept
    assert publisher.copied == 1
    frame = frames.next()
    write(kept)
    assert (frame.rgb == 1).all()
    del kept
    picture = None
    with publisher.loan() as picture:
        picture[:] = 2
    assert (frames.next().rgb == 2).all() and publisher.copied == 1


@pytest.mark.parametrize("keep", KEEPS.values(), ids=KEEPS)
def test_what_an_exit_stack_gave_away_cannot_change_what_was_sent(pair, keep):
    publisher, frames = pair
    with contextlib.ExitStack() as stack:
        kept = keep(stack.enter_context(publisher.loan()))
        if isinstance(kept, memoryview):
            kept[0, 0, 0] = 1
    assert publisher.copied == 1
    frame = frames.next()
    before = frame.rgb.copy()
    write(kept)
    assert np.array_equal(frame.rgb, before)


def variables_of_a_function(publisher, other):
    with publisher.loan() as left, other.loan() as right:
        left[:], right[:] = 1, 2
        same = left
    assert same is left


def variables_of_a_closure(publisher, other):
    with publisher.loan() as left, other.loan() as right:
        left[:], right[:] = 1, 2
    return lambda: (left, right)


def variables_of_a_module(publisher, other):
    code = "with publisher.loan() as left, other.loan() as right:\n    left[:], right[:] = 1, 2\n"
    exec(code, {"publisher": publisher, "other": other})


def variables_below_an_exit_stack(publisher, other):
    with contextlib.ExitStack() as stack:
        left, right = stack.enter_context(publisher.loan()), stack.enter_context(other.loan())
        left[:], right[:] = 1, 2


VARIABLES = [
    variables_of_a_function,
    variables_of_a_closure,
    variables_of_a_module,
    variables_below_an_exit_stack,
]


@pytest.mark.parametrize("use", VARIABLES, ids=lambda use: use.__name__)
def test_variables_cost_no_copy(use):
    with attached() as (publisher, frames), attached() as (other, others):
        for _ in range(5):
            use(publisher, other)
            assert (frames.next().rgb == 1).all() and (others.next().rgb == 2).all()
        assert (publisher.copied, other.copied) == (0, 0)


def test_the_end_of_a_loan_keeps_nothing_of_its_function_alive(pair):
    """Up to Python 3.12 whoever looks at a frame's variables makes a copy of them, which stays."""

    class Large:
        pass

    publisher, _ = pair
    large = Large()
    gone = weakref.ref(large)
    with publisher.loan() as picture:
        picture[:] = 1
    del large
    assert gone() is None
    copy = locals()
    assert copy["publisher"] is publisher
    with publisher.loan() as picture:
        picture[:] = 2
    assert copy["publisher"] is publisher, "what somebody else looks at stays as it is"


def test_a_loop_of_loans_copies_nothing(pair):
    publisher, frames = pair
    for value in range(50):
        with publisher.loan() as picture:
            picture[:] = value
        assert frames.next().rgb[-1, -1, -1] == value
    assert publisher.copied == 0


def test_a_block_that_fails_sends_nothing_and_gives_its_memory_back(pair):
    publisher, frames = pair
    for _ in range(20):
        with pytest.raises(ZeroDivisionError), publisher.loan() as picture:
            picture[:] = 1 // 0
    assert frames.latest() is None
    assert publisher.publish(noise()) == 0


def test_the_time_of_capture_may_be_set_inside_of_the_block(pair):
    publisher, frames = pair
    loan = publisher.loan()
    with loan:
        loan.capture_nanos = 123
    assert frames.next().header.capture_nanos == 123
    with loan, pytest.raises(nunet.NunetError, match="open already"):
        loan.__enter__()


def test_arrays_of_earlier_loans_that_hold_all_memory_are_a_clear_error(pair):
    publisher, frames = pair
    hoard = []
    with pytest.raises(nunet.NunetError, match="arrays of earlier loans still hold it") as error:
        for _ in range(20):
            with publisher.loan() as picture:
                hoard.append(picture[..., 0])
    hint_of(error)
    hoard.clear()
    del picture, error
    gc.collect()
    publisher.publish(noise())
    assert np.array_equal(frames.next().rgb, noise())


@pytest.mark.parametrize(
    ("picture", "exception", "message", "hint"),
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
def test_a_picture_that_does_not_fit_is_refused_with_what_to_call(pair, picture, exception, message, hint):
    publisher, frames = pair
    with pytest.raises(exception, match=message) as error:
        publisher.publish(picture)
    assert hint in hint_of(error)
    assert frames.latest() is None


@pytest.mark.parametrize(
    ("arguments", "exception", "message"),
    [
        ({"camera": "left/arm"}, ValueError, "'/'"),
        ({"camera": 5}, TypeError, "`camera` is `5`; expected a camera's name"),
        ({"size": (0, 48)}, ValueError, "size is `0x48`"),
        ({"size": (64, 100_000)}, ValueError, "size is `64x100000`"),
        ({"size": (64, 32_769)}, ValueError, "size is `64x32769`"),
        ({"size": (480, 640, 3)}, TypeError, r"`size` is `\(480, 640, 3\)`; expected \(width, height\)"),
        ({"size": (64.0, 48)}, TypeError, "whole pixels"),
        ({"size": 64}, TypeError, "`size` is `64`"),
        ({"intrinsics": (1, 1, 0, 0)}, TypeError, "`intrinsics` is .* expected a Camera"),
        ({"frame_id": None}, TypeError, "`frame_id` is `None`"),
        ({"encoding": 3}, TypeError, "`encoding` is `3`"),
        ({"readers": -1}, TypeError, "`readers` is `-1`"),
        ({"encoding": "rgba8"}, ValueError, "unknown pixel format `rgba8`"),
        ({"encoding": "depth_f32"}, ValueError, "unknown pixel format `depth_f32`"),
        ({"clock": "wall"}, ValueError, "unknown capture clock `wall`"),
        ({"readers": 0}, ValueError, "max_readers"),
    ],
)
def test_wrong_arguments_are_refused(arguments, exception, message):
    with pytest.raises(exception, match=message) as error:
        nunet.publisher(**{"camera": unique_name(), "size": SIZE} | arguments)
    hint_of(error)


def test_the_camera_travels_with_its_pictures_at_their_size():
    camera = nunet.Camera(fx=500.0, fy=501.0, cx=320.0, cy=240.0, size=(640, 480), distortion=[-0.3, 0.1, 0, 0, 0])
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
    with pytest.raises(nunet.NunetError, match=f"already published.*process {os.getpid()}") as error:
        nunet.publisher(publisher.camera, size=SIZE)
    assert "another camera name" in hint_of(error)


def test_a_closed_publisher_says_so_and_leaves_the_name_to_others():
    name = unique_name()
    with nunet.publisher(name, size=SIZE) as publisher:
        with publisher.loan() as picture:
            picture[:] = 3
        late = publisher.loan()
    assert publisher.closed
    publisher.close()
    uses = (publisher.loan, publisher.refresh, publisher.__enter__, late.__enter__)
    for use in (lambda: publisher.publish(noise()), *uses):
        with pytest.raises(nunet.NunetError, match="is closed") as error:
            use()
        hint_of(error)
    # `picture` still shows what was sent; it must not keep the camera.
    with nunet.publisher(name, size=SIZE) as successor:
        successor.publish(noise())
        assert (picture == 3).all()


def test_closing_inside_of_a_loan_is_an_error_at_its_end():
    publisher = nunet.publisher(unique_name(), size=SIZE)
    with pytest.raises(nunet.NunetError, match="is closed"), publisher.loan() as picture:
        publisher.close()
        picture[:] = 1
    assert (picture == 1).all()


def test_a_late_reader_gets_the_last_picture_after_a_refresh():
    with nunet.publisher(unique_name(), size=SIZE) as publisher:
        publisher.publish(noise())
        assert not publisher.has_readers
        with nunet.subscribe(publisher.camera, topics=["rgb"], timeout=PATIENCE) as frames:
            assert publisher.has_readers
            publisher.refresh()
            assert np.array_equal(frames.next().rgb, noise())


def test_a_late_reader_gets_the_last_picture_of_a_publisher_that_has_nothing_to_send():
    name = unique_name()
    publisher = nunet.publisher(name, size=SIZE)
    publisher.publish(noise())
    for _ in range(2):
        with nunet.subscribe(name, topics=["rgb"], timeout=PATIENCE) as frames:
            assert np.array_equal(frames.next().rgb, noise())
    # One that is let go of has given the camera up, whatever else runs.
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
            with publisher.loan() as picture:
                picture[:] = 100
            time.sleep(0.01)
            return process.poll() is not None

        eventually("the end of the daemon", sends_until_it_ends)
        assert process.returncode == 0
    assert json.loads(stats.read_text())["bytes_copied_per_frame"] == 0


def test_a_killed_publisher_is_followed_by_another_and_its_reader_goes_on():
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
            frames = frames or nunet.subscribe(name, topics=["rgb"], timeout=PATIENCE)
            for _ in range(1000):
                if frames.next().rgb[0, 0, 0] == int(value):
                    break
            else:
                raise AssertionError("no picture of this process")
        finally:
            process.kill()
            process.communicate(timeout=PATIENCE)
        with pytest.raises(TimeoutError, match=f"process {process.pid}, which published `rgb`, is dead"):
            for _ in range(1000):
                frames.next(timeout=0.2)
    frames.close()


def test_a_fork_is_told_to_make_its_own_and_leaves_the_parent_alone(pair):
    publisher, frames = pair
    loan = publisher.loan()
    picture = loan.__enter__()
    picture[:] = 4
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
        del publisher, loan, picture
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


def test_arrays_of_a_loan_may_be_read_after_the_publisher_is_gone():
    code = (
        "import sys, gc, nunet_py\n"
        "publisher = nunet_py.publisher(sys.argv[1], size=(64, 48))\n"
        "with publisher.loan() as picture:\n"
        "    picture[:] = 7\n"
        "with publisher.loan() as other:\n"
        "    view = other[..., 1]\n"
        "    view[:] = 8\n"
        "publisher.close()\n"
        "del publisher\n"
        "gc.collect()\n"
        "view[0] = 9\n"
        "print(int(picture.sum()), int(view[1:].sum()))\n"
    )
    ended = run_python(code, unique_name(), check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, f"{48 * 64 * 3 * 7} {47 * 64 * 8}\n", "")
