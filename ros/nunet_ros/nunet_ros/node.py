"""A node that runs nunetd: it logs what nunetd logs,
restarts it after a failure, and ends it when the node ends.
"""

import signal
import subprocess
import threading
import time

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.utilities import get_rmw_implementation_identifier

from .command import DEFAULTS, command, network_of

GRACE_S = 15.0
"""nunetd finishes recordings within 5 s; a stalled disk may take longer."""

BAD_ARGUMENTS = 2
"""The exit code of nunetd for wrong arguments, with which it would end again."""


class NunetNode(Node):
    """Runs nunetd until the node is destroyed."""

    def __init__(self, **arguments: object) -> None:
        super().__init__("nunet", **arguments)
        self._parameters = {
            name: self.declare_parameter(name, default).value for name, default in DEFAULTS.items()
        }
        self._ending = threading.Event()
        self._process: subprocess.Popen | None = None
        self._lock = threading.Lock()
        self._supervisor = threading.Thread(target=self._supervise, daemon=True)
        self._supervisor.start()

    @property
    def has_ended(self) -> bool:
        """Whether nunetd ended and will not be started again."""
        return not self._supervisor.is_alive()

    def _supervise(self) -> None:
        """Starts nunetd, and again after each failure, unless its arguments are wrong."""
        delay_s = float(self._parameters["restart_delay_s"])
        while not self._ending.is_set():
            code = self._run()
            if code == BAD_ARGUMENTS:
                self.get_logger().fatal("nunetd refuses its arguments; the parameters must be changed")
                return
            if code == 0 or self._ending.is_set() or delay_s <= 0:
                return
            self.get_logger().error(f"nunetd ended with {code}; it is started again after {delay_s:g} s")
            self._ending.wait(delay_s)

    def _run(self) -> int:
        """Runs nunetd once, and returns its exit code."""
        words = command(self._parameters, network_of(get_rmw_implementation_identifier()))
        self.get_logger().info(f"starting {' '.join(words)}")
        try:
            with self._lock:
                if self._ending.is_set():
                    return 0
                self._process = subprocess.Popen(
                    words, stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, errors="replace"
                )
        except OSError as error:
            self.get_logger().fatal(f"cannot start nunetd: {error}")
            return 127
        assert self._process.stderr is not None
        for line in self._process.stderr:
            self._log(line.rstrip())
        return self._process.wait()

    def _log(self, line: str) -> None:
        """Logs a line of nunetd with its level."""
        logger = self.get_logger()
        if " WARN " in line:
            logger.warning(line)
        elif " ERROR " in line or line.startswith("error:"):
            logger.error(line)
        else:
            logger.info(line)

    def destroy_node(self) -> None:
        """Ends nunetd by SIGINT, and by SIGKILL if it does not end."""
        if self._ending.is_set():
            return
        with self._lock:
            self._ending.set()
            process = self._process
        if process is not None and process.poll() is None:
            process.send_signal(signal.SIGINT)
            end = time.monotonic() + GRACE_S
            while process.poll() is None and time.monotonic() < end:
                time.sleep(0.05)
            if process.poll() is None:
                process.kill()
        self._supervisor.join(GRACE_S)
        super().destroy_node()


def main() -> None:
    """Runs the node until it is interrupted, or until nunetd has ended for good."""
    rclpy.init()
    node = NunetNode()
    try:
        while rclpy.ok() and not node.has_ended:
            rclpy.spin_once(node, timeout_sec=0.2)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
