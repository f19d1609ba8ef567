"""A Zenoh router, and a ROS 2 node over Zenoh with the names that `rmw_zenoh` uses."""

import contextlib
import json
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Self

import pyzeros.pub
import pyzeros.sub
import zenoh
import zenoh.ext
from pyzeros.qos import QosProfile
from pyzeros.utils import rmw_zenoh_gid, ros_type_to_dds_type
from rclpy.serialization import deserialize_message, serialize_message

TIMEOUT_S = 60.0
ROUTER = """
import sys, zenoh
config = zenoh.Config.from_json5(sys.argv[1])
with zenoh.open(config):
    print("ready", flush=True)
    sys.stdin.read()
"""


def free_port() -> int:
    """A port of loopback that nothing uses."""
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return listener.getsockname()[1]


@dataclass
class Router:
    """A router that can be killed and started again, in a process of its own."""

    endpoint: str = field(default_factory=lambda: f"tcp/127.0.0.1:{free_port()}")
    process: subprocess.Popen | None = None

    def start(self) -> Self:
        """Returns once it listens."""
        scouting = {"multicast": {"enabled": False}}
        config = {"mode": "router", "listen": {"endpoints": [self.endpoint]}, "scouting": scouting}
        command = [sys.executable, "-c", ROUTER, json.dumps(config)]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout.readline() == "ready\n"
        return self

    def kill(self) -> None:
        """Ends it without an announcement."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            self.process = None


@contextlib.contextmanager
def session(endpoint: str) -> Iterator[zenoh.Session]:
    """A session configured like those of `rmw_zenoh`."""
    config = {
        "mode": "peer",
        "connect": {"endpoints": [endpoint], "timeout_ms": -1, "exit_on_failure": False},
        "listen": {"endpoints": ["tcp/localhost:0"]},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": True}},
        "timestamping": {"enabled": True},
    }
    with zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as opened:
        yield opened


def dds_type(message_type: type) -> str:
    """The name in key expressions, such as `sensor_msgs::msg::dds_::Image_`."""
    package = message_type.__module__.split(".")[0]
    return ros_type_to_dds_type(f"{package}/msg/{message_type.__name__}")


@dataclass
class ZenohReceiver:
    """A node that keeps what it receives, with the interface of `Receiver`."""

    session: zenoh.Session
    hash_of: Callable[[str, str], str]
    messages: dict[str, list] = field(default_factory=dict)
    attachments: dict[str, list[bytes]] = field(default_factory=dict)
    kept: list = field(default_factory=list)

    def key(self, message_type: type, topic: str) -> str:
        """The key expression of a topic, with the type hash of ROS 2 itself."""
        package, name = message_type.__module__.split(".")[0], message_type.__name__
        return pyzeros.pub.publisher_keyexpr(
            topic, dds_type(message_type), self.hash_of(package, name), domain_id=0
        )

    def subscribe(self, message_type: type, topic: str) -> list:
        """Received messages are appended to the returned list, decoded by ROS 2."""
        received = self.messages.setdefault(topic, [])
        attachments = self.attachments.setdefault(topic, [])

        def keep(sample: zenoh.Sample) -> None:
            attachments.append(sample.attachment.to_bytes())
            received.append(deserialize_message(sample.payload.to_bytes(), message_type))

        self.kept.append(self.session.declare_subscriber(self.key(message_type, topic), keep))
        return received

    def subscribe_late(self, key: str) -> list[bytes]:
        """The bytes of messages of a topic that is transient local, also of those sent before."""
        received: list[bytes] = []
        history = zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1)
        subscriber = zenoh.ext.declare_advanced_subscriber(
            self.session, key, lambda sample: received.append(sample.payload.to_bytes()), history=history
        )
        self.kept.append(subscriber)
        return received

    def tokens(self) -> list[str]:
        """All liveliness tokens of the domain,
        from which `ros2 topic list`, `info` and `node list` are made.
        """
        replies = self.session.liveliness().get("@ros2_lv/0/**", timeout=5.0)
        return sorted(str(reply.ok.key_expr) for reply in replies if reply.ok is not None)

    def spin_until(self, condition: Callable[[], bool], timeout_s: float = TIMEOUT_S) -> None:
        """Waits until the condition holds."""
        end = time.monotonic() + timeout_s
        while not condition():
            assert time.monotonic() < end, {topic: len(all_of) for topic, all_of in self.messages.items()}
            time.sleep(0.05)


@dataclass
class ZenohPublisher:
    """A publisher with the names and attachments that `rmw_zenoh` uses."""

    receiver: ZenohReceiver
    message_type: type
    topic: str
    sent: int = 0

    def __post_init__(self) -> None:
        """Declares the publisher and its token."""
        opened, message_type = self.receiver.session, self.message_type
        package, name = message_type.__module__.split(".")[0], message_type.__name__
        qos, type_hash = QosProfile.sensor_data(), self.receiver.hash_of(package, name)
        token = pyzeros.pub.token_keyexpr(
            self.topic,
            dds_type(message_type),
            type_hash,
            qos,
            node_name="driver",
            session=opened,
            domain_id=0,
        )
        self.gid = rmw_zenoh_gid(token)
        self.publisher = opened.declare_publisher(self.receiver.key(message_type, self.topic))
        self.token = opened.liveliness().declare_token(token)

    def send(self, message: object) -> None:
        """Publishes a message with its attachment."""
        self.sent += 1
        numbers = self.sent.to_bytes(8, "little") + time.time_ns().to_bytes(8, "little")
        self.publisher.put(serialize_message(message), attachment=numbers + b"\x10" + self.gid)

    def close(self) -> None:
        """Undeclares the publisher and its token."""
        self.token.undeclare()
        self.publisher.undeclare()
