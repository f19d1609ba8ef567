"""Large messages, late subscribers, and killed subscribers."""

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from conftest import ROOT, TIMEOUT_S, Receiver, stamp_of
from sensor_msgs.msg import Image
from subscriber_process import subscriber

IMAGE = min((ROOT / "models/clip/rgb").iterdir())
FRAMES = 300


def test_all_of_300_vga_frames_that_are_sent_arrive(start: object, receiver: Receiver) -> None:
    """614 kB each, 30 per second. On a busy machine, some may not be taken, and are not sent then."""
    topics = ["--ros2-topics", "depth/image_raw", "--ros2-depth", "16UC1"]
    daemon = start(IMAGE, "--model", "unet", *topics, rate="30")
    # The queue of this subscriber does not overflow.
    received = receiver.subscribe(Image, f"/{daemon.camera}/depth/image_raw", FRAMES)
    receiver.spin_until(lambda: len(received) >= FRAMES)
    daemon.stop()
    sent = daemon.final_counts()["sent"]
    count = 0
    while len(received) > count:
        count = len(received)
        receiver.executor.spin_once(timeout_sec=2)
    stamps = [stamp_of(message) for message in received]
    assert len(set(stamps)) == len(stamps)
    assert stamps == sorted(stamps)
    # Messages that are in queues when nunetd ends may be lost; all earlier ones must arrive.
    assert sent - 30 <= len(received) <= sent, daemon.final_counts()
    first, last = (np.frombuffer(message.data, np.uint16) for message in (received[0], received[-1]))
    assert first.size == 640 * 480
    np.testing.assert_array_equal(first, last)
    gaps = np.diff([sec + nanosec / 1e9 for sec, nanosec in stamps[:FRAMES]])
    print(f"median period {np.median(gaps) * 1e3:.1f} ms, longest {gaps.max() * 1e3:.1f} ms, {sent} sent")


def test_a_subscriber_that_is_killed_changes_nothing_for_the_others(
    start: object, receiver: Receiver
) -> None:
    """Its confirmations are missing, and the network does not say that it is gone."""
    daemon = start(IMAGE, "--model", "unet", "--ros2-topics", "depth/image_raw", rate="15")
    topic = f"/{daemon.camera}/depth/image_raw"
    received = receiver.subscribe(Image, topic)
    with subscriber(topic) as killed:
        assert killed.stdout.readline() == "received\n"
        receiver.spin_until(lambda: len(received) > 10)
    start_s, before, longest, last = time.monotonic(), len(received), 0.0, time.monotonic()
    while len(received) <= before + 20:
        # Until the lease of the killed subscriber ends after 20 s, at most five would be sent.
        assert time.monotonic() < start_s + 18, "others wait for the lease of the killed subscriber"
        count = len(received)
        receiver.executor.spin_once(timeout_sec=0.1)
        if len(received) > count:
            longest, last = max(longest, time.monotonic() - last), time.monotonic()
    print(
        f"20 messages within {time.monotonic() - start_s:.1f} s after the kill, longest pause {longest:.1f} s"
    )
    stats = daemon.stop()
    assert stats["frames"]["failed"] == 0


def test_a_late_subscriber_of_another_vendor_gets_labels_and_transform(start: object) -> None:
    """Cyclone DDS. Its Python package has no ROS 2 messages, so `cyclone_messages.py` declares them."""
    robot = ["--intrinsics", "262,262,160.3,119.2@320x240", "--mount", "0.1,0,0.25,0,-0.07,0"]
    image = min((ROOT / "models/drive/rgb").iterdir())
    daemon = start(image, *robot, "--ros2-topics", "all")
    daemon.wait_for_log("ROS 2 topics")
    daemon.wait_for_frames(3)  # the subscriber is late
    reader = subprocess.run(
        [sys.executable, str(Path(__file__).with_name("cyclone_reader.py")), daemon.camera],
        capture_output=True, text=True, timeout=TIMEOUT_S, check=False,
    )  # fmt: skip
    assert reader.returncode == 0, reader.stderr
    lines = reader.stdout.splitlines()
    assert f"transform base_link {daemon.camera}_optical_frame 0.100 0.000 0.250" in lines
    classes = [line.split() for line in lines if line.startswith("class ")]
    assert [number for _, number, _ in classes] == [str(number) for number in range(len(classes))]
    assert len(classes) > 5
    assert "floor" in {name for *_, name in classes}
    daemon.stop()
