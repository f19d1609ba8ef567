"""A subscriber in a process of its own, which tests stop and kill."""

import contextlib
import subprocess
import sys
from collections.abc import Iterator

SUBSCRIBER = """
import rclpy, sys
from sensor_msgs.msg import Image
rclpy.init()
node = rclpy.create_node("victim")
node.create_subscription(Image, sys.argv[1], lambda message: print("received", flush=True), 10)
rclpy.spin(node)
"""


@contextlib.contextmanager
def subscriber(topic: str) -> Iterator[subprocess.Popen]:
    """It prints a line for each message, and is killed in the end."""
    process = subprocess.Popen([sys.executable, "-c", SUBSCRIBER, topic], stdout=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.wait()
