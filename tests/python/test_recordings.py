"""Recordings made by `rosbags` are replayed, and what nunetd writes is read by `mcap`, `mcap-ros2-support`
and `rosbags`, none of which is part of nunet."""

import contextlib
import io
import json
import os
import pathlib
import random
import resource
import signal
import subprocess
import time
from hashlib import sha256

import numpy as np
import pytest
from conftest import MODEL
from mcap.reader import NonSeekingReader, make_reader
from mcap.writer import Writer as McapWriter
from mcap_ros2.decoder import DecoderFactory
from PIL import Image
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
ONCE = ["--model", str(MODEL), "--provider", "cpu", "--threads", "1"]
FIRST_NANOS = 1_700_000_000_123_456_789
PERIOD_NANOS = 33_333_333
K = [525.0, 0.0, 320.0, 0.0, 526.0, 240.0, 0.0, 0.0, 1.0]
SIZE = (640, 480)
FRAMES = 5


def ros(name, **fields):
    return STORE.types[name](**fields)


def header(nanos):
    stamp = ros("builtin_interfaces/msg/Time", sec=nanos // 10**9, nanosec=nanos % 10**9)
    return ros("std_msgs/msg/Header", stamp=stamp, frame_id="eye_optical")


def camera_info(nanos):
    region = dict.fromkeys(("x_offset", "y_offset", "height", "width"), 0)
    return ros(
        "sensor_msgs/msg/CameraInfo",
        header=header(nanos),
        width=SIZE[0],
        height=SIZE[1],
        distortion_model="plumb_bob",
        d=np.zeros(5),
        k=np.array(K),
        r=np.eye(3).reshape(-1),
        p=np.zeros(12),
        binning_x=0,
        binning_y=0,
        roi=ros("sensor_msgs/msg/RegionOfInterest", **region, do_rectify=False),
    )


def image(index):
    """Noise in large cells, another one each frame, so that depth differs between frames."""
    cells = np.random.default_rng(index).integers(0, 256, (SIZE[1] // 32, SIZE[0] // 32, 3), np.uint8)
    return cells.repeat(32, 0).repeat(32, 1)


def compressed(rgb, form):
    file = io.BytesIO()
    Image.fromarray(rgb).save(file, form)
    return np.frombuffer(file.getvalue(), np.uint8)


def image_message(rgb, encoding, nanos):
    data = {"rgb8": rgb, "bgr8": rgb[..., ::-1], "bgra8": np.insert(rgb[..., ::-1], 3, 255, axis=2)}[encoding]
    return ros(
        "sensor_msgs/msg/Image",
        header=header(nanos),
        width=SIZE[0],
        height=SIZE[1],
        encoding=encoding,
        is_bigendian=0,
        step=data.shape[1] * data.shape[2],
        data=np.ascontiguousarray(data).reshape(-1),
    )


def make_bag(folder, form, *, images=None, info=True):
    """A ROS 2 recording of `FRAMES` images; returns the path of its file."""
    raw = form not in {"png", "jpeg"}
    name = "sensor_msgs/msg/Image" if raw else "sensor_msgs/msg/CompressedImage"
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        topic = "/eye/image_raw" if raw else "/eye/image_raw/compressed"
        channel = bag.add_connection(topic, name, typestore=STORE)
        infos = bag.add_connection("/eye/camera_info", "sensor_msgs/msg/CameraInfo", typestore=STORE)
        for index, rgb in enumerate(images or map(image, range(FRAMES))):
            nanos = FIRST_NANOS + index * PERIOD_NANOS
            if raw:
                message = image_message(rgb, form, nanos)
            else:
                data = compressed(rgb, form)
                message = ros("sensor_msgs/msg/CompressedImage", header=header(nanos), format=form, data=data)
            bag.write(channel, nanos + 1000, STORE.serialize_cdr(message, name))
            if info:
                cdr = STORE.serialize_cdr(camera_info(nanos), "sensor_msgs/msg/CameraInfo")
                bag.write(infos, nanos + 1000, cdr)
    return next(folder.glob("*.mcap"))


def replay(nunetd, given, out, *more, code=0):
    """Replays; returns stdout and stderr."""
    command = [nunetd, "replay", str(given), str(out), *ONCE, *more]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=120)
    assert done.returncode == code, done.stderr
    return done.stdout, done.stderr


def messages(path):
    """All messages of a recording by topic, as `mcap-ros2-support` decodes them: (log time, message)."""
    found = {}
    with path.open("rb") as file:
        for item in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            found.setdefault(item.channel.topic, []).append((item.message.log_time, item.decoded_message))
    return found


def meters(message):
    assert (message.encoding, message.is_bigendian, message.step) == ("32FC1", 0, 4 * message.width)
    return np.frombuffer(message.data, np.float32).reshape(message.height, message.width)


@pytest.fixture(scope="module")
def replayed(nunetd, tmp_path_factory):
    folder = tmp_path_factory.mktemp("replayed")
    bag = make_bag(folder / "bag", "png")
    replay(nunetd, bag, folder / "out.mcap", "--mount", "0.1,0.2,1.5,0,0,0")
    return folder / "out.mcap", messages(folder / "out.mcap")


def test_every_topic_of_the_profile_is_there_with_every_frame(replayed):
    found = replayed[1]
    names = [
        "image_raw/compressed",
        "camera_info",
        "depth/image_raw",
        "depth/camera_info",
        "labels/image_raw",
    ]
    for name in [*names, "depth/points"]:
        assert len(found[f"/camera/{name}"]) == FRAMES, name
    stamps = [FIRST_NANOS + index * PERIOD_NANOS for index in range(FRAMES)]
    for topic in (topic for topic in found if topic != "/tf_static"):
        assert [log for log, _ in found[topic]] == [stamp + 1000 for stamp in stamps], topic
        times = [message.header.stamp for _, message in found[topic]]
        assert [time.sec * 10**9 + time.nanosec for time in times] == stamps, topic
        assert {message.header.frame_id for _, message in found[topic]} == {"eye_optical"}


def test_images_travel_as_they_came_and_the_camera_is_theirs(replayed):
    found = replayed[1]
    for index, (_, message) in enumerate(found["/camera/image_raw/compressed"]):
        assert message.format == "png"
        assert message.data == compressed(image(index), "png").tobytes()
    _, info = found["/camera/camera_info"][0]
    assert (list(info.k), info.width, info.height) == (K, *SIZE)


def test_depth_and_labels_are_those_of_infer(nunetd, replayed, tmp_path):
    for index in (0, FRAMES - 1):
        Image.fromarray(image(index)).save(tmp_path / "image.png")
        intrinsics = ["--intrinsics", f"{K[0]},{K[4]},{K[2]},{K[5]}@640x480"]
        command = [
            nunetd,
            "-q",
            "infer",
            str(tmp_path / "image.png"),
            "--out",
            str(tmp_path),
            *ONCE,
            *intrinsics,
        ]
        subprocess.run(command, check=True)
        expected = np.load(tmp_path / "depth.npy")
        depth = meters(replayed[1]["/camera/depth/image_raw"][index][1])
        assert depth.tobytes() == expected.tobytes()
        assert np.isfinite(depth).any()
        _, labels = replayed[1]["/camera/labels/image_raw"][index]
        assert (labels.encoding, labels.step) == ("mono8", labels.width)
        assert labels.data == np.asarray(Image.open(tmp_path / "labels.png")).tobytes()


def test_the_cloud_is_depth_back_projected_by_its_own_camera_info(replayed):
    found = replayed[1]
    _, cloud = found["/camera/depth/points"][0]
    _, info = found["/camera/depth/camera_info"][0]
    fields = [(field.name, field.offset, field.datatype) for field in cloud.fields]
    assert fields == [("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("rgb", 12, 7), ("label", 15, 2)]
    layout = np.dtype([("xyz", "<f4", 3), ("bgr", "u1", 3), ("label", "u1")])
    points = np.frombuffer(cloud.data, layout).reshape(cloud.height, cloud.width)
    depth = meters(found["/camera/depth/image_raw"][0][1])
    z = points["xyz"][..., 2]
    seen = np.isfinite(z)  # points beyond the model's range have no coordinates
    assert np.array_equal(z[seen], depth[seen]) and seen.mean() > 0.5
    rows, columns = np.indices(depth.shape)
    fx, _, cx, _, fy, cy = list(info.k)[:6]
    rays = np.stack([(columns - cx) / fx, (rows - cy) / fy], axis=-1)
    valid = seen
    np.testing.assert_allclose(
        points["xyz"][valid][:, :2], (rays * depth[..., None])[valid], rtol=1e-4, atol=1e-5
    )


def test_the_mount_is_a_latched_transform_to_the_optical_frame(replayed):
    ((_, message),) = replayed[1]["/tf_static"]
    (transform,) = message.transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ("base_link", "eye_optical")
    move, turn = transform.transform.translation, transform.transform.rotation
    assert (move.x, move.y, move.z) == (0.1, 0.2, 1.5)
    assert (turn.x, turn.y, turn.z, turn.w) == (-0.5, 0.5, -0.5, 0.5)


def test_rosbags_reads_the_same_numbers(replayed):
    path, found = replayed
    with AnyReader([path]) as reader:
        connections = [c for c in reader.connections if c.topic == "/camera/depth/image_raw"]
        read = [reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages(connections=connections)]
    assert len(read) == FRAMES
    for message, (_, expected) in zip(read, found["/camera/depth/image_raw"], strict=True):
        assert message.data.tobytes() == expected.data


def test_the_same_recording_gives_the_same_bytes(nunetd, tmp_path):
    bag = make_bag(tmp_path / "bag", "jpeg")
    printed = [replay(nunetd, bag, tmp_path / f"{index}.mcap")[0] for index in range(2)]
    first = (tmp_path / "0.mcap").read_bytes()
    assert first == (tmp_path / "1.mcap").read_bytes()
    assert (
        printed[0] == printed[1]
        and f"{FRAMES} frames, 0 lost, results sha256 {sha256(first).hexdigest()}" in printed[0]
    )


def test_all_encodings_of_an_image_give_the_same_depth(nunetd, tmp_path):
    hashes = set()
    for form in ("png", "rgb8", "bgr8", "bgra8"):
        bag = make_bag(tmp_path / form, form)
        stdout, _ = replay(nunetd, bag, tmp_path / f"{form}.mcap", "--json")
        hashes.add(json.loads(stdout)["depth_and_labels_sha256"])
    assert len(hashes) == 1


def test_our_own_recording_is_replayed_without_naming_its_topic(nunetd, replayed, tmp_path):
    stdout, _ = replay(nunetd, replayed[0], tmp_path / "again.mcap")
    assert stdout.startswith(f"{FRAMES} frames, 0 lost")


def json_recording(path, *, schema_text=b"{}"):
    """Foxglove's messages in JSON, as its SDK writes them."""
    data = {"timestamp": {"sec": 5, "nsec": 6}, "frame_id": "eye", "width": 640, "height": 480, "step": 1920}
    import base64

    data |= {"encoding": "rgb8", "data": base64.b64encode(image(0).tobytes()).decode()}
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        schema = writer.register_schema("foxglove.RawImage", "jsonschema", schema_text)
        channel = writer.register_channel("/image", "json", schema)
        writer.add_message(channel, log_time=7, publish_time=7, data=json.dumps(data).encode())
        writer.finish()


def test_foxglove_images_in_json_are_read_also_without_a_schema_text(nunetd, tmp_path):
    for index, text in enumerate([b"{}", b""]):
        given, out = tmp_path / f"{index}.mcap", tmp_path / f"out{index}.mcap"
        json_recording(given, schema_text=text)
        assert replay(nunetd, given, out)[0].startswith("1 frame, 0 lost")
        ((log, message),) = messages(out)["/camera/depth/image_raw"]
        assert (log, message.header.stamp.sec, message.header.stamp.nanosec) == (7, 5, 6)
        assert message.header.frame_id == "eye"


def test_eval_measures_a_recordings_own_depth(nunetd, replayed, tmp_path):
    """The network against its own output: only whole millimeters differ, and its own camera scales it."""
    command = [nunetd, "-q", "eval", str(replayed[0]), *ONCE, "--json"]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2, "its own depth is no truth"
    assert "was written by nunetd" in done.stderr
    command += ["--depth-topic", "/camera/depth/image_raw"]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=60)
    assert done.returncode == 1, "depth of another size than its image is not compared"
    assert "its image" in done.stderr
    size = messages(replayed[0])["/camera/depth/image_raw"][0][1]
    size = (size.width, size.height)
    images = [np.asarray(Image.fromarray(image(index)).resize(size)) for index in range(FRAMES)]
    with Writer(tmp_path / "small", version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        name = "sensor_msgs/msg/CompressedImage"
        channel = bag.add_connection("/eye/image_raw/compressed", name, typestore=STORE)
        for index, rgb in enumerate(images):
            nanos = FIRST_NANOS + index * PERIOD_NANOS
            data = compressed(rgb, "png")
            message = ros(name, header=header(nanos), format="png", data=data)
            bag.write(channel, nanos, STORE.serialize_cdr(message, name))
    replay(nunetd, next((tmp_path / "small").glob("*.mcap")), tmp_path / "truth.mcap", "--publish", "depth")
    ended = subprocess.run(
        [*command[:3], str(tmp_path / "truth.mcap"), *command[4:]], check=True, capture_output=True
    )
    found = json.loads(ended.stdout)
    assert (found["pictures"], found["skipped"], found["dataset"]) == (FRAMES, 0, "truth.mcap")
    assert found["metrics"]["rmse"] < 0.001


def test_a_recording_cut_anywhere_gives_every_image_before_the_cut(nunetd, tmp_path):
    # Raw images: the writer closes a chunk after 1 MB, so that most cuts come after a complete one.
    whole = make_bag(tmp_path / "bag", "rgb8").read_bytes()
    places = sorted(random.Random(1).sample(range(len(whole)), 12))
    counts = set()
    for place in [*places, len(whole) - 20]:
        (tmp_path / "cut.mcap").write_bytes(whole[:place])
        expected = images_before_the_end(tmp_path / "cut.mcap")
        command = [
            nunetd,
            "-q",
            "replay",
            str(tmp_path / "cut.mcap"),
            str(tmp_path / "out.mcap"),
            "--force",
            *ONCE,
        ]
        done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=60)
        if expected == 0:
            assert done.returncode in {1, 3}, done.stderr
        else:
            assert done.returncode == 3, done.stderr
            assert int(done.stdout.split()[0]) >= expected, f"cut at {place}: {done.stdout}"
        counts.add(expected)
    assert counts >= {0, 2, 4, FRAMES}, "the cuts do not lie in different chunks"


def images_before_the_end(path):
    """The number of images that the reference reader finds in a cut file: complete chunks only."""
    count = 0
    with path.open("rb") as file, contextlib.suppress(Exception):
        for _, channel, _ in NonSeekingReader(file).iter_messages(log_time_order=False):
            count += channel.topic == "/eye/image_raw"
    return count


def depth_times(path):
    """Log times of the depth that a reader finds in a file without an end."""
    times = []
    with contextlib.suppress(Exception), path.open("rb") as file:
        for _, channel, message in NonSeekingReader(file).iter_messages(log_time_order=False):
            if channel.topic.endswith("depth/image_raw"):
                times.append(message.log_time)
    return times


@pytest.mark.parametrize("again", range(3))
def test_a_recording_whose_daemon_is_killed_has_every_frame_that_was_on_the_disk_before(
    nunetd, tmp_path, again
):
    path = tmp_path / "killed.mcap"
    name = f"pytest-record-{os.getpid()}-{again}"
    source = ["--source", "demo", "--rate", "20", "--publish", "depth"]
    command = [nunetd, "-q", "--model", str(MODEL), "--camera", name, *source, "--record", str(path)]
    seen = []
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as daemon:
        deadline = time.monotonic() + 60
        # It grows by whole frames while it is written: each sync brings some.
        for _ in range(1 + again):
            while len(depth_times(path)) <= len(seen) and time.monotonic() < deadline:
                time.sleep(0.05)
            grown = depth_times(path)
            assert len(grown) > len(seen), "the frames of a running daemon do not come to the disk"
            seen = grown
        daemon.send_signal(signal.SIGKILL)
        daemon.wait()
    times = depth_times(path)
    assert times[: len(seen)] == seen, "frames that could be read before are gone"
    assert times == sorted(set(times))


def test_a_whole_run_is_recorded_and_counted(nunetd, tmp_path):
    path, name = tmp_path / "run.mcap", f"pytest-run-{os.getpid()}"
    source = ["--source", "demo", "--rate", "20", "--frames", "30"]
    command = [nunetd, "--model", str(MODEL), "--camera", name, *source, "--record", str(path)]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=60)
    found = messages(path)
    recorded = len(found[f"/{name}/depth/image_raw"])
    assert f"recording: {recorded} frames" in done.stderr
    assert (done.returncode == 0) == ("not in the recording" not in done.stderr)
    assert recorded > 0
    for topic in ("image_raw/compressed", "camera_info", "labels/image_raw", "depth/points"):
        assert len(found[f"/{name}/{topic}"]) == recorded, topic
    _, message = found[f"/{name}/image_raw/compressed"][0]
    assert Image.open(io.BytesIO(message.data)).size == (320, 240), "the size of the demo"


def test_a_source_that_waits_is_recorded_whole(nunetd, tmp_path):
    bag, name = make_bag(tmp_path / "bag", "png"), f"pytest-waits-{os.getpid()}"
    (tmp_path / "recordings").mkdir()
    command = [
        nunetd,
        *ONCE,
        "--source",
        str(bag),
        "--camera",
        name,
        "--record",
        str(tmp_path / "recordings"),
    ]
    for _ in range(3):
        done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=60)
        assert done.returncode == 0, done.stderr
        (path,) = (tmp_path / "recordings").glob(f"{name}_*Z.mcap")
        found = messages(path)
        assert len(found[f"/{name}/depth/image_raw"]) == FRAMES
        assert len(found[f"/{name}/image_raw/compressed"]) == FRAMES
        path.unlink()


def test_a_source_is_never_its_own_recording(nunetd, tmp_path):
    bag = make_bag(tmp_path / "bag", "png")
    before = bag.read_bytes()
    command = [nunetd, *ONCE, "--source", str(bag), "--record", str(bag), "--force"]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2 and "is both the source and the recording" in done.stderr
    assert bag.read_bytes() == before


def test_a_recording_that_is_there_is_never_overwritten_without_force(nunetd, tmp_path):
    bag = make_bag(tmp_path / "bag", "png")
    out = tmp_path / "out.mcap"
    out.write_bytes(b"precious")
    _, stderr = replay(nunetd, bag, out, code=2)
    assert "already exists" in stderr and out.read_bytes() == b"precious"
    assert "--force" in stderr
    replay(nunetd, bag, out, "--force")
    _, stderr = replay(nunetd, bag, bag, "--force", code=2)
    assert "is both the input and the output" in stderr


def test_a_recording_with_two_topics_of_images_is_asked_about(nunetd, tmp_path):
    name = "sensor_msgs/msg/CompressedImage"
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        for eye in ("left", "right"):
            channel = bag.add_connection(f"/{eye}/image_raw/compressed", name, typestore=STORE)
            for index in range(1 + (eye == "right")):
                nanos = FIRST_NANOS + index * PERIOD_NANOS
                data = compressed(image(index), "png")
                message = ros(name, header=header(nanos), format="png", data=data)
                bag.write(channel, nanos, STORE.serialize_cdr(message, name))
    given = next((tmp_path / "bag").glob("*.mcap"))
    topics = "`/left/image_raw/compressed`, `/right/image_raw/compressed`"
    _, stderr = replay(nunetd, given, tmp_path / "out.mcap", code=2)
    assert f"has images on several topics: {topics}" in stderr and "hint: name one of the topics" in stderr
    assert not (tmp_path / "out.mcap").exists()
    source = ["--source", str(given), "--camera", f"pytest-topics-{os.getpid()}"]
    done = subprocess.run([nunetd, *ONCE, *source], check=False, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2 and topics in done.stderr
    for topic, frames in [
        ("/left/image_raw/compressed", "1 frame"),
        ("/right/image_raw/compressed", "2 frames"),
    ]:
        stdout, _ = replay(nunetd, given, tmp_path / "out.mcap", "--topic", topic, "--force")
        assert stdout.startswith(f"{frames}, 0 lost")


def test_time_that_runs_backwards_in_a_recording_loses_no_image(nunetd, tmp_path):
    name = "sensor_msgs/msg/CompressedImage"
    stamps = [FIRST_NANOS - index * PERIOD_NANOS for index in range(FRAMES)]
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        channel = bag.add_connection("/eye/image_raw/compressed", name, typestore=STORE)
        for index, nanos in enumerate(stamps):
            message = ros(name, header=header(nanos), format="png", data=compressed(image(index), "png"))
            bag.write(channel, nanos, STORE.serialize_cdr(message, name))
    given = next((tmp_path / "bag").glob("*.mcap"))
    stdout, _ = replay(nunetd, given, tmp_path / "out.mcap")
    assert stdout.startswith(f"{FRAMES} frames, 0 lost")
    found = messages(tmp_path / "out.mcap")
    assert sorted(log for log, _ in found["/camera/depth/image_raw"]) == sorted(stamps)
    stats = tmp_path / "stats.json"
    source = ["--source", str(given), "--camera", f"pytest-backwards-{os.getpid()}"]
    record = ["--record", str(tmp_path / "again.mcap"), "--stats-json", str(stats)]
    done = subprocess.run(
        [nunetd, *ONCE, *source, *record], check=False, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    frames = json.loads(stats.read_text())["frames"]
    assert (frames["captured"], frames["published"]) == (FRAMES, FRAMES)


def test_a_read_only_folder_is_an_error_before_any_work(nunetd, tmp_path):
    bag = make_bag(tmp_path / "bag", "png")
    folder = tmp_path / "readonly"
    folder.mkdir(mode=0o555)
    # Root may write everywhere, unless it lacks CAP_DAC_OVERRIDE.
    meek = ["setpriv", "--bounding-set", "-dac_override,-dac_read_search"] if os.geteuid() == 0 else []
    run = [*meek, nunetd, "-q", *ONCE, "--source", str(bag), "--camera", f"pytest-readonly-{os.getpid()}"]
    infer = [*meek, nunetd, "-q", "infer", "--out", str(folder / "out"), *ONCE]
    Image.fromarray(image(0)).save(tmp_path / "image.png")
    for command, path in [
        ([*run, "--record", str(folder / "a.mcap"), "--out", str(tmp_path / "out")], folder / "a.mcap"),
        ([*run, "--record", str(folder)], folder),
        ([*run, "--out", str(folder / "out")], folder / "out"),
        ([*run, "--out", str(folder)], folder),
        ([*run, "--stats-json", str(folder / "stats.json")], folder / "stats.json"),
        ([*infer, str(tmp_path / "image.png")], folder),
        ([*meek, nunetd, "-q", "replay", str(bag), str(folder / "a.mcap"), *ONCE], folder / "a.mcap"),
    ]:
        done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=60)
        assert done.returncode == 1, f"{command}: {done.stderr}"
        assert done.stderr.startswith("error: ") and str(path) in done.stderr, done.stderr
        assert "ermission denied" in done.stderr, done.stderr
    assert list(folder.iterdir()) == []


def small_disk():
    """A file can grow to 6 MB; more fails as on a full disk."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (6 << 20, 6 << 20))


def test_a_disk_that_fills_up_leaves_a_whole_file_and_never_stops_inference(nunetd, tmp_path):
    path, name = tmp_path / "full.mcap", f"pytest-full-{os.getpid()}"
    source = ["--source", "demo", "--rate", "20", "--frames", "120", "--publish", "depth"]
    command = [nunetd, "--model", str(MODEL), "--camera", name, *source, "--record", str(path)]
    limits = {"preexec_fn": small_disk}
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=60, **limits)
    assert done.returncode == 3, done.stderr
    assert "the recording ends here" in done.stderr
    assert "120 frames captured" in done.stderr and " 0 failed" in done.stderr
    recorded = int(done.stderr.split("recording: ")[1].split()[0])
    with path.open("rb") as file:
        read = [
            c.topic
            for _, c, _ in NonSeekingReader(file).iter_messages()
            if c.topic.endswith("depth/image_raw")
        ]
    assert len(read) == recorded > 0


def test_a_bad_recording_is_an_error_with_the_reason(nunetd, tmp_path):
    def message_for(data, code):
        (tmp_path / "bad.mcap").write_bytes(data)
        return replay(nunetd, tmp_path / "bad.mcap", tmp_path / "out.mcap", "--force", code=code)[1]

    assert "it is empty" in message_for(b"", 1)
    assert "magic" in message_for(b"this is no recording at all, is it?", 1)
    whole = make_bag(tmp_path / "bag", "png").read_bytes()
    assert "nothing before the place where it is damaged or cut off" in message_for(whole[:8], 1)
    flipped = bytearray(whole)
    flipped[len(whole) // 3] ^= 0xFF
    code = subprocess.run(
        [
            nunetd,
            "-q",
            "replay",
            str(write(tmp_path / "flip.mcap", flipped)),
            str(tmp_path / "o.mcap"),
            *ONCE,
        ],
        check=False,
        capture_output=True,
        timeout=60,
    ).returncode
    assert code in {0, 1, 3}, "never a crash"


def write(path, data) -> pathlib.Path:
    path.write_bytes(data)
    return path
