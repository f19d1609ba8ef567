"""Attached to a running daemon: frames are whole, safe to keep, and cost no copy."""

import json
import os
import pathlib
import signal
import threading
import time

import numpy as np
import nunet_py as nunet
import pytest
from streaming import (
    PATIENCE,
    address,
    attached,
    daemon,
    eventually,
    inodes,
    mapping,
    memory_bytes,
    run_python,
    start_python,
    unique_name,
)
from support import hint_of

CLIENTS = pathlib.Path(__file__).parents[1]
ALL = ["depth", "labels", "cloud", "stats"]


@pytest.fixture
def still():
    """A publisher whose pictures come when the test says so."""
    with nunet.publisher(unique_name(), size=(64, 48)) as publisher:
        yield publisher


def picture(value, shape=(48, 64, 3)):
    return np.full(shape, value, np.uint8)


def test_every_topic_of_a_frame_has_its_shape_type_and_number(camera):
    with nunet.subscribe(camera, topics=ALL, timeout=PATIENCE) as frames:
        assert frames.camera == camera and frames.topics == tuple(ALL)
        sequences = []
        for frame in frames:
            height, width = frame.depth.shape
            assert frame.depth.dtype == np.float32 and frame.labels.dtype == np.uint8
            assert frame.labels.shape == (height, width)
            assert frame.cloud.points.shape == (height, width, 3) and frame.cloud.points.dtype == np.float32
            assert frame.cloud.labels.shape == (height, width) and frame.cloud.colors.shape == (height, width, 3)
            assert len({header.sequence for header in frame.headers.values()}) == 1
            assert np.isnan(frame.depth).sum() == frame.header.invalid_pixels
            stats = frame.stats
            assert stats.captured == stats.published + stats.superseded + stats.failed + stats.in_flight
            sequences.append(frame.sequence)
            if len(sequences) == 5:
                break
        assert sequences == sorted(set(sequences)) and frames.connected


def test_the_cloud_agrees_with_depth_labels_and_its_own_bytes(camera):
    with nunet.subscribe(camera, topics=["cloud", "depth", "labels"], timeout=PATIENCE) as frames:
        frame = frames.next()
        cloud = frame.cloud
        assert np.array_equal(cloud.points[..., 2], frame.depth, equal_nan=True)
        assert np.array_equal(cloud.labels, frame.labels)
        assert cloud.colors.max() > 0
        valid = cloud.valid()
        assert valid.dtype == np.float32 and valid.shape == (np.isfinite(frame.depth).sum(), 3)
        assert np.isfinite(valid).all()


def test_the_header_has_every_field_of_the_contract_and_words_for_numbers(camera, contract):
    with nunet.subscribe(camera, timeout=PATIENCE) as frames:
        header = frames.next().header
        names = [field["name"] for field in contract["header"]["fields"] if field["name"] != "reserved"]
        assert list(header.as_dict()) == names
        assert (header.topic, header.encoding, header.units) == ("depth", "depth_f32", "metre")
        assert header.scale_source in contract["enums"]["scale_source"]
        assert header.quality in contract["enums"]["quality"]
        assert len(header.model_hash) == 64 and len(header.stage_micros) == header.stage_count > 0
        assert len(header.distortion) == 14
        assert f"sequence={header.sequence}" in repr(header)


def test_age_counts_from_the_capture_and_grows(camera):
    with nunet.subscribe(camera, timeout=PATIENCE) as frames:
        frame = frames.next()
        first = frame.age
        assert first > 0
        assert first < (time.monotonic_ns() - frame.header.capture_nanos) / 1e9
        assert frame.age > first


def test_stats_alone_can_be_followed(camera):
    with nunet.subscribe(camera, topics="stats", timeout=PATIENCE) as frames:
        first, second = frames.next().stats, frames.next().stats
        assert second.captured >= first.captured > 0
        assert first.model_name == "tiny_wnet_c.onnx" and first.provider
        assert set(first.total_ms) == {"p50", "p90", "p99", "max", "mean"}
        assert all(set(times) == set(first.total_ms) for times in first.stages_ms.values())


def test_a_view_is_the_daemons_own_memory(nunetd):
    name = unique_name()
    attach = {"topics": ["depth", "cloud"], "timeout": PATIENCE}
    with daemon(nunetd, name, "--rate", "30") as process, nunet.subscribe(name, **attach) as frames:
        frame = frames.next()
        for array in (frame.depth, frame.cloud.points, frame.cloud.colors):
            path, inode, _ = mapping(address(array))
            assert path.startswith("/dev/shm/") and inode in inodes(process.pid)
        assert address(frame.depth) == address(frame.depth), "one memory, however often it is asked for"
        assert address(frame.depth) % 64 == 0


def test_no_copy_appears_in_the_memory_of_this_process():
    def hop(publisher, frames, value):
        with publisher.loan() as array:
            array[:] = value
        view = frames.next().picture
        assert view.max() == value  # every page of it was looked at
        return view

    with attached(encoding="mono8") as pair:
        hop(*pair, 1)  # what is made once, is made
    with attached(size=(2048, 2048), encoding="mono8", readers=1) as (publisher, frames):
        before = memory_bytes("RssAnon")
        held = hop(publisher, frames, 1)
        assert memory_bytes("RssAnon") - before < held.nbytes / 4
        for value in range(2, 20):
            held = hop(publisher, frames, value)
            assert memory_bytes("RssAnon") - before < held.nbytes / 4
        # Nor for a moment: all chunks were touched, so nothing new is mapped any more.
        with publisher.loan() as array:
            array[:] = 20
        pathlib.Path("/proc/self/clear_refs").write_text("5")  # the highest memory so far is that of now
        before = memory_bytes("VmRSS")
        held = frames.next().picture
        assert held.max() == 20
        assert memory_bytes("VmHWM") - before < held.nbytes / 4


def test_views_are_read_only_and_stay_so(camera):
    with nunet.subscribe(camera, topics=["depth", "labels", "cloud"], timeout=PATIENCE) as frames:
        frame = frames.next()
        for array in (frame.depth, frame.labels, frame.cloud.points, frame.cloud.colors, frame.depth[::2].T):
            assert not array.flags.writeable and not array.flags.owndata
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 0
            with pytest.raises(ValueError, match="WRITEABLE"):
                array.flags.writeable = True


def test_views_outlive_the_loop_the_subscriber_and_the_daemon(nunetd):
    name = unique_name()
    with daemon(nunetd, name, "--rate", "30") as process:
        frames = nunet.subscribe(name, topics=["depth", "cloud"], timeout=PATIENCE)
        frame = frames.next()
        depth, colors, expected = frame.depth, frame.cloud.colors, frame.depth.copy()
        del frame
        for _ in range(5):
            frames.next()
        assert np.array_equal(depth, expected, equal_nan=True)
        frames.close()
        del frames
        assert np.array_equal(depth, expected, equal_nan=True)
        process.kill()
        process.wait(timeout=30)
    # Another reader cleans up after the dead daemon.
    with pytest.raises(TimeoutError):
        nunet.subscribe(name, timeout=0.2)
    assert np.array_equal(depth, expected, equal_nan=True)
    assert colors.max() > 0


def test_a_loop_that_keeps_its_frame_and_its_arrays_never_meets_the_limit(still):
    with nunet.subscribe(still.camera, topics=["rgb"], timeout=PATIENCE) as frames:
        previous = None
        for value in range(20):
            still.publish(picture(value))
            frame = frames.next()
            rgb = frame.rgb
            assert previous is None or (rgb - previous == 1).all()
            previous = rgb


def test_a_reader_that_hoards_is_told_so_and_disturbs_nobody(still):
    attach = {"topics": ["rgb"], "timeout": PATIENCE}
    with nunet.subscribe(still.camera, **attach) as hoarder, nunet.subscribe(still.camera, **attach) as other:
        hoard = []
        for value in range(2):
            still.publish(picture(value))
            hoard.append(hoarder.next().rgb)
            other.next()
        still.publish(picture(2))
        with pytest.raises(nunet.NunetError, match="hold 2 messages of `rgb`") as error:
            hoarder.next()
        assert ".copy()" in hint_of(error)
        for value in range(3, 50):
            still.publish(picture(value))
            assert other.next().rgb[0, 0, 0] == value
        assert [array[0, 0, 0] for array in hoard] == [0, 1]
        hoard.pop()
        assert hoarder.next().rgb[0, 0, 0] == 49, "it goes on with the newest"


def test_the_newest_frame_wins(still):
    with nunet.subscribe(still.camera, topics=["rgb"], timeout=PATIENCE) as frames:
        for value in range(10):
            still.publish(picture(value))
        assert frames.next().rgb[0, 0, 0] == 9
        assert frames.latest() is None
        still.publish(picture(10))
        assert frames.latest().sequence == 10


def test_depth_comes_with_the_picture_that_it_was_made_of(nunetd):
    name = unique_name()
    stop = threading.Event()

    def drive(publisher):
        value = 0
        while not stop.is_set():
            publisher.publish(picture(value % 256))
            value += 1
            time.sleep(0.01)

    with nunet.publisher(name, size=(64, 48)) as publisher, daemon(nunetd, name, source=f"shm:{name}"):
        driver = threading.Thread(target=drive, args=(publisher,))
        driver.start()
        try:
            with nunet.subscribe(name, topics=["rgb", "depth"], timeout=PATIENCE) as frames:
                for _ in range(20):
                    frame = frames.next()
                    assert frame.headers["rgb"].sequence == frame.headers["depth"].sequence == frame.sequence
                    assert frame.rgb[0, 0, 0] == frame.sequence % 256
        finally:
            stop.set()
            driver.join()


def test_a_reader_for_whom_there_is_no_room_is_told_how_many_may_read():
    with nunet.publisher(unique_name(), size=(64, 48), readers=1) as publisher:
        attach = {"topics": ["rgb"], "timeout": PATIENCE}
        with nunet.subscribe(publisher.camera, **attach):
            with pytest.raises(nunet.NunetError, match="all 1 places are taken") as error:
                nunet.subscribe(publisher.camera, **attach)
            hint_of(error)
        nunet.subscribe(publisher.camera, **attach).close()


def test_a_camera_that_does_not_exist_is_a_timeout_that_names_it():
    name = unique_name()
    with pytest.raises(TimeoutError, match=f"no `nunet/{name}/depth` after 0.1 s") as error:
        nunet.subscribe(name, timeout=0.1)
    hint_of(error)


def test_waiting_for_a_daemon_does_not_spin():
    busy, waited = time.process_time(), time.monotonic()
    with pytest.raises(TimeoutError):
        nunet.subscribe(unique_name(), timeout=2.0)
    busy, waited = time.process_time() - busy, time.monotonic() - waited
    # Nothing of a machine's speed: a loop without a sleep takes all of the time.
    assert busy < waited / 2


def test_a_topic_that_nobody_publishes_is_told_apart_from_a_missing_camera(still):
    with pytest.raises(TimeoutError, match="is there, but nobody published its `cloud`") as error:
        nunet.subscribe(still.camera, topics=["rgb", "cloud"], timeout=0.1)
    assert "--publish" in hint_of(error)


def test_a_subscriber_waits_for_a_daemon_that_comes_later(nunetd):
    name = unique_name()
    found = []
    waiting = threading.Thread(target=lambda: found.append(nunet.subscribe(name, timeout=PATIENCE).next().sequence))
    waiting.start()
    with daemon(nunetd, name, "--rate", "30"):
        waiting.join(timeout=2 * PATIENCE)
    assert len(found) == 1


@pytest.mark.parametrize(
    ("arguments", "exception", "message"),
    [
        ({"camera": "left/arm"}, ValueError, "has '/' at character 5"),
        ({"camera": ""}, ValueError, "is empty"),
        ({"camera": None}, TypeError, "`camera` is `None`; expected a camera's name"),
        ({"topics": ["depht"]}, ValueError, "`depht` is no topic"),
        ({"topics": ["scan"]}, ValueError, "`scan` is no topic"),
        ({"topics": []}, ValueError, "topics is empty"),
        ({"topics": ["depth", "depth"]}, ValueError, "asked for twice"),
        ({"topics": 3}, TypeError, "topics is a `int`"),
        ({"topics": [3]}, TypeError, "expected names"),
        ({"timeout": -1}, ValueError, "timeout is `-1`"),
        ({"timeout": float("nan")}, ValueError, "timeout is `NaN`"),
        ({"timeout": "soon"}, TypeError, "`timeout` is `'soon'`; expected seconds"),
    ],
)
def test_wrong_arguments_are_refused_with_a_way_out(arguments, exception, message):
    with pytest.raises(exception, match=message) as error:
        nunet.subscribe(**{"camera": unique_name(), "timeout": 0.0} | arguments)
    hint_of(error)


def test_a_topic_that_was_not_asked_for_is_an_error(still):
    with nunet.subscribe(still.camera, topics=["rgb"], timeout=PATIENCE) as frames:
        still.publish(picture(1))
        frame = frames.next()
        for name in ("depth", "labels", "cloud", "stats"):
            with pytest.raises(nunet.NunetError, match=f"this frame has no `{name}`, only `rgb`") as error:
                getattr(frame, name)
            hint_of(error)


def test_a_source_that_stands_still_is_a_timeout_that_says_who_is_silent(still):
    with nunet.subscribe(still.camera, topics=["rgb"], timeout=0.1) as frames:
        with pytest.raises(TimeoutError, match=f"in 0.1 s: process {os.getpid()} publishes it") as error:
            next(frames)
        hint_of(error)
        with pytest.raises(TimeoutError, match=r"in 0\.02 s"):
            frames.next(timeout=0.02)
        with pytest.raises(TimeoutError, match="in 0 s"):
            frames.next(timeout=0)
        still.publish(picture(1))
        assert frames.next().sequence == 0, "a timeout ends nothing"


def test_a_killed_daemon_is_named_and_its_successor_is_read_by_the_same_subscriber(nunetd):
    name = unique_name()
    with daemon(nunetd, name, "--rate", "30") as process:
        frames = nunet.subscribe(name, topics=["depth", "labels"], timeout=PATIENCE)
        held = frames.next().depth
        expected = held.copy()
        process.kill()
        process.wait(timeout=30)
    with pytest.raises(TimeoutError, match=f"process {process.pid}, which published `depth`, is dead") as error:
        for _ in range(1000):
            frames.next(timeout=0.3)
    assert "start it again" in hint_of(error)
    assert not frames.connected
    with daemon(nunetd, name, "--rate", "30"):
        assert frames.next().depth.shape == expected.shape
        assert frames.connected
    assert np.array_equal(held, expected, equal_nan=True)
    frames.close()


def test_a_daemon_that_ends_in_good_order_is_a_timeout_too(nunetd):
    name = unique_name()
    with daemon(nunetd, name, "--rate", "30") as process, nunet.subscribe(name, timeout=PATIENCE) as frames:
        frames.next()
        process.terminate()
        process.wait(timeout=30)
        with pytest.raises(TimeoutError, match="nobody publishes `depth` any more"):
            for _ in range(1000):
                frames.next(timeout=0.2)


def test_another_version_of_the_contract_is_refused_by_name():
    # In a process of its own: two copies of iceoryx2 in one process take each other for dead.
    code = """
import ctypes, sys
import iceoryx2 as iox2
iox2.set_log_level(iox2.LogLevel.Fatal)
node = iox2.NodeBuilder.new().create(iox2.ServiceType.Ipc)
key, two = iox2.AttributeKey.new("nunet.contract"), iox2.AttributeValue.new("2")
name = iox2.ServiceName.new(f"nunet/{sys.argv[1]}/depth")
builder = node.service_builder(name).publish_subscribe(iox2.Slice[ctypes.c_uint8])
service = builder.create_with_attributes(iox2.AttributeSpecifier.new().define(key, two))
print("there", flush=True)
sys.stdin.read()
"""
    name = unique_name()
    later = start_python(code, name)
    assert later.stdout.readline() == "there\n"
    with pytest.raises(nunet.ContractVersionError, match="speaks version `2`") as error:
        nunet.subscribe(name, timeout=0.1)
    later.communicate(timeout=PATIENCE)
    assert "same version on both sides" in hint_of(error)
    assert isinstance(error.value, nunet.NunetError)


# A sender of depth that says whatever it is told to, in a process of its own: see above.
SENDER = """
import ctypes, json, sys, time
import iceoryx2 as iox2
from contract import block, structure
contract, name, header_says = json.loads(sys.argv[1]), sys.argv[2], json.loads(sys.argv[3])
iox2.set_log_level(iox2.LogLevel.Fatal)
node = iox2.NodeBuilder.new().create(iox2.ServiceType.Ipc)
key, one = iox2.AttributeKey.new("nunet.contract"), iox2.AttributeValue.new("1")
version = iox2.AttributeSpecifier.new().define(key, one)
service = lambda topic: node.service_builder(iox2.ServiceName.new(f"nunet/{name}/{topic}"))
wake = service("wake").event().create_with_attributes(version)
depth = service("depth").publish_subscribe(iox2.Slice[block(contract["block"])])
depth = depth.user_header(structure(contract["header"])).payload_alignment(iox2.Alignment.new(64))
depth = depth.create_with_attributes(version)
publisher = depth.publisher_builder().initial_max_slice_len(8).create()
for _ in range(3000):
    sample = publisher.loan_slice_uninit(8)
    for field, value in header_says.items():
        setattr(sample.user_header().contents, field, value)
    ctypes.memset(sample.payload().as_ptr(), 0, 512)
    sample.assume_init().send()
    time.sleep(0.02)
"""


@pytest.mark.parametrize(
    ("says", "message"),
    [
        ({}, None),
        ({"row_stride_bytes": 40}, None),
        ({"row_stride_bytes": 33}, "contradicts itself: 8x8 cells of 4 bytes in rows of 33 bytes"),
        ({"row_stride_bytes": 28}, "contradicts itself: 8x8 cells of 4 bytes in rows of 28 bytes"),
        ({"width": 0}, "contradicts itself: 0x8 cells"),
        ({"height": 17}, r"an array of \[17, 8\] elements does not fit into a message of 512 bytes"),
        ({"payload_bytes": 513}, "contradicts itself: its header says 513 bytes, but there are 512"),
    ],
)
def test_a_message_that_contradicts_itself_is_an_error(contract, says, message):
    name, enums = unique_name(), contract["enums"]
    header = {"contract_version": 1, "topic": enums["topic"]["depth"], "encoding": enums["encoding"]["depth_f32"]}
    header |= {"width": 8, "height": 8, "payload_bytes": 512} | says
    sender = start_python(SENDER, json.dumps(contract), name, json.dumps(header), cwd=CLIENTS)
    try:
        with nunet.subscribe(name, timeout=PATIENCE) as frames:
            if message is None:
                depth = frames.next().depth
                assert (depth.shape, depth.strides[0]) == ((8, 8), says.get("row_stride_bytes", 32))
            else:
                with pytest.raises(nunet.NunetError, match=message) as error:
                    _ = frames.next().depth
                hint_of(error)
    finally:
        sender.kill()
        sender.communicate(timeout=PATIENCE)


def test_a_closed_subscriber_says_so(still):
    frames = nunet.subscribe(still.camera, topics=["rgb"], timeout=PATIENCE)
    frames.close()
    frames.close()
    assert frames.closed
    for use in (frames.next, frames.latest, lambda: iter(frames), frames.__enter__):
        with pytest.raises(nunet.NunetError, match="is closed") as error:
            use()
        hint_of(error)


def test_closing_ends_the_loop_from_inside_and_from_another_thread(still):
    with nunet.subscribe(still.camera, topics=["rgb"], timeout=PATIENCE) as frames:
        still.publish(picture(1))
        assert [frames.close() for _ in frames] == [None]
    frames = nunet.subscribe(still.camera, topics=["rgb"], timeout=float("inf"))
    ended = []
    waiting = threading.Thread(target=lambda: ended.append(list(frames)))
    waiting.start()
    time.sleep(0.1)
    frames.close()
    waiting.join(timeout=PATIENCE)
    assert ended == [[]]


def test_whether_it_is_connected_is_told_while_another_thread_waits(still):
    with nunet.subscribe(still.camera, topics=["rgb"], timeout=float("inf")) as frames:
        waiting = threading.Thread(target=lambda: list(frames))
        waiting.start()
        try:
            for _ in range(20):
                assert frames.connected
            still.close()
            eventually("the end of the publisher", lambda: not frames.connected)
            assert waiting.is_alive()
        finally:
            frames.close()
            waiting.join(timeout=PATIENCE)
    with pytest.raises(nunet.NunetError, match="is closed") as error:
        _ = frames.connected
    hint_of(error)


def test_waiting_lets_other_threads_run_and_takes_no_processor(still):
    count, stop = 0, threading.Event()

    def work():
        nonlocal count
        while not stop.wait(0.001):
            count += 1

    worker = threading.Thread(target=work)
    with nunet.subscribe(still.camera, topics=["rgb"], timeout=1.0) as frames:
        worker.start()
        start = time.thread_time()
        with pytest.raises(TimeoutError):
            frames.next()
        spent = time.thread_time() - start
        stop.set()
        worker.join()
    assert count > 50
    assert spent < 0.25, "it spins"


def test_threads_that_share_a_subscriber_get_different_frames(still):
    seen, errors = [], []

    def read(frames):
        try:
            while not frames.closed:
                seen.append(frames.next().sequence)  # and lets go of it: what all threads hold counts together
        except Exception as error:
            errors.append(error)

    with nunet.subscribe(still.camera, topics=["rgb"], timeout=PATIENCE) as frames:
        readers = [threading.Thread(target=read, args=(frames,)) for _ in range(3)]
        for reader in readers:
            reader.start()
        for value in range(200):
            still.publish(picture(value))
            time.sleep(0.001)
        eventually("a frame", lambda: 199 in seen)
        frames.close()
        for reader in readers:
            reader.join(timeout=PATIENCE)
    assert all("is closed" in str(error) for error in errors), errors
    assert len(seen) == len(set(seen)) > 10


def test_ctrl_c_ends_the_waiting_for_a_frame_and_for_a_daemon():
    name = unique_name()
    with nunet.publisher(name, size=(64, 48)):
        for topic in ("rgb", "depth"):
            code = (
                "import sys, nunet_py\n"
                "print('ready', flush=True)\n"
                "frames = nunet_py.subscribe(sys.argv[1], topics=[sys.argv[2]], timeout=None)\n"
                "print('open', flush=True)\n"
                "frames.next()\n"
            )
            process = start_python(code, name, topic)
            assert process.stdout.readline() == "ready\n"
            if topic == "rgb":
                assert process.stdout.readline() == "open\n"
            time.sleep(0.2)
            process.send_signal(signal.SIGINT)
            _, error = process.communicate(timeout=PATIENCE)
            assert "KeyboardInterrupt" in error and process.returncode != 0


def test_a_fork_is_told_to_make_its_own_and_leaves_the_parent_alone(still):
    with nunet.subscribe(still.camera, topics=["rgb"], timeout=PATIENCE) as frames:
        still.publish(picture(7))
        frame = frames.next()
        read_end, write_end = os.pipe()
        child = os.fork()
        if child == 0:
            texts = []
            for use in (frames.next, frames.latest, frames.close, lambda: frames.closed, lambda: list(frames)):
                try:
                    use()
                    texts.append("no error")
                except nunet.NunetError as error:
                    texts.append(str(error))
            del frame, frames  # must give nothing back
            os.write(write_end, "\0".join(texts).encode())
            os._exit(0)
        os.close(write_end)
        with os.fdopen(read_end) as pipe:
            texts = pipe.read().split("\0")
        assert os.waitpid(child, 0)[1] == 0
        assert len(texts) == 5
        for text in texts:
            assert text.startswith(f"this subscriber belongs to process {os.getpid()}") and "\nhint: " in text
        for value in range(10):
            still.publish(picture(value))
            assert frames.next().rgb[0, 0, 0] == value
        assert (frame.rgb == 7).all()


FORK = """
import os, sys
import nunet_py as nunet
publisher = nunet.publisher(sys.argv[1], size=(64, 48))
frames = nunet.subscribe(sys.argv[1], topics=["rgb"], timeout=30)
with publisher.loan() as picture:
    picture[:] = 3
frame = frames.next()
view = frame.rgb
child = os.fork()
if child == 0:
    sys.exit(5)  # takes the whole interpreter down, with everything that is inherited
assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 5
for value in range(10):
    with publisher.loan() as picture:
        picture[:] = value
    assert (nunet.subscribe(sys.argv[1], topics=["rgb"], timeout=30).closed, frames.next().rgb.max()) == (False, value)
print(int(view.sum()))
"""


def test_a_fork_that_ends_takes_nothing_with_it():
    ended = run_python(FORK, unique_name(), check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, f"{48 * 64 * 3 * 3}\n", "")


EXIT = """
import sys, threading
import nunet_py as nunet
publisher = nunet.publisher(sys.argv[1], size=(64, 48))
frames = nunet.subscribe(sys.argv[1], topics=["rgb"], timeout=30)
with publisher.loan() as picture:
    picture[:] = 3
frame = frames.next()
view = frame.rgb[::2, 1:]
sys.modules["json"] = view  # what the interpreter takes down late
if sys.argv[2] == "thread":
    waiting = nunet.subscribe(sys.argv[1], topics=["rgb"], timeout=None)
    waiting.latest()
    threading.Thread(target=lambda: list(waiting), daemon=True).start()
print(int(view.sum()))
"""


@pytest.mark.parametrize("how", ["views", "thread"])
def test_an_interpreter_that_ends_with_live_views_ends_cleanly(how):
    ended = run_python(EXIT, unique_name(), how, check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, f"{24 * 63 * 3 * 3}\n", "")


def test_dlpack_shares_the_memory_read_only(camera):
    with nunet.subscribe(camera, timeout=PATIENCE) as frames:
        depth = frames.next().depth
        shared = np.from_dlpack(depth)
        assert address(shared) == address(depth) and not shared.flags.writeable
        assert depth.__dlpack_device__() == (1, 0)
        expected = depth.copy()
        del depth
        frames.next()
        assert np.array_equal(shared, expected, equal_nan=True)


class OldConsumer:
    """What asks as before DLPack 1.0, like JAX: it cannot be told that memory is read-only."""

    def __init__(self, source):
        self.source = source

    def __dlpack__(self, **_):
        """Ask without a version, whatever the consumer says."""
        return self.source.__dlpack__()

    def __dlpack_device__(self):
        """Where the source is."""
        return self.source.__dlpack_device__()


def test_a_frame_gives_its_depth_to_consumers_of_every_dlpack(camera):
    with nunet.subscribe(camera, timeout=PATIENCE) as frames:
        frame = frames.next()
        for consumer in (frame, OldConsumer(frame)):
            shared = np.from_dlpack(consumer)
            assert address(shared) == address(frame.depth)
            assert np.array_equal(shared, frame.depth, equal_nan=True)
        assert not np.from_dlpack(frame).flags.writeable
        assert address(np.asarray(frame)) == address(frame.depth)
        assert not frame.depth.flags.writeable
        expected = frame.depth.copy()
        del frame, consumer
        frames.next()
        assert np.array_equal(shared, expected, equal_nan=True), "the capsule keeps the message"


def test_a_killed_reader_leaves_the_publisher_and_the_next_reader_alone(still):
    code = (
        "import sys, nunet_py\n"
        "frames = nunet_py.subscribe(sys.argv[1], topics=['rgb'], timeout=30)\n"
        "print('open', flush=True)\n"
        "held = [frames.next(timeout=30), frames.next(timeout=30)]\n"
        "print('held', flush=True)\n"
        "sys.stdin.read()\n"
    )
    for _ in range(3):
        process = start_python(code, still.camera)
        assert process.stdout.readline() == "open\n"
        stop = threading.Event()

        def drive(stop=stop):
            while not stop.wait(0.01):
                still.publish(picture(5))

        driver = threading.Thread(target=drive)
        driver.start()
        line = process.stdout.readline()
        process.kill()
        process.communicate(timeout=PATIENCE)
        stop.set()
        driver.join()
        assert line == "held\n"
    with nunet.subscribe(still.camera, topics=["rgb"], timeout=PATIENCE) as frames:
        for value in range(20):
            still.publish(picture(value))
            assert frames.next().rgb[0, 0, 0] == value
