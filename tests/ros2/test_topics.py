"""Every topic, received by rclpy and compared with the files of the same frame."""

import json
import re
import sys
from pathlib import Path

import numpy as np
import PIL.Image
from conftest import ROOT, Daemon, Receiver, stamp_of
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, LaserScan, PointCloud2

IMAGE = min((ROOT / "models/drive/rgb").iterdir())
CAMERA = ["--intrinsics", "262,262,160.3,119.2@320x240", "--mount", "0,0,0.25,0,-0.07,0"]
TOPICS = {
    "depth/image_raw": Image,
    "depth/camera_info": CameraInfo,
    "depth/half/image_raw": Image,
    "depth/half/camera_info": CameraInfo,
    "labels/image_raw": Image,
    "labels/confidence": Image,
    "depth/points": PointCloud2,
    "obstacles/points": PointCloud2,
    "scan": LaserScan,
    "image_raw/compressed": CompressedImage,
    "camera_info": CameraInfo,
}


def pixels(message: Image, dtype: type) -> np.ndarray:
    """The pixels of an image without padding."""
    assert message.is_bigendian == 0
    assert message.step == message.width * np.dtype(dtype).itemsize
    return np.frombuffer(message.data, dtype).reshape(message.height, message.width)


def frame_of_all(receiver: Receiver, daemon: Daemon) -> dict:
    """One message of each topic, with equal stamps."""
    names = {topic: f"/{daemon.camera}/{topic}" for topic in TOPICS}
    for topic, message_type in TOPICS.items():
        receiver.subscribe(message_type, names[topic])

    def common() -> set:
        return set.intersection(
            *({stamp_of(message) for message in receiver.messages[name]} for name in names.values())
        )

    receiver.spin_until(lambda: bool(common()))
    stamp = max(common())
    return {
        topic: next(message for message in receiver.messages[name] if stamp_of(message) == stamp)
        for topic, name in names.items()
    }


def test_every_topic_is_received_and_equals_the_results_of_its_frame(
    start: object, receiver: Receiver
) -> None:
    """Values, sizes, frames and cameras; all topics of a frame have one stamp."""
    daemon = start(IMAGE, *CAMERA, "--ros2-topics", "all")
    frame = frame_of_all(receiver, daemon)
    daemon.stop()
    check_frame(frame, daemon)


def check_frame(frame: dict, daemon: Daemon) -> None:
    """The messages of a frame have the values of the files of the same frame."""
    depth_m = np.load(daemon.out / "depth.npy")
    labels = np.asarray(PIL.Image.open(daemon.out / "labels.png"))
    np.testing.assert_array_equal(pixels(frame["depth/image_raw"], np.float32), depth_m)
    np.testing.assert_array_equal(pixels(frame["depth/half/image_raw"], np.float32), depth_m[::2, ::2])
    np.testing.assert_array_equal(pixels(frame["labels/image_raw"], np.uint8), labels)
    confidence = np.asarray(PIL.Image.open(daemon.out / "confidence.png"))
    np.testing.assert_array_equal(pixels(frame["labels/confidence"], np.uint8), confidence)
    for topic in ("labels/image_raw", "labels/confidence"):
        assert frame[topic].encoding == "mono8"
    assert bytes(frame["image_raw/compressed"].data) == IMAGE.read_bytes()
    assert frame["image_raw/compressed"].format == "jpeg"

    optical = f"{daemon.camera}_optical_frame"
    in_base = {"obstacles/points", "scan"}
    frames = {topic: message.header.frame_id for topic, message in frame.items()}
    assert frames == {topic: "base_link" if topic in in_base else optical for topic in TOPICS}

    full, half = frame["depth/camera_info"], frame["depth/half/camera_info"]
    assert (full.height, full.width) == depth_m.shape
    assert (half.height, half.width) == depth_m[::2, ::2].shape
    np.testing.assert_allclose(np.array(half.k)[:6], np.array(full.k)[:6] / 2)
    check_cloud(frame["depth/points"], depth_m)
    check_obstacles(frame["obstacles/points"], frame["scan"])


def check_cloud(cloud: PointCloud2, depth_m: np.ndarray) -> None:
    """The z of the organized cloud is depth."""
    points = np.frombuffer(cloud.data, np.float32).reshape(cloud.height, cloud.width, cloud.point_step // 4)
    rows, columns = depth_m.shape
    assert (rows % cloud.height, columns % cloud.width) == (0, 0)
    steps = rows // cloud.height, columns // cloud.width
    np.testing.assert_array_equal(points[..., 2], depth_m[:: steps[0], :: steps[1]])
    assert [field.name for field in cloud.fields] == ["x", "y", "z", "rgb", "label"]


def check_obstacles(cloud: PointCloud2, scan: LaserScan) -> None:
    """No point is nearer than the scan's beam of its direction."""
    assert [field.name for field in cloud.fields] == ["x", "y", "z", "height", "label", "confidence"]
    points = np.frombuffer(cloud.data, np.uint8).reshape(cloud.width, cloud.point_step)
    places = points[:, :12].copy().view(np.float32)
    assert 0 < len(places) <= 5000
    assert len(scan.ranges) == 72
    assert np.isfinite(np.array(scan.ranges)).any()
    angles = np.arctan2(places[:, 1], places[:, 0])
    margin = scan.angle_increment / 2 + 0.05  # corners of a tilted camera see further to the side
    assert angles.min() >= scan.angle_min - margin
    assert angles.max() <= scan.angle_max + margin


def test_millimeters_are_those_of_the_depth_in_meters(start: object, receiver: Receiver) -> None:
    """16UC1: 0 where there is no measurement."""
    daemon = start(IMAGE, *CAMERA, "--ros2-topics", "depth/image_raw", "--ros2-depth", "16UC1")
    received = receiver.subscribe(Image, f"/{daemon.camera}/depth/image_raw")
    receiver.spin_until(lambda: bool(received))
    daemon.stop()
    depth_m = np.load(daemon.out / "depth.npy")
    millimeters = pixels(received[0], np.uint16)
    expected = np.nan_to_num(np.round(depth_m.astype(np.float64) * 1000))
    assert np.abs(millimeters - expected).max() <= 1
    assert ((millimeters == 0) == np.isnan(depth_m)).all()


def test_nodes_types_hashes_and_qos_are_visible(start: object, receiver: Receiver) -> None:
    """What `ros2 topic list`, `info` and `node list` print."""
    daemon = start(IMAGE, *CAMERA, "--ros2-topics", "all")
    node, camera = receiver.node, daemon.camera
    label_info = f"/{camera}/labels/label_info"
    receiver.spin_until(lambda: f"nunetd_{camera}" in node.get_node_names())

    def publishers(topic: str) -> list[str]:
        return [publisher.node_name for publisher in node.get_publishers_info_by_topic(topic)]

    # They are found one after the other.
    for topic in [*(f"/{camera}/{topic}" for topic in TOPICS), label_info, "/tf_static"]:
        receiver.spin_until(lambda topic=topic: publishers(topic) == [f"nunetd_{camera}"])
    types = dict(node.get_topic_names_and_types())
    for topic, message_type in TOPICS.items():
        module = message_type.__module__.split(".")[0]
        assert types[f"/{camera}/{topic}"] == [f"{module}/msg/{message_type.__name__}"]
        (info,) = node.get_publishers_info_by_topic(f"/{camera}/{topic}")
        assert str(info.topic_type_hash) == hash_of(module, message_type.__name__)
        assert info.qos_profile.reliability == ReliabilityPolicy.RELIABLE
        assert info.qos_profile.durability == DurabilityPolicy.VOLATILE
    for topic, type_name in [
        (label_info, "vision_msgs/msg/LabelInfo"),
        ("/tf_static", "tf2_msgs/msg/TFMessage"),
    ]:
        assert types[topic] == [type_name]
        (info,) = node.get_publishers_info_by_topic(topic)
        assert info.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    daemon.stop()
    # It says that it leaves; otherwise nodes would see it for another 20 s.
    receiver.spin_until(lambda: not node.get_publishers_info_by_topic(label_info), timeout_s=15)


def hash_of(package: str, name: str) -> str:
    """The type's hash as ROS 2 itself has it."""
    description = next(Path(sys.prefix).rglob(f"share/{package}/msg/{name}.json"))
    hashes = json.loads(description.read_text())["type_hashes"]
    return next(known["hash_string"] for known in hashes if known["type_name"] == f"{package}/msg/{name}")


def test_diagnostics_state_rates_losses_scale_and_provider(start: object, receiver: Receiver) -> None:
    """Once per second, and only if a node subscribes."""
    daemon = start(IMAGE, *CAMERA)
    received = receiver.subscribe(DiagnosticArray, "/diagnostics")
    receiver.spin_until(lambda: len(received) >= 2)
    (status,) = received[-1].status
    values = {entry.key: entry.value for entry in status.values}
    assert status.name == f"nunetd: {daemon.camera}"
    assert status.level == b"\0"
    assert values["units"] == "metre"
    assert values["scale source"] == "focal_scaled"
    assert int(values["published"]) > 0
    assert float(values["frames per second"]) > 0
    assert re.match(r"\d+$", values["ROS 2 messages not taken"])
    assert {"depth drift, % per frame", "depth flicker, % per frame"} <= values.keys()
    assert values["self-test"] == "passed"
    daemon.stop()


def test_nothing_is_sent_without_subscribers(start: object, receiver: Receiver) -> None:
    """The default topics are offered, and not encoded."""
    daemon = start(IMAGE, *CAMERA)
    own = f"/{daemon.camera}/"
    expected = {
        own + name for name in ["depth/half/image_raw", "depth/half/camera_info", "obstacles/points", "scan"]
    }

    def offered() -> set[str]:
        return {name for name, _ in receiver.node.get_topic_names_and_types() if name.startswith(own)}

    receiver.spin_until(lambda: expected <= offered())
    assert offered() == expected
    daemon.wait_for_frames(10)
    stats = daemon.stop()
    assert stats["ros2"] == {"sent": 0, "not_taken": 0, "superseded": 0}
