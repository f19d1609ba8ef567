"""Starts nunetd in its own network namespace, and ROS 2 nodes that receive from it."""

import contextlib
import ctypes
import fcntl
import json
import os
import re
import shutil
import signal
import socket
import struct
import subprocess
import tempfile
import time
import urllib.request
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).parents[2]
TIMEOUT_S = 120.0
CLONE_NEWNET = 0x40000000
CLONE_NEWUSER = 0x10000000
SIOCSIFFLAGS = 0x8914
IFF_UP = 1


def enter_own_network() -> None:
    """Moves this process and its children into a network with loopback only: tests reach no other machine."""
    user = 0 if os.geteuid() == 0 else CLONE_NEWUSER
    if ctypes.CDLL(None, use_errno=True).unshare(CLONE_NEWNET | user) != 0:
        raise OSError(
            ctypes.get_errno(), "cannot make a network namespace; run as root or allow user namespaces"
        )
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        fcntl.ioctl(any_socket, SIOCSIFFLAGS, struct.pack("16sh14x", b"lo", IFF_UP))


# Before the namespace, in which every user is another one.
USER = os.getuid()
# Before ROS 2 is imported, because threads that it starts would stay in the old namespace.
enter_own_network()
os.environ["RMW_IMPLEMENTATION"] = "rmw_fastrtps_cpp"
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ORT_DISABLE_TELEMETRY"] = "1"
# `/tmp/iceoryx2` may belong to another user, who then alone can use it.
os.environ.setdefault("NUNET_IPC_ROOT", f"{tempfile.gettempdir()}/nunet-{USER}")
os.environ["CYCLONEDDS_URI"] = (
    "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='lo'/></Interfaces>"
    "<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
    "<MaxAutoParticipantIndex>30</MaxAutoParticipantIndex>"
    "<Peers><Peer address='127.0.0.1'/></Peers></Discovery></Domain></CycloneDDS>"
)

import pytest  # noqa: E402
import rclpy  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.node import Node  # noqa: E402


def nunetd() -> str:
    """The program under test."""
    named = os.environ.get("NUNETD") or str(ROOT / "target/debug/nunetd")
    assert Path(named).is_file(), f"no nunetd at {named}; build it, or name it by NUNETD"
    return named


@dataclass
class Daemon:
    """A running nunetd that publishes a camera."""

    camera: str
    out: Path
    process: subprocess.Popen
    log: Path

    def stop(self, code: int = 0) -> dict:
        """Ends it, checks its exit code and returns its stats; the results of the last frame are in `out`."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        assert self.process.wait(TIMEOUT_S) == code, self.log.read_text()
        return json.loads((self.out / "stats.json").read_text())

    def final_counts(self) -> dict[str, int]:
        """Its counts of messages, after it has ended.

        Those in the stats are taken before the last frame has left, because a network that hangs must not
        delay them.
        """
        pattern = r"ROS 2: (\d+) messages? sent, (\d+) not taken, (\d+) frames? superseded"
        (found,) = re.findall(pattern, self.log.read_text())
        return dict(zip(("sent", "not_taken", "superseded"), map(int, found), strict=True))

    def wait_for_log(self, pattern: str, count: int = 1) -> list[str]:
        """Waits until the log has so many matches of a pattern, and returns all of them."""
        end = time.monotonic() + TIMEOUT_S
        while len(found := re.findall(pattern, self.log.read_text())) < count:
            assert time.monotonic() < end and self.process.poll() is None, self.log.read_text()
            time.sleep(0.05)
        return found

    def metric(self, name: str, label: str) -> int:
        """The value of a metric with this label, as soon as there is one."""
        address = self.wait_for_log(r"http://127\.0\.0\.1:\d+/metrics")[0]
        end = time.monotonic() + TIMEOUT_S
        while True:
            with urllib.request.urlopen(address, timeout=TIMEOUT_S) as response:
                text = response.read().decode()
            if found := re.search(rf"^{name}{{[^}}]*{label}[^}}]*}} (\d+)$", text, re.MULTILINE):
                return int(found[1])
            assert time.monotonic() < end, text
            time.sleep(0.05)

    def published(self) -> int:
        """Frames that were published until now."""
        return self.metric("nunet_frames_ended_total", 'end="published"')

    def sent(self) -> int:
        """Messages that were sent until now."""
        return self.metric("nunet_messages_total", 'end="sent"')

    def wait_for_frames(self, count: int) -> None:
        """Waits until so many more frames are published."""
        enough, end = self.published() + count, time.monotonic() + TIMEOUT_S
        while self.published() < enough:
            assert time.monotonic() < end and self.process.poll() is None, self.log.read_text()
            time.sleep(0.05)

    def wait_until_nothing_is_sent(self) -> None:
        """Waits for ten frames without a message."""
        end = time.monotonic() + TIMEOUT_S
        while True:
            before = self.sent()
            self.wait_for_frames(10)
            if self.sent() == before:
                return
            assert time.monotonic() < end, f"{before} messages were sent"


@pytest.fixture
def start_on(tmp_path: Path) -> Iterator[Callable[..., Daemon]]:
    """Starts nunetd on a source."""
    started: list[subprocess.Popen] = []

    def begin(source: str, *arguments: str, env: dict[str, str] | None = None, ros2: str = "dds") -> Daemon:
        number = len(started)
        out, log = tmp_path / f"out{number}", tmp_path / f"log{number}"
        out.mkdir()
        camera = f"ros{os.getpid()}" + (f"_{number}" if number else "")
        command = [
            nunetd(), "run", "--source", source, "--camera", camera,
            "--ros2", ros2, "--out", str(out), "--stats-json", str(out / "stats.json"),
            "--metrics", "127.0.0.1:0", *arguments,
        ]  # fmt: skip
        with log.open("w") as stderr:
            environment = {**os.environ, **(env or {})}
            process = subprocess.Popen(command, stderr=stderr, stdin=subprocess.DEVNULL, env=environment)
        started.append(process)
        return Daemon(camera, out, process, log)

    yield begin
    for process in started:
        process.kill()
        process.wait()


@pytest.fixture
def start(tmp_path: Path, start_on: Callable[..., Daemon]) -> Callable[..., Daemon]:
    """Starts nunetd on one image in a loop, so that all frames have the same results."""

    def begin(image: Path, *arguments: str, rate: str = "10", **options: object) -> Daemon:
        images = tmp_path / "images"
        images.mkdir()
        shutil.copy(image, images)
        return start_on(str(images), "--loop", "--rate", rate, *arguments, **options)

    return begin


@dataclass
class Receiver:
    """A node that keeps what it receives."""

    node: Node
    executor: SingleThreadedExecutor
    messages: dict[str, list] = field(default_factory=dict)

    def subscribe(self, message_type: type, topic: str, qos: object = 10) -> list:
        """Received messages are appended to the returned list."""
        received = self.messages.setdefault(topic, [])
        self.node.create_subscription(message_type, topic, received.append, qos)
        return received

    def spin_until(self, condition: Callable[[], bool], timeout_s: float = TIMEOUT_S) -> None:
        """Receives until the condition holds."""
        end = time.monotonic() + timeout_s
        while not condition():
            assert time.monotonic() < end, {topic: len(all_of) for topic, all_of in self.messages.items()}
            self.executor.spin_once(timeout_sec=0.1)


@contextlib.contextmanager
def participant() -> Iterator[Receiver]:
    """A ROS 2 node in this process; with a context of its own, others see it as another process."""
    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node("receiver", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    yield Receiver(node, executor)
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown(context=context)


@pytest.fixture
def receiver() -> Iterator[Receiver]:
    """A node of ROS 2."""
    with participant() as node:
        yield node


def stamp_of(message: object) -> tuple[int, int]:
    """Seconds and nanoseconds of a message's header."""
    return (message.header.stamp.sec, message.header.stamp.nanosec)
