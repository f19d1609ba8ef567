"""A subscriber in a process of its own, which tests pause and kill."""

import contextlib
import subprocess
import sys
from collections.abc import Iterator

SUBSCRIBER = """
import rclpy, sys
from sensor_msgs.msg import Image
rclpy.init()
node = rclpy.create_node("subscriber")
node.create_subscription(Image, sys.argv[1], lambda message: print("received", flush=True), 10)
rclpy.spin(node)
"""


@contextlib.contextmanager
def subscriber(topic: str) -> Iterator[subprocess.Popen]:
    """Prints `received` for each message. It is killed at the end."""
    process = subprocess.Popen([sys.executable, "-c", SUBSCRIBER, topic], stdout=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.wait()
