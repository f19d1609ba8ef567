"""Long runs: resident memory stays flat and no reference is left behind."""

import gc
import pathlib
import sys

import numpy as np
import nunet_py as nunet
import pytest
from streaming import PATIENCE, attached, daemon, memory_bytes, unique_name

FRAMES = 10_000
DAEMON_FRAMES = 400
# What an allocator may keep back, whatever runs. A leak of 64 bytes in each of 10,000 frames is more, and so is one of
# each topic's header (1 KB) in 400 frames of four topics.
SLACK_BYTES = 500_000


def references(sample):
    """References to what every frame is made of: an object that is left behind keeps its class, an array its type.

    Of classes and types there are numbers in every version of Python, whereas `None` lives for ever from 3.12 on.
    """
    gc.collect()
    kinds = [nunet.Frame, nunet.FrameHeader, sample, np.dtype(np.uint8), np.dtype(np.float32)]
    return [sys.getrefcount(kind) for kind in kinds], len(gc.get_objects())


def assert_same(before, after):
    """Equal but for what the interpreter does by itself."""
    (kinds, objects), (kinds_after, objects_after) = before, after
    assert all(abs(one - other) < 10 for one, other in zip(kinds, kinds_after, strict=True)), (kinds, kinds_after)
    assert abs(objects_after - objects) < 100


def run(frames, step, count):
    """`count` frames, each looked at in every way that makes an object."""
    for index in range(count):
        step(index)
        frame = frames.next()
        assert frame.rgb[0, 0, 0] == index % 256
        assert frame.header.sequence == frame.sequence
        _ = (frame.picture, frame.headers, frame.age, frame.topics, repr(frame))


@pytest.mark.parametrize("how", ["publish", "loan"])
def test_frames_leave_no_memory_and_no_references_behind(how):
    pictures = np.zeros((256, 24, 32, 3), np.uint8) + np.arange(256, dtype=np.uint8)[:, None, None, None]
    with nunet.publisher(unique_name(), size=(32, 24)) as publisher:

        def publish(index):
            publisher.publish(pictures[index % 256])

        def loan(index):
            with publisher.loan() as picture:
                picture[:] = index % 256

        step = publish if how == "publish" else loan
        with nunet.subscribe(publisher.camera, topics=["rgb"], timeout=PATIENCE) as frames:
            run(frames, step, 256)
            step(0)
            sample = type(frames.next().rgb.base)
            before, memory = references(sample), memory_bytes("RssAnon")
            run(frames, step, FRAMES)
            assert_same(before, references(sample))
            assert memory_bytes("RssAnon") - memory < SLACK_BYTES
        assert publisher.copied == 0


def test_objects_of_a_frame_are_gone_with_it():
    with attached(size=(32, 24)) as (publisher, frames):
        publisher.publish(np.zeros((24, 32, 3), np.uint8))
        frame = frames.next()
        views = [frame.rgb for _ in range(10)]
        sample = views[0].base
        # Ours, the ten arrays', the frame's, and that of getrefcount.
        assert sys.getrefcount(sample) == 13
        del frame
        assert sys.getrefcount(sample) == 12
        views.clear()
        assert sys.getrefcount(sample) == 2


def test_a_daemon_s_frames_leave_no_memory_behind(nunetd):
    name = unique_name()
    topics = ["depth", "labels", "cloud", "stats"]
    with daemon(nunetd, name, "--rate", "200"), nunet.subscribe(name, topics=topics, timeout=PATIENCE) as frames:

        def look(count):
            for frame in (frames.next() for _ in range(count)):
                cloud = frame.cloud
                _ = (frame.depth, frame.labels, cloud.points, cloud.labels, cloud.colors, frame.headers)
                _ = (frame.stats.stages_ms, frame.stats.total_ms)

        look(100)
        sample = type(frames.next().depth.base)
        before, memory = references(sample), memory_bytes("RssAnon")
        look(DAEMON_FRAMES)
        assert_same(before, references(sample))
        assert memory_bytes("RssAnon") - memory < SLACK_BYTES


def test_opening_and_closing_leaves_no_memory_and_no_descriptors_behind():
    def descriptors():
        return len(list(pathlib.Path("/proc/self/fd").iterdir()))

    def once():
        with attached(size=(32, 24)) as (publisher, frames):
            publisher.publish(np.zeros((24, 32, 3), np.uint8))
            assert frames.next().sequence == 0

    for _ in range(5):
        once()
    gc.collect()
    memory, open_before = memory_bytes("RssAnon"), descriptors()
    for _ in range(50):
        once()
    gc.collect()
    assert descriptors() <= open_before
    assert memory_bytes("RssAnon") - memory < SLACK_BYTES
