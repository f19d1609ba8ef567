"""Subscribers of a running daemon: frames are complete, current and described by their headers."""

import os
import pathlib
import threading
import time

import numpy as np
import nunet_py as nunet
import pytest
from streaming import (
    TIMEOUT,
    daemon,
    start_python,
    unique_name,
)
from support import hint_of

CLIENTS = pathlib.Path(__file__).parents[1]
ALL = ["depth", "labels", "cloud", "stats"]


def image(value, shape=(48, 64, 3)):
    return np.full(shape, value, np.uint8)


def test_every_topic_of_a_frame_has_the_expected_shape_type_and_sequence(camera):
    with nunet.subscribe(camera, topics=ALL, timeout=TIMEOUT) as frames:
        assert frames.camera == camera and frames.topics == tuple(ALL)
        sequences = []
        for frame in frames:
            height, width = frame.depth.shape
            assert frame.depth.dtype == np.float32 and frame.labels.dtype == np.uint8
            assert frame.labels.shape == (height, width)
            assert frame.cloud.points.shape == (height, width, 3) and frame.cloud.points.dtype == np.float32
            assert frame.cloud.labels.shape == (height, width) and frame.cloud.colors.shape == (
                height,
                width,
                3,
            )
            assert len({header.sequence for header in frame.headers.values()}) == 1
            assert np.isnan(frame.depth).sum() == frame.header.invalid_pixels
            stats = frame.stats
            assert stats.captured == stats.published + stats.superseded + stats.failed + stats.in_flight
            assert (stats.depth_drift is None) == (stats.depth_flicker is None)
            assert stats.is_unstable is False
            sequences.append(frame.sequence)
            if len(sequences) == 5:
                break
        assert sequences == sorted(set(sequences)) and frames.connected


def test_the_cloud_agrees_with_depth_labels_and_its_own_bytes(camera):
    with nunet.subscribe(camera, topics=["cloud", "depth", "labels"], timeout=TIMEOUT) as frames:
        frame = frames.next()
        cloud = frame.cloud
        z = cloud.points[..., 2]
        seen = np.isfinite(z)  # points beyond the model's range have no coordinates
        assert np.array_equal(z[seen], frame.depth[seen]) and seen.mean() > 0.5
        assert np.array_equal(cloud.labels, frame.labels)
        assert cloud.colors.max() > 0
        valid = cloud.valid()
        assert valid.dtype == np.float32 and valid.shape == (seen.sum(), 3)
        assert np.isfinite(valid).all()


def test_the_header_has_every_field_of_the_contract_and_words_for_numbers(camera, contract):
    with nunet.subscribe(camera, timeout=TIMEOUT) as frames:
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
    with nunet.subscribe(camera, timeout=TIMEOUT) as frames:
        frame = frames.next()
        first = frame.age
        assert first > 0
        assert first < (time.monotonic_ns() - frame.header.capture_nanos) / 1e9
        assert frame.age > first


def test_stats_can_be_the_only_topic(camera):
    with nunet.subscribe(camera, topics="stats", timeout=TIMEOUT) as frames:
        first, second = frames.next().stats, frames.next().stats
        assert second.captured >= first.captured > 0
        assert first.model_name == "tiny_wnet_c.onnx" and first.provider
        assert set(first.total_ms) == {"p50", "p90", "p99", "max", "mean"}
        assert all(set(times) == set(first.total_ms) for times in first.stages_ms.values())


def test_the_newest_frame_wins(still):
    with nunet.subscribe(still.camera, topics=["rgb"], timeout=TIMEOUT) as frames:
        for value in range(10):
            still.publish(image(value))
        assert frames.next().rgb[0, 0, 0] == 9
        assert frames.latest() is None
        still.publish(image(10))
        assert frames.latest().sequence == 10


def test_depth_is_joined_with_the_image_that_it_was_computed_from(nunetd):
    name = unique_name()
    stop = threading.Event()

    def drive(publisher):
        value = 0
        while not stop.is_set():
            publisher.publish(image(value % 256))
            value += 1
            time.sleep(0.01)

    with nunet.publisher(name, size=(64, 48)) as publisher, daemon(nunetd, name, source=f"shm:{name}"):
        driver = threading.Thread(target=drive, args=(publisher,))
        driver.start()
        try:
            with nunet.subscribe(name, topics=["rgb", "depth"], timeout=TIMEOUT) as frames:
                for _ in range(20):
                    frame = frames.next()
                    assert frame.headers["rgb"].sequence == frame.headers["depth"].sequence == frame.sequence
                    assert frame.rgb[0, 0, 0] == frame.sequence % 256
        finally:
            stop.set()
            driver.join()


def test_a_subscriber_beyond_the_limit_gets_an_error_that_names_the_limit():
    with nunet.publisher(unique_name(), size=(64, 48), readers=1) as publisher:
        attach = {"topics": ["rgb"], "timeout": TIMEOUT}
        with nunet.subscribe(publisher.camera, **attach):
            with pytest.raises(nunet.NunetError, match="it may have 1 reader") as error:
                nunet.subscribe(publisher.camera, **attach)
            hint_of(error)
        nunet.subscribe(publisher.camera, **attach).close()


def test_a_missing_camera_is_a_timeout_that_names_it():
    name = unique_name()
    with pytest.raises(TimeoutError, match=name) as error:
        nunet.subscribe(name, timeout=0.1)
    hint_of(error)


def test_waiting_for_a_daemon_does_not_spin():
    busy, waited = time.process_time(), time.monotonic()
    with pytest.raises(TimeoutError):
        nunet.subscribe(unique_name(), timeout=2.0)
    busy, waited = time.process_time() - busy, time.monotonic() - waited
    # Independent of the machine's speed: a busy loop would use all of the time.
    assert busy < waited / 2


def test_a_missing_topic_is_another_error_than_a_missing_camera(still):
    with pytest.raises(TimeoutError, match="exists, but its `cloud` was not published") as error:
        nunet.subscribe(still.camera, topics=["rgb", "cloud"], timeout=0.1)
    assert "--publish" in hint_of(error)


@pytest.mark.parametrize(
    ("arguments", "exception", "message"),
    [
        ({"camera": "left/arm"}, ValueError, "left/arm"),
        ({"camera": ""}, ValueError, "camera name"),
        ({"camera": None}, TypeError, "`camera` is `None`; expected the name of a camera"),
        ({"topics": ["depht"]}, ValueError, "`depht`, which is not a topic"),
        ({"topics": ["scan"]}, ValueError, "`scan`, which is not a topic"),
        ({"topics": []}, ValueError, "`topics` is empty"),
        ({"topics": ["depth", "depth"]}, ValueError, "`depth` twice"),
        ({"topics": 3}, TypeError, "`topics` is `3`"),
        ({"topics": [3]}, TypeError, "expected names of topics"),
        ({"timeout": -1}, ValueError, "`timeout` is `-1`"),
        ({"timeout": float("nan")}, ValueError, "`timeout` is `NaN`"),
        ({"timeout": "soon"}, TypeError, "`timeout` is `'soon'`; expected seconds"),
    ],
)
def test_wrong_arguments_are_refused_with_a_hint(arguments, exception, message):
    with pytest.raises(exception, match=message) as error:
        nunet.subscribe(**{"camera": unique_name(), "timeout": 0.0} | arguments)
    hint_of(error)


def test_a_topic_that_was_not_subscribed_to_is_an_error(still):
    with nunet.subscribe(still.camera, topics=["rgb"], timeout=TIMEOUT) as frames:
        still.publish(image(1))
        frame = frames.next()
        for name in ("depth", "labels", "cloud", "stats"):
            with pytest.raises(nunet.NunetError, match=f"this frame has no `{name}`, only `rgb`") as error:
                getattr(frame, name)
            hint_of(error)


def test_an_idle_source_is_a_timeout_that_names_the_silent_publisher(still):
    with nunet.subscribe(still.camera, topics=["rgb"], timeout=0.1) as frames:
        with pytest.raises(TimeoutError, match=f"within 0.1 s: process {os.getpid()} publishes it") as error:
            next(frames)
        hint_of(error)
        with pytest.raises(TimeoutError, match=r"within 0\.02 s"):
            frames.next(timeout=0.02)
        with pytest.raises(TimeoutError, match="within 0 s"):
            frames.next(timeout=0)
        still.publish(image(1))
        assert frames.next().sequence == 0, "a timeout ends nothing"


def test_another_version_of_the_contract_is_refused_by_name():
    # In a process of its own: two copies of iceoryx2 in one process consider each other dead.
    code = """
import ctypes, sys
import iceoryx2 as iox2
from contract import new_node
node = new_node()
key, two = iox2.AttributeKey.new("nunet.contract"), iox2.AttributeValue.new("2")
name = iox2.ServiceName.new(f"nunet/{sys.argv[1]}/depth")
builder = node.service_builder(name).publish_subscribe(iox2.Slice[ctypes.c_uint8])
service = builder.create_with_attributes(iox2.AttributeSpecifier.new().define(key, two))
print("there", flush=True)
sys.stdin.read()
"""
    name = unique_name()
    later = start_python(code, name, cwd=CLIENTS)
    assert later.stdout.readline() == "there\n"
    with pytest.raises(nunet.ContractVersionError, match="version `2`") as error:
        nunet.subscribe(name, timeout=0.1)
    later.communicate(timeout=TIMEOUT)
    assert "same version on both sides" in hint_of(error)
    assert isinstance(error.value, nunet.NunetError)
