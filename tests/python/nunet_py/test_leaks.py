"""Long runs: resident memory stays flat and no reference is left behind.

`NUNET_LEAK_FRAMES=10000` makes the runs as long as the project promises.
"""

import gc
import os
import pathlib
import sys

import numpy as np
import nunet_py as nunet
import pytest
from streaming import PATIENCE, attached, daemon, memory_bytes, unique_name

FRAMES = int(os.environ.get("NUNET_LEAK_FRAMES", "2000"))
# What an allocator may keep back; a leak of one header (1 KB) in each of 2000 frames is more.
SLACK_BYTES = 1_500_000


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
            gc.collect()
            memory, objects = memory_bytes("RssAnon"), sys.getrefcount(None)
            run(frames, step, FRAMES)
            gc.collect()
            assert memory_bytes("RssAnon") - memory < SLACK_BYTES
            assert abs(sys.getrefcount(None) - objects) < 100 or sys.version_info >= (3, 12)
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
    with daemon(nunetd, name), nunet.subscribe(name, topics=topics, timeout=PATIENCE) as frames:

        def look(count):
            for frame in (frames.next() for _ in range(count)):
                cloud = frame.cloud
                _ = (frame.depth, frame.labels, cloud.points, cloud.labels, cloud.colors, frame.headers)
                _ = (frame.stats.stages_ms, frame.stats.total_ms)

        look(50)
        gc.collect()
        memory = memory_bytes("RssAnon")
        look(FRAMES // 10)
        gc.collect()
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
