"""From an image that rclpy publishes to its depth in rclpy, less the time of the network itself.

Run it with the interpreter that `cargo xtask test --ros2` has made, and with `NUNETD` naming a release build:
`python benches/ros2_latency.py [MODEL] [FRAMES]`. It prints medians in milliseconds.
"""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests/ros2"))
import conftest  # enters its own network namespace before ROS 2 is imported
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Image

TOPIC = "/bench/image_raw"
SIZE = (640, 480)
RATE_HZ = 15
WARM_UP = 15
TIMEOUT_S = 120.0
# The stages of nunetd itself; all others are those of the model.
OWN_STAGES = {
    "queue", "preprocess", "decode", "decimation", "spatial", "temporal", "holes", "cloud", "obstacles",
    "publish",
}  # fmt: skip


def exchange(frames: int, nunetd: subprocess.Popen) -> list[float]:
    """Seconds from the start of each publication to the arrival of its depth."""
    rclpy.init()
    node = rclpy.create_node("bench")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    sent: dict[tuple[int, int], float] = {}
    taken: list[float] = []

    def on_depth(message: Image) -> None:
        taken.append(time.monotonic() - sent[conftest.stamp_of(message)])

    node.create_subscription(Image, "/latency/depth/image_raw", on_depth, qos_profile_sensor_data)
    images = node.create_publisher(Image, TOPIC, qos_profile_sensor_data)
    width, height = SIZE
    pixels = np.random.default_rng(1).integers(0, 255, 3 * width * height, np.uint8).tobytes()
    message = Image(width=width, height=height, step=3 * width, encoding="rgb8", data=pixels)
    end = time.monotonic() + TIMEOUT_S + frames / RATE_HZ
    while len(taken) < WARM_UP + frames:
        assert nunetd.poll() is None, "nunetd has ended"
        assert time.monotonic() < end, f"{len(taken)} depths arrived"
        message.header.stamp = node.get_clock().now().to_msg()
        start = time.monotonic()
        sent[conftest.stamp_of(message)] = start
        images.publish(message)
        while (left_s := start + 1 / RATE_HZ - time.monotonic()) > 0:
            executor.spin_once(timeout_sec=left_s)
    rclpy.shutdown()
    return taken[WARM_UP:]


def main(model: str, frames: int) -> None:
    """Runs nunetd beside the exchange, and prints what both measured."""
    with tempfile.TemporaryDirectory() as folder:
        stats = Path(folder) / "stats.json"
        command = [
            conftest.nunetd(), "-q", "run", "--source", f"ros2:{TOPIC}", "--camera", "latency",
            "--model", model, "--ros2", "dds", "--ros2-topics", "depth/image_raw", "--stats-json", str(stats),
        ]  # fmt: skip
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL)
        try:
            end_to_end = np.array(exchange(frames, process)) * 1e3
        finally:
            process.terminate()
            process.wait(TIMEOUT_S)
        stages = json.loads(stats.read_text())["latency_ms"]["stages"]
    network = sum(stage["p50"] for name, stage in stages.items() if name not in OWN_STAGES)
    median, p90 = np.percentile(end_to_end, [50, 90])
    print(f"{model}, {len(end_to_end)} frames: end to end {median:.1f} ms (p90 {p90:.1f}),", end=" ")
    print(f"network {network:.1f} ms, the rest {median - network:.1f} ms")


main(sys.argv[1] if len(sys.argv) > 1 else "wnet_c", int(sys.argv[2]) if len(sys.argv) > 2 else 150)
