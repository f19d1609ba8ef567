"""Subscribers that die, pause and come back, and nodes that nunetd does not search for."""

import json
import signal
import socket
import time
from pathlib import Path

import pytest
from conftest import ROOT, Receiver
from sensor_msgs.msg import Image
from subscriber_process import subscriber

IMAGE = min((ROOT / "models/clip/rgb").iterdir())
TOPICS = ["--model", "unet", "--ros2-topics", "depth/image_raw"]
RECEIVED = "received\n"


def test_new_subscribers_receive_after_others_were_killed(start: object, receiver: Receiver) -> None:
    """The DDS library matches readers of killed processes again whenever a node subscribes."""
    daemon = start(IMAGE, *TOPICS)
    topic = f"/{daemon.camera}/depth/image_raw"
    for _ in range(2):
        with subscriber(topic) as killed:
            assert killed.stdout.readline() == RECEIVED
    received = receiver.subscribe(Image, topic)
    receiver.spin_until(lambda: len(received) > 40)
    stats = daemon.stop()
    assert stats["ros2"]["sent"] > 40, stats["ros2"]


def test_a_subscriber_that_pauses_receives_again(start: object) -> None:
    """Like a wireless network with an interruption."""
    daemon = start(IMAGE, *TOPICS)
    with subscriber(f"/{daemon.camera}/depth/image_raw") as paused:
        for _ in range(3):
            assert paused.stdout.readline() == RECEIVED
        for _ in range(2):
            paused.send_signal(signal.SIGSTOP)
            time.sleep(5)
            paused.send_signal(signal.SIGCONT)
            # More than were in queues while it was paused.
            for _ in range(40):
                assert paused.stdout.readline() == RECEIVED
    daemon.stop()


def test_nothing_is_sent_once_all_subscribers_are_dead(start: object) -> None:
    """Without a reader, depth is neither copied nor encoded."""
    daemon = start(IMAGE, *TOPICS)
    with subscriber(f"/{daemon.camera}/depth/image_raw") as killed:
        for _ in range(5):
            assert killed.stdout.readline() == RECEIVED
    daemon.wait_until_nothing_is_sent()
    daemon.stop()


@pytest.mark.parametrize("variables", [{"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"}])
def test_a_node_that_searches_for_nunetd_finds_it(start: object, receiver: Receiver, variables: dict) -> None:
    """Nunetd announces itself to nodes that announced themselves to it."""
    daemon = start(IMAGE, *TOPICS, env=variables)
    received = receiver.subscribe(Image, f"/{daemon.camera}/depth/image_raw")
    receiver.spin_until(lambda: len(received) > 5)
    daemon.stop()


def test_hostile_datagrams_change_nothing(start: object, receiver: Receiver) -> None:
    """Each of these crashed the DDS library: a set of 257 fragments, and INFO_REPLY behind a length of 0."""
    daemon = start(IMAGE, *TOPICS)
    received = receiver.subscribe(Image, f"/{daemon.camera}/depth/image_raw")
    receiver.spin_until(lambda: len(received) > 5)
    header = b"RTPS\x02\x04\x01\x0f" + bytes(12)
    fragments = (
        bytes([0, 0, 4, 0xC7, 0, 0, 4, 0xC2, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 1, 0, 0]) + b"\xff" * 36
    )
    nack = header + bytes([0x12, 1, len(fragments), 0]) + fragments
    reply = header + bytes([0x80, 1, 0, 0]) + bytes([0x0F, 1, 4, 0]) + bytes(4)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as attacker:
        for port in range(7410, 7410 + 64):
            for datagram in (nack, reply):
                attacker.sendto(datagram, ("127.0.0.1", port))
    count = len(received)
    receiver.spin_until(lambda: len(received) > count + 20)
    stats = daemon.stop()
    assert stats["frames"]["failed"] == 0, json.dumps(stats)
    assert "ended" not in Path(daemon.log).read_text()
