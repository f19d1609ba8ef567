"""A subscriber in a process of its own, which tests pause and kill."""

import contextlib
import subprocess
import sys
import threading
from collections.abc import Iterator

TIMEOUT_S = 300.0
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
    """Prints `received` for each message.

    It is killed at the end, and after five minutes: a test that waits fails.
    """
    process = subprocess.Popen([sys.executable, "-c", SUBSCRIBER, topic], stdout=subprocess.PIPE, text=True)
    late = threading.Timer(TIMEOUT_S, process.kill)
    late.start()
    try:
        yield process
    finally:
        late.cancel()
        process.kill()
        process.wait()
