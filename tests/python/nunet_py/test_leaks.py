"""Long runs: neither memory nor references leak."""

import gc
import pathlib
import sys

import numpy as np
import nunet_py as nunet
import pytest
from streaming import TIMEOUT, attached, daemon, memory_bytes, unique_name

FRAMES = 10_000
DAEMON_FRAMES = 400
# Memory that an allocator may keep. A leak of 64 bytes in each of 10,000 frames is more, and so is one of
# each topic's header (1 KB) in 400 frames of four topics.
SLACK_BYTES = 500_000


def references(sample):
    """References to the classes and types of a frame: a leaked object keeps its class, a leaked array its
    type.

    Classes and types have reference counts in every version of Python, whereas `None` is immortal since 3.12.
    """
    gc.collect()
    kinds = [nunet.Frame, nunet.FrameHeader, sample, np.dtype(np.uint8), np.dtype(np.float32)]
    return [sys.getrefcount(kind) for kind in kinds], len(gc.get_objects())


def assert_same(before, after):
    """Equal, apart from what the interpreter itself changes."""
    (kinds, objects), (kinds_after, objects_after) = before, after
    assert all(abs(one - other) < 10 for one, other in zip(kinds, kinds_after, strict=True)), (
        kinds,
        kinds_after,
    )
    assert abs(objects_after - objects) < 100


def run(frames, step, count):
    """Receives `count` frames and reads everything that creates an object."""
    for index in range(count):
        step(index)
        frame = frames.next()
        assert frame.rgb[0, 0, 0] == index % 256
        assert frame.header.sequence == frame.sequence
        _ = (frame.image, frame.headers, frame.age, frame.topics, repr(frame))


@pytest.mark.parametrize("how", ["publish", "loan"])
def test_frames_leak_neither_memory_nor_references(how):
    images = np.zeros((256, 24, 32, 3), np.uint8) + np.arange(256, dtype=np.uint8)[:, None, None, None]
    with nunet.publisher(unique_name(), size=(32, 24)) as publisher:

        def publish(index):
            publisher.publish(images[index % 256])

        def loan(index):
            with publisher.loan() as image:
                image[:] = index % 256

        step = publish if how == "publish" else loan
        with nunet.subscribe(publisher.camera, topics=["rgb"], timeout=TIMEOUT) as frames:
            run(frames, step, 256)
            step(0)
            sample = type(frames.next().rgb.base)
            before, memory = references(sample), memory_bytes("RssAnon")
            run(frames, step, FRAMES)
            assert_same(before, references(sample))
            assert memory_bytes("RssAnon") - memory < SLACK_BYTES
        assert publisher.copied == 0


def test_objects_of_a_frame_are_released_with_it():
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


def test_the_frames_of_a_daemon_leak_no_memory(nunetd):
    name = unique_name()
    topics = ["depth", "labels", "cloud", "stats"]
    with (
        daemon(nunetd, name, "--rate", "200"),
        nunet.subscribe(name, topics=topics, timeout=TIMEOUT) as frames,
    ):

        def read_frames(count):
            for frame in (frames.next() for _ in range(count)):
                cloud = frame.cloud
                _ = (frame.depth, frame.labels, cloud.points, cloud.labels, cloud.colors, frame.headers)
                _ = (frame.stats.stages_ms, frame.stats.total_ms)

        read_frames(100)
        sample = type(frames.next().depth.base)
        before, memory = references(sample), memory_bytes("RssAnon")
        read_frames(DAEMON_FRAMES)
        assert_same(before, references(sample))
        assert memory_bytes("RssAnon") - memory < SLACK_BYTES


def test_opening_and_closing_leaks_neither_memory_nor_descriptors():
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
