"""Arrays of a frame: read-only views of shared memory that are safe to keep."""

import json
import pathlib

import numpy as np
import nunet_py as nunet
import pytest
from streaming import (
    TIMEOUT,
    address,
    attached,
    daemon,
    inodes,
    mapping,
    memory_bytes,
    start_python,
    unique_name,
)
from support import hint_of

CLIENTS = pathlib.Path(__file__).parents[1]


def image(value, shape=(48, 64, 3)):
    return np.full(shape, value, np.uint8)


def test_a_view_is_the_daemons_own_memory(nunetd):
    name = unique_name()
    attach = {"topics": ["depth", "cloud"], "timeout": TIMEOUT}
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
        view = frames.next().image
        assert view.max() == value  # read every page
        return view

    with attached(encoding="mono8") as pair:
        hop(*pair, 1)  # allocate what is allocated once
    with attached(size=(2048, 2048), encoding="mono8", readers=1) as (publisher, frames):
        before = memory_bytes("RssAnon")
        held = hop(publisher, frames, 1)
        assert memory_bytes("RssAnon") - before < held.nbytes / 4
        for value in range(2, 20):
            held = hop(publisher, frames, value)
            assert memory_bytes("RssAnon") - before < held.nbytes / 4
        # Not even temporarily: all chunks were touched before, so no new page is mapped.
        with publisher.loan() as array:
            array[:] = 20
        pathlib.Path("/proc/self/clear_refs").write_text("5")  # reset the peak to the current memory
        before = memory_bytes("VmRSS")
        held = frames.next().image
        assert held.max() == 20
        assert memory_bytes("VmHWM") - before < held.nbytes / 4


def test_views_are_read_only_and_stay_so(camera):
    with nunet.subscribe(camera, topics=["depth", "labels", "cloud"], timeout=TIMEOUT) as frames:
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
        frames = nunet.subscribe(name, topics=["depth", "cloud"], timeout=TIMEOUT)
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
    # Another subscriber cleans up after the dead daemon.
    with pytest.raises(TimeoutError):
        nunet.subscribe(name, timeout=0.2)
    assert np.array_equal(depth, expected, equal_nan=True)
    assert colors.max() > 0


def test_a_loop_that_keeps_one_frame_and_its_arrays_stays_within_the_limit(still):
    with nunet.subscribe(still.camera, topics=["rgb"], timeout=TIMEOUT) as frames:
        previous = None
        for value in range(20):
            still.publish(image(value))
            frame = frames.next()
            rgb = frame.rgb
            assert previous is None or (rgb - previous == 1).all()
            previous = rgb


def test_a_subscriber_that_holds_too_many_frames_gets_an_error_and_affects_no_other(still):
    attach = {"topics": ["rgb"], "timeout": TIMEOUT}
    with nunet.subscribe(still.camera, **attach) as holding, nunet.subscribe(still.camera, **attach) as other:
        held = []
        for value in range(2):
            still.publish(image(value))
            held.append(holding.next().rgb)
            other.next()
        still.publish(image(2))
        with pytest.raises(nunet.NunetError, match="hold 2 messages of `rgb`") as error:
            holding.next()
        assert ".copy()" in hint_of(error)
        for value in range(3, 50):
            still.publish(image(value))
            assert other.next().rgb[0, 0, 0] == value
        assert [array[0, 0, 0] for array in held] == [0, 1]
        held.pop()
        assert holding.next().rgb[0, 0, 0] == 49, "it continues with the newest"


# A publisher of depth with an arbitrary header, in a process of its own: see above.
SENDER = """
import ctypes, json, sys, time
import iceoryx2 as iox2
from contract import block, new_node, structure
contract, name, header_says = json.loads(sys.argv[1]), sys.argv[2], json.loads(sys.argv[3])
node = new_node()
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
        ({"payload_bytes": 513}, "contradicts itself: .*513.*512"),
    ],
)
def test_a_message_that_contradicts_itself_is_an_error(contract, says, message):
    name, enums = unique_name(), contract["enums"]
    header = {
        "contract_version": 1,
        "topic": enums["topic"]["depth"],
        "encoding": enums["encoding"]["depth_f32"],
    }
    header |= {"width": 8, "height": 8, "payload_bytes": 512} | says
    sender = start_python(SENDER, json.dumps(contract), name, json.dumps(header), cwd=CLIENTS)
    try:
        with nunet.subscribe(name, timeout=TIMEOUT) as frames:
            if message is None:
                depth = frames.next().depth
                assert (depth.shape, depth.strides[0]) == ((8, 8), says.get("row_stride_bytes", 32))
            else:
                with pytest.raises(nunet.NunetError, match=message) as error:
                    _ = frames.next().depth
                hint_of(error)
    finally:
        sender.kill()
        sender.communicate(timeout=TIMEOUT)


def test_dlpack_shares_the_memory_read_only(camera):
    with nunet.subscribe(camera, timeout=TIMEOUT) as frames:
        depth = frames.next().depth
        shared = np.from_dlpack(depth)
        assert address(shared) == address(depth) and not shared.flags.writeable
        assert depth.__dlpack_device__() == (1, 0)
        expected = depth.copy()
        del depth
        frames.next()
        assert np.array_equal(shared, expected, equal_nan=True)


class OldConsumer:
    """A consumer of a DLPack version before 1.0, like JAX: it cannot learn that memory is read-only."""

    def __init__(self, source):
        self.source = source

    def __dlpack__(self, **_):
        """Asks without a version, whatever the consumer passes."""
        return self.source.__dlpack__()

    def __dlpack_device__(self):
        """Where the source is."""
        return self.source.__dlpack_device__()


def test_a_frame_exports_its_depth_to_every_dlpack_version(camera):
    with nunet.subscribe(camera, timeout=TIMEOUT) as frames:
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
