"""Images that rclpy and Cyclone DDS publish, read by nunetd: `--source ros2:TOPIC`."""

import io
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from conftest import ROOT, TIMEOUT_S, Daemon, Receiver, nunetd, participant, stamp_of
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_msgs.msg import String

MODEL = str(ROOT / "models/tiny/tiny_wnet_c.onnx")
TOPIC = "/cam/image_raw"
FRAME_ID = "cam_color_optical_frame"
SIZE = (128, 96)
INTRINSICS = (110.0, 111.0, 63.0, 47.5)
DEPTH = ["--model", MODEL, "--ros2-topics", "depth/image_raw,depth/camera_info"]


def scene(size: tuple[int, int] = SIZE) -> np.ndarray:
    """An image that changes if it is mirrored or if its channels are swapped."""
    image = PIL.Image.open(min((ROOT / "models/drive/rgb").iterdir())).convert("RGB")
    return np.asarray(image.resize(size))


def message_of(rgb: np.ndarray, encoding: str = "rgb8") -> Image:
    """The image, rows without padding."""
    height, width = rgb.shape[:2]
    pixels = {"rgb8": rgb, "bgr8": rgb[..., ::-1], "mono8": rgb[..., 1]}[encoding]
    step = pixels[0].size
    return Image(height=height, width=width, encoding=encoding, step=step, data=pixels.tobytes())


def camera_info(size: tuple[int, int] = SIZE) -> CameraInfo:
    """The camera of all images."""
    fx, fy, cx, cy = INTRINSICS
    info = CameraInfo(width=size[0], height=size[1], distortion_model="plumb_bob", d=[0.0] * 5)
    info.k = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]
    info.r = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    info.p = [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]
    return info


@dataclass
class Driver:
    """A camera's driver: images with their camera, and the stamps that were sent."""

    receiver: Receiver
    topic: str = TOPIC
    message_type: type = Image
    sent: list[tuple[int, int]] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Makes the publishers."""
        node, namespace = self.receiver.node, self.topic.split("/image_raw")[0]
        self.images = node.create_publisher(self.message_type, self.topic, qos_profile_sensor_data)
        self.cameras = node.create_publisher(CameraInfo, f"{namespace}/camera_info", qos_profile_sensor_data)

    def send(self, message: object, info: CameraInfo | None = None) -> None:
        """Publishes an image with the current time."""
        message.header.frame_id = FRAME_ID
        message.header.stamp = self.receiver.node.get_clock().now().to_msg()
        self.sent.append(stamp_of(message))
        if info is not None:
            info.header = message.header
            self.cameras.publish(info)
        self.images.publish(message)

    def send_until(
        self, condition: Callable[[], bool], message: object, info: CameraInfo | None = None
    ) -> None:
        """Publishes ten images per second until the condition holds."""
        end = time.monotonic() + TIMEOUT_S
        while not condition():
            assert time.monotonic() < end, "nothing came back"
            self.send(message, info)
            next_s = time.monotonic() + 0.1
            while (left_s := next_s - time.monotonic()) > 0:
                self.receiver.executor.spin_once(timeout_sec=left_s)

    def wait_for_subscriber(self) -> None:
        """Until nunetd has subscribed to images and camera."""
        self.receiver.spin_until(lambda: self.images.get_subscription_count() > 0)
        self.receiver.spin_until(lambda: self.cameras.get_subscription_count() > 0)


def depths_of(receiver: Receiver, daemon: Daemon) -> list[Image]:
    """The depth of a camera, as it arrives."""
    return receiver.subscribe(Image, f"/{daemon.camera}/depth/image_raw")


def meters(message: Image) -> np.ndarray:
    """The pixels of a depth image."""
    return np.frombuffer(message.data, np.float32).reshape(message.height, message.width)


def file_of(rgb: np.ndarray, name: str) -> bytes:
    """The image as a PNG or JPEG file."""
    file = io.BytesIO()
    PIL.Image.fromarray(rgb).save(file, name)
    return file.getvalue()


@pytest.fixture
def infer(tmp_path: Path) -> Callable[[bytes, str], np.ndarray]:
    """The depth of an image file by `nunetd infer`."""

    def run(data: bytes, name: str) -> np.ndarray:
        image, out = tmp_path / f"scene.{name}", tmp_path / "inferred"
        image.write_bytes(data)
        intrinsics = f"{','.join(str(number) for number in INTRINSICS)}@{SIZE[0]}x{SIZE[1]}"
        command = [
            nunetd(),
            "infer",
            str(image),
            "--model",
            MODEL,
            "--out",
            str(out),
            "--intrinsics",
            intrinsics,
        ]
        subprocess.run(command, check=True, capture_output=True, timeout=TIMEOUT_S)
        return np.load(next(out.rglob("depth.npy")))

    return run


def test_an_image_comes_back_as_depth_with_its_stamp_and_frame(
    start_on: object, receiver: Receiver, infer: Callable[[bytes, str], np.ndarray]
) -> None:
    """Depth equals that of `nunetd infer`, also in shared memory, whose last frame is in `depth.npy`."""
    daemon = start_on(f"ros2:{TOPIC}", *DEPTH)
    driver, depths = Driver(receiver), depths_of(receiver, daemon)
    cameras = receiver.subscribe(CameraInfo, f"/{daemon.camera}/depth/camera_info")
    driver.send_until(lambda: len(depths) > 3 and bool(cameras), message_of(scene()), camera_info())
    daemon.stop()
    assert {stamp_of(depth) for depth in depths} <= set(driver.sent)
    assert {depth.header.frame_id for depth in depths} == {FRAME_ID}
    inferred = infer(file_of(scene(), "png"), "png")
    np.testing.assert_array_equal(meters(depths[-1]), inferred)
    np.testing.assert_array_equal(np.load(daemon.out / "depth.npy"), inferred)
    assert stamp_of(cameras[-1]) in driver.sent
    np.testing.assert_allclose(np.array(cameras[-1].k)[[0, 4, 2, 5]], INTRINSICS)
    assert "assume the training camera" not in daemon.log.read_text()


def test_a_chosen_frame_replaces_that_of_the_images(start_on: object, receiver: Receiver) -> None:
    daemon = start_on(f"ros2:{TOPIC}", *DEPTH, "--frame-id", "eye")
    driver, depths = Driver(receiver), depths_of(receiver, daemon)
    driver.send_until(lambda: bool(depths), message_of(scene()), camera_info())
    assert depths[-1].header.frame_id == "eye"
    daemon.stop()


@pytest.mark.parametrize("name", ["png", "jpeg"])
def test_compressed_images_are_decoded(
    start_on: object, receiver: Receiver, infer: Callable[[bytes, str], np.ndarray], name: str
) -> None:
    """On the topic of image_transport, whose camera is in the namespace of the raw image."""
    topic = f"{TOPIC}/compressed"
    daemon = start_on(f"ros2:{topic}", *DEPTH)
    driver, depths = Driver(receiver, topic, CompressedImage), depths_of(receiver, daemon)
    file = file_of(scene(), name)
    message = CompressedImage(format=f"rgb8; {name} compressed bgr8", data=file)
    driver.send_until(lambda: bool(depths), message, camera_info())
    daemon.stop()
    assert stamp_of(depths[-1]) in driver.sent
    assert depths[-1].header.frame_id == FRAME_ID
    np.testing.assert_array_equal(meters(depths[-1]), infer(file, name))


def test_300_images_at_30_hz_arrive(start_on: object, receiver: Receiver) -> None:
    """Every image is captured, and becomes depth or is superseded. A busy machine gets them more slowly."""
    daemon = start_on(f"ros2:{TOPIC}", *DEPTH)
    driver, depths = Driver(receiver), depths_of(receiver, daemon)
    message, info = message_of(scene()), camera_info()
    driver.send_until(lambda: bool(depths), message, info)

    def ahead() -> int:
        return len(driver.sent) - 1 - driver.sent.index(stamp_of(depths[-1]))

    for _ in range(300):
        start_s = time.monotonic()
        driver.send(message, info)
        while (left_s := start_s + 1 / 30 - time.monotonic()) > 0:
            receiver.executor.spin_once(timeout_sec=left_s)
        # Best effort: the queues of nunetd hold a few images. The newest depth may not have been taken.
        while ahead() > 3 and time.monotonic() < start_s + 5:
            receiver.executor.spin_once(timeout_sec=0.1)
    last = driver.sent[-1]
    driver.send_until(lambda: stamp_of(depths[-1]) > last, message, info)
    frames = daemon.stop()["frames"]
    print(frames, f"{len(depths)} depths received")
    assert 300 <= frames["captured"] <= len(driver.sent), daemon.log.read_text()
    assert frames["failed"] == 0
    assert frames["published"] + frames["superseded"] == frames["captured"]
    assert "lost on the network" not in daemon.log.read_text()


@pytest.mark.parametrize("size", [(640, 480), (1920, 1080)])
def test_large_images_are_put_together(start_on: object, receiver: Receiver, size: tuple[int, int]) -> None:
    """0.9 MB and 6.2 MB, in fragments of 64 kB that are not repeated."""
    daemon = start_on(f"ros2:{TOPIC}", *DEPTH)
    driver, depths = Driver(receiver), depths_of(receiver, daemon)
    driver.send_until(lambda: len(depths) > 2, message_of(scene(size), "bgr8"), camera_info(size))
    frames = daemon.stop()["frames"]
    print(size, len(driver.sent), frames)
    assert frames["failed"] == 0
    assert stamp_of(depths[-1]) in driver.sent


def test_images_that_cannot_be_read_are_counted_and_reported(start_on: object, receiver: Receiver) -> None:
    daemon = start_on(f"ros2:{TOPIC}", *DEPTH)
    driver, depths = Driver(receiver), depths_of(receiver, daemon)
    good = message_of(scene())
    driver.send_until(lambda: bool(depths), good, camera_info())
    for change in ({"encoding": "rainbow7"}, {"width": 4000}, {"data": good.data[:-1]}):
        bad = message_of(scene())
        for name, value in change.items():
            setattr(bad, name, value)
        driver.send(bad)
        time.sleep(0.3)
    count = len(depths)
    driver.send_until(lambda: len(depths) > count, good, camera_info())
    assert daemon.stop(code=3)["frames"]["failed"] == 3
    log = daemon.log.read_text()
    assert (
        f"cannot read an image on topic `{TOPIC}`: encoding `rainbow7` cannot be read, expected rgb8" in log
    )


PUBLISHER = """
import rclpy
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Image
rclpy.init()
node = rclpy.create_node("publisher")
images = node.create_publisher(Image, "/cam/image_raw", qos_profile_sensor_data)
message = Image(height=96, width=128, encoding="rgb8", step=384, data=bytes(range(256)) * 144)
node.create_timer(0.05, lambda: images.publish(message))
rclpy.spin(node)
"""


@pytest.fixture
def start_publisher() -> Iterator[Callable[[], subprocess.Popen]]:
    """Starts publishers in processes that can be killed."""
    started: list[subprocess.Popen] = []

    def begin() -> subprocess.Popen:
        started.append(subprocess.Popen([sys.executable, "-c", PUBLISHER]))
        return started[-1]

    yield begin
    for process in started:
        process.kill()
        process.wait()


def test_a_killed_publisher_may_come_back(
    start_on: object, receiver: Receiver, start_publisher: Callable[[], subprocess.Popen]
) -> None:
    """It is killed, so it does not announce its end. Nunetd waits for the next one and logs this once."""
    daemon = start_on(f"ros2:{TOPIC}", *DEPTH)
    depths = depths_of(receiver, daemon)
    first = start_publisher()
    receiver.spin_until(lambda: len(depths) > 3)
    first.kill()
    first.wait()
    receiver.spin_until(lambda: f"waiting for topic `{TOPIC}`" in daemon.log.read_text())
    count = len(depths)
    start_publisher()
    receiver.spin_until(lambda: len(depths) > count + 3)
    daemon.stop()
    assert daemon.log.read_text().count("waiting for topic") == 1


def test_a_topic_of_another_type_is_named_with_it(start_on: object, receiver: Receiver) -> None:
    daemon = start_on(f"ros2:{TOPIC}", *DEPTH)
    expected = f"waiting for topic `{TOPIC}`: it has type std_msgs/msg/String, expected sensor_msgs/msg/Image"
    with participant() as other:
        other.node.create_publisher(String, TOPIC, 10)
        receiver.spin_until(lambda: expected in daemon.log.read_text())
    driver, depths = Driver(receiver), depths_of(receiver, daemon)
    driver.send_until(lambda: bool(depths), message_of(scene()))
    daemon.stop()


def test_the_subscriber_is_visible_with_node_type_and_qos(start_on: object, receiver: Receiver) -> None:
    daemon = start_on(f"ros2:{TOPIC}", *DEPTH)
    driver = Driver(receiver)
    driver.wait_for_subscriber()
    node = receiver.node
    receiver.spin_until(lambda: "nunetd_source" in node.get_node_names())
    (info,) = node.get_subscriptions_info_by_topic(TOPIC)
    assert (info.topic_type, info.qos_profile.reliability) == (
        "sensor_msgs/msg/Image",
        qos_profile_sensor_data.reliability,
    )
    receiver.spin_until(lambda: node.get_subscriptions_info_by_topic(TOPIC)[0].node_name == "nunetd_source")
    daemon.stop()


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("ros2:", "`` cannot be the name of a ROS 2 topic"),
        ("ros2:/cam//image", "`/cam//image` cannot be the name of a ROS 2 topic"),
        ("ros2:/cam/image_raw@300", "the domain is `300`, expected a ROS 2 domain from 0 to 232"),
    ],
)
def test_a_wrong_name_is_an_error_at_once(source: str, expected: str) -> None:
    run = subprocess.run(
        [nunetd(), "run", "--source", source, "--model", MODEL],
        capture_output=True, text=True, timeout=TIMEOUT_S, check=False,
    )  # fmt: skip
    assert run.returncode == 2, run.stderr
    assert expected in run.stderr


def test_images_of_another_vendor_arrive(start_on: object, receiver: Receiver) -> None:
    """Cyclone DDS, which has fragments of another size."""
    daemon = start_on(f"ros2:{TOPIC}", *DEPTH)
    depths = depths_of(receiver, daemon)
    publisher = subprocess.Popen(
        [sys.executable, str(Path(__file__).with_name("cyclone_publisher.py")), TOPIC]
    )
    try:
        receiver.spin_until(lambda: len(depths) > 3)
    finally:
        publisher.kill()
        publisher.wait()
    daemon.stop()
    assert {depth.header.frame_id for depth in depths} == {"cyclone"}
    assert all(depth.header.stamp.sec == 7 for depth in depths)
