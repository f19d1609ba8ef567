"""Topics over Zenoh as `rmw_zenoh` has them: `--ros2 zenoh` and `--source ros2:TOPIC@zenoh`."""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, TIMEOUT_S, Daemon, nunetd, stamp_of
from cyclone_reader import LabelInfo, TFMessage
from pyzeros.utils import rmw_zenoh_gid
from sensor_msgs.msg import CameraInfo, Image
from test_source import DEPTH, FRAME_ID, camera_info, file_of, infer, message_of, meters, scene
from test_topics import CAMERA, IMAGE, TOPICS, check_frame, frame_of_all, hash_of
from zenoh_peer import Router, ZenohPublisher, ZenohReceiver, free_port, session

__all__ = ["infer"]
VGA_IMAGE = min((ROOT / "models/clip/rgb").iterdir())
FRAMES = 300
SUBSCRIBER = """
import json, sys, time, zenoh
config = {
    "mode": "peer", "connect": {"endpoints": [sys.argv[1]]}, "scouting": {"multicast": {"enabled": False}}
}
with zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as session:
    kept = session.declare_subscriber(sys.argv[2], lambda sample: print("received", flush=True))
    time.sleep(1000)
"""
LABEL_INFO = "vision_msgs::msg::dds_::LabelInfo_"
TF_MESSAGE = "tf2_msgs::msg::dds_::TFMessage_"


@pytest.fixture
def router() -> Iterator[Router]:
    """A running router."""
    running = Router().start()
    yield running
    running.kill()


@pytest.fixture
def peer(router: Router) -> Iterator[ZenohReceiver]:
    """A node that is connected to the router."""
    with session(router.endpoint) as opened:
        yield ZenohReceiver(opened, hash_of)


def warnings_of(daemon: Daemon) -> list[str]:
    """Log lines about an absent router."""
    return [line for line in daemon.log.read_text().splitlines() if "no Zenoh router" in line]


def test_every_topic_is_received_and_equals_the_results_of_its_frame(
    start: object, router: Router, peer: ZenohReceiver
) -> None:
    """Values are decoded by ROS 2; each message states its number and its publisher."""
    daemon = start(IMAGE, *CAMERA, "--ros2-topics", "all", ros2=f"zenoh:{router.endpoint}")
    frame = frame_of_all(peer, daemon)
    tokens = peer.tokens()
    stats = daemon.stop()
    check_frame(frame, daemon)
    assert "problems" not in stats["ros2"]
    counts = daemon.final_counts()
    missing = numbered = 0
    for topic in TOPICS:
        attachments = peer.attachments[f"/{daemon.camera}/{topic}"]
        numbers = [int.from_bytes(attachment[:8], "little") for attachment in attachments]
        assert numbers == sorted(set(numbers))
        missing += numbers[-1] - numbers[0] + 1 - len(numbers)
        numbered += numbers[-1]
        (token,) = [token for token in tokens if f"/%{daemon.camera}%{topic.replace('/', '%')}/" in token]
        assert {attachment[16:] for attachment in attachments} == {b"\x10" + rmw_zenoh_gid(token)}
        age_s = time.time() - int.from_bytes(attachments[-1][8:16], "little") / 1e9
        assert 0 < age_s < TIMEOUT_S
    # A slow subscriber's queue may be full.
    assert missing <= counts["not_taken"], counts
    # Publishers count their messages from 1. All of these were handed to the network.
    assert numbered <= counts["sent"], counts


def test_all_of_300_vga_frames_that_are_taken_arrive(
    start: object, router: Router, peer: ZenohReceiver
) -> None:
    """614 kB each, 30 per second. On a busy machine, some may not be taken."""
    topics = ["--ros2-topics", "depth/image_raw", "--ros2-depth", "16UC1"]
    daemon = start(VGA_IMAGE, "--model", "unet", *topics, rate="30", ros2=f"zenoh:{router.endpoint}")
    topic = f"/{daemon.camera}/depth/image_raw"
    received = peer.subscribe(Image, topic)
    peer.spin_until(lambda: len(received) >= FRAMES)
    daemon.stop()
    counts = daemon.final_counts()
    numbers = [int.from_bytes(attachment[:8], "little") for attachment in peer.attachments[topic]]
    stamps = [stamp_of(message) for message in received]
    gaps = np.diff([sec + nanosec / 1e9 for sec, nanosec in stamps[:FRAMES]])
    print(f"median period {np.median(gaps) * 1e3:.1f} ms, longest {gaps.max() * 1e3:.1f} ms, {counts}")
    assert numbers == sorted(set(numbers))
    assert numbers[-1] - numbers[0] + 1 - len(numbers) <= counts["not_taken"], counts
    assert len(received[0].data) == 640 * 480 * 2


def test_messages_that_a_subscriber_does_not_take_are_counted(
    start: object, router: Router, tmp_path: Path
) -> None:
    """A paused subscriber takes nothing; frames and other subscribers continue."""
    topics = ["--ros2-topics", "depth/image_raw,scan"]
    daemon = start(VGA_IMAGE, "--model", "unet", *CAMERA, *topics, rate="15", ros2=f"zenoh:{router.endpoint}")
    key = f"0/{daemon.camera}/depth/image_raw/*/*"
    paused = subprocess.Popen(
        [sys.executable, "-c", SUBSCRIBER, router.endpoint, key], stdout=subprocess.PIPE, text=True
    )
    try:
        assert paused.stdout.readline() == "received\n"
        paused.send_signal(signal.SIGSTOP)
        with session(router.endpoint) as opened:
            peer = ZenohReceiver(opened, hash_of)
            scans = peer.subscribe(TOPICS["scan"], f"/{daemon.camera}/scan")
            peer.spin_until(lambda: len(scans) > 60)
    finally:
        paused.kill()
        paused.wait()
    stats = daemon.stop()
    print(stats["ros2"], stats["frames"])
    assert stats["ros2"]["not_taken"] > 10, stats["ros2"]
    assert stats["frames"]["failed"] == 0


def test_nodes_types_hashes_and_qos_are_visible(start: object, router: Router, peer: ZenohReceiver) -> None:
    """The tokens are those that `rmw_zenoh` makes, and disappear with nunetd."""
    daemon = start(IMAGE, *CAMERA, "--ros2-topics", "all", ros2=f"zenoh:{router.endpoint}")
    camera, node = daemon.camera, f"nunetd_{daemon.camera}"
    publishers = len(TOPICS) + len(["label_info", "tf_static", "diagnostics"])
    peer.spin_until(lambda: len(peer.tokens()) == publishers + 1)
    parts = [token.split("/") for token in peer.tokens()]
    assert {part[1] for part in parts} == {"0"}
    assert len({part[2] for part in parts}) == 1, "one session"
    assert len({part[4] for part in parts}) == len(parts), "entities differ"
    assert {tuple(part[6:9]) for part in parts} == {("%", "%", node)}
    (own,) = [part for part in parts if part[5] == "NN"]
    assert own[3] == own[4]
    stated = {part[9].replace("%", "/"): part[10:] for part in parts if part[5] == "MP"}
    for topic, message_type in TOPICS.items():
        package, name = message_type.__module__.split(".")[0], message_type.__name__
        expected = [f"{package}::msg::dds_::{name}_", hash_of(package, name), "::,5:,:,:,,"]
        assert stated[f"/{camera}/{topic}"] == expected
    assert stated[f"/{camera}/labels/label_info"][::2] == [LABEL_INFO, ":1:,1:,:,:,,"]
    assert stated["/tf_static"][::2] == [TF_MESSAGE, ":1:,1:,:,:,,"]
    assert stated["/diagnostics"][0] == "diagnostic_msgs::msg::dds_::DiagnosticArray_"
    daemon.stop()
    peer.spin_until(lambda: not peer.tokens())


def test_a_late_subscriber_receives_labels_and_transform(start: object, router: Router) -> None:
    """Both were sent before the subscriber existed."""
    daemon = start(IMAGE, *CAMERA, "--ros2-topics", "all", ros2=f"zenoh:{router.endpoint}")
    daemon.wait_for_log("ROS 2 topics:")
    with session(router.endpoint) as opened:
        late = ZenohReceiver(opened, hash_of)
        late.spin_until(lambda: any(TF_MESSAGE in token for token in late.tokens()))
        labels = late.subscribe_late(f"0/{daemon.camera}/labels/label_info/{LABEL_INFO}/*")
        transforms = late.subscribe_late(f"0/tf_static/{TF_MESSAGE}/*")
        late.spin_until(lambda: bool(labels) and bool(transforms))
    classes = [label.class_name for label in LabelInfo.deserialize(labels[0]).class_map]
    assert classes == daemon.stop()["classes"]
    (transform,) = TFMessage.deserialize(transforms[0]).transforms
    assert transform.header.frame_id == "base_link"
    assert transform.child_frame_id == f"{daemon.camera}_optical_frame"
    assert transform.transform.translation.z == pytest.approx(0.25)


def test_both_networks_get_the_same_frames(
    start: object, router: Router, receiver: object, peer: object
) -> None:
    """`--ros2` may be given more than once."""
    daemon = start(IMAGE, "--ros2", f"zenoh:{router.endpoint}", "--ros2-topics", "depth/image_raw")
    topic = f"/{daemon.camera}/depth/image_raw"
    dds, zenoh = receiver.subscribe(Image, topic), peer.subscribe(Image, topic)

    def common() -> set:
        return {stamp_of(message) for message in dds} & {stamp_of(message) for message in zenoh}

    receiver.spin_until(lambda: len(common()) > 3)
    daemon.stop()
    np.testing.assert_array_equal(meters(dds[-1]), meters(zenoh[-1]))


def test_nothing_is_sent_without_subscribers(start: object, router: Router, peer: ZenohReceiver) -> None:
    """A subscriber of one topic is one for that topic only; when it ends, nothing is sent."""
    daemon = start(IMAGE, *CAMERA, ros2=f"zenoh:{router.endpoint}")
    scans = peer.subscribe(TOPICS["scan"], f"/{daemon.camera}/scan")
    peer.spin_until(lambda: len(scans) > 5)
    published, sent = daemon.published(), daemon.sent()
    daemon.wait_for_frames(20)
    sent = daemon.sent() - sent
    published = daemon.published() - published
    assert sent <= published + 2, "one message per frame; two earlier frames may have been on their way"
    peer.kept.pop().undeclare()
    daemon.wait_until_nothing_is_sent()
    assert daemon.stop()["ros2"]["sent"] >= len(scans)


def test_the_router_may_be_killed_and_started_again(start: object, router: Router) -> None:
    """One message for each change, and new nodes find nunetd by the new router."""
    daemon = start(IMAGE, *CAMERA, ros2=f"zenoh:{router.endpoint}")
    topic = f"/{daemon.camera}/scan"
    with session(router.endpoint) as opened:
        old = ZenohReceiver(opened, hash_of)
        scans = old.subscribe(TOPICS["scan"], topic)
        old.spin_until(lambda: len(scans) > 3)
        daemon.wait_for_log("connected to the Zenoh router")  # it is checked once per second
        # On a busy machine, the first connection may take longer than it should.
        earlier = len(warnings_of(daemon))
        router.kill()
        daemon.wait_for_log("no Zenoh router", earlier + 1)
        received = len(scans)
        old.spin_until(lambda: len(scans) > received + 3)  # from node to node, without the router
    router.start()
    with session(router.endpoint) as opened:
        new = ZenohReceiver(opened, hash_of)
        scans = new.subscribe(TOPICS["scan"], topic)
        new.spin_until(lambda: len(scans) > 3)
        new.spin_until(lambda: daemon.log.read_text().count("connected to the Zenoh router") == 2)
    stats = daemon.stop()
    assert len(warnings_of(daemon)) == earlier + 1
    assert stats["frames"]["failed"] == 0
    assert "problems" not in stats["ros2"]


def test_an_absent_router_is_reported_once_and_found_later(start: object, tmp_path: Path) -> None:
    """Frames continue, and stats state the problem."""
    absent = Router()
    daemon = start(IMAGE, *CAMERA, ros2=f"zenoh:{absent.endpoint}")
    daemon.wait_for_log("no Zenoh router")
    daemon.wait_for_frames(60)  # ten per second
    assert len(warnings_of(daemon)) == 1, daemon.log.read_text()
    assert daemon.log.read_text().count(absent.endpoint) == 2, "where it is expected, and the warning"
    absent.start()
    try:
        daemon.wait_for_log("connected to the Zenoh router")
        with session(absent.endpoint) as opened:
            peer = ZenohReceiver(opened, hash_of)
            scans = peer.subscribe(TOPICS["scan"], f"/{daemon.camera}/scan")
            peer.spin_until(lambda: bool(scans))
    finally:
        absent.kill()
    daemon.wait_for_log(f"no Zenoh router at {absent.endpoint}", 2)
    stats = daemon.stop()
    assert stats["frames"]["published"] >= 60


def test_the_end_states_that_there_is_no_router(start: object) -> None:
    """Nunetd does not wait for it."""
    absent = f"tcp/127.0.0.1:{free_port()}"
    daemon = start(IMAGE, *CAMERA, ros2=f"zenoh:{absent}")
    daemon.wait_for_log("no Zenoh router")
    daemon.wait_for_frames(20)
    stats = daemon.stop()
    assert "may not know that this one has left" not in daemon.log.read_text()
    assert stats["ros2"] == {
        "sent": 0, "not_taken": 0, "superseded": 0, "problems": [f"no Zenoh router at {absent}"],
    }  # fmt: skip


def test_the_environment_of_rmw_zenoh_is_honored(start: object, router: Router, tmp_path: Path) -> None:
    """A file with the router's address, and a domain."""
    file = tmp_path / "session.json5"
    file.write_text(json.dumps({"mode": "client", "connect": {"endpoints": [router.endpoint]}}))
    env = {"ZENOH_SESSION_CONFIG_URI": str(file), "ROS_DOMAIN_ID": "7"}
    daemon = start(IMAGE, *CAMERA, ros2="zenoh", env=env)
    with session(router.endpoint) as opened:
        peer = ZenohReceiver(opened, hash_of)
        key = peer.key(TOPICS["scan"], f"/{daemon.camera}/scan").replace("0/", "7/", 1)
        received: list = []
        kept = opened.declare_subscriber(key, received.append)
        peer.spin_until(lambda: len(received) > 3)
        kept.undeclare()
    daemon.stop()


@pytest.mark.parametrize(
    ("link", "env", "message"),
    [
        ("zenoh:robot", {}, "`robot` is not a Zenoh endpoint, expected PROTOCOL/ADDRESS"),
        (
            "zenoh",
            {"ZENOH_SESSION_CONFIG_URI": "/none.json5"},
            "cannot read the Zenoh configuration `/none.json5`",
        ),
        ("zenoh", {"ZENOH_CONFIG_OVERRIDE": "mode=boat"}, "ZENOH_CONFIG_OVERRIDE cannot set `mode=boat`"),
        ("zenoh", {"ROS_DOMAIN_ID": "233"}, "ROS_DOMAIN_ID is `233`, expected a ROS 2 domain from 0 to 232"),
    ],
)
def test_mistakes_are_errors_before_the_model_is_loaded(link: str, env: dict[str, str], message: str) -> None:
    """Exit code 2, with the place and a hint."""
    command = [nunetd(), "run", "--source", str(IMAGE), "--ros2", link, "--model", "/no/such/model.onnx"]
    environment = {"PATH": "/usr/bin", **env}
    ended = subprocess.run(
        command, capture_output=True, text=True, timeout=TIMEOUT_S, check=False, env=environment
    )
    assert ended.returncode == 2, ended.stderr
    assert message in ended.stderr
    assert "hint" in ended.stderr


def test_an_image_comes_back_as_depth_with_its_stamp_and_frame(
    start_on: object, router: Router, peer: ZenohReceiver, infer: object
) -> None:
    """The image and its depth go over Zenoh; a second publisher takes the place of the first one."""
    topic, link = "/cam/image_raw", f"zenoh:{router.endpoint}"
    daemon = start_on(f"ros2:{topic}@{link}", *DEPTH, ros2=link)
    depths = peer.subscribe(Image, f"/{daemon.camera}/depth/image_raw")
    cameras = ZenohPublisher(peer, CameraInfo, "/cam/camera_info")
    sent = []
    for count in (3, 6):
        images = ZenohPublisher(peer, Image, topic)
        end = time.monotonic() + TIMEOUT_S
        while len(depths) < count:
            assert time.monotonic() < end, daemon.log.read_text()
            message, info, now = message_of(scene()), camera_info(), time.time_ns()
            message.header.frame_id = FRAME_ID
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(now, 10**9)
            info.header = message.header
            sent.append(stamp_of(message))
            cameras.send(info)
            images.send(message)
            time.sleep(0.1)
        images.close()
    subscribers = [token.split("/") for token in peer.tokens() if "/MS/" in token]
    daemon.stop()
    assert {part[9] for part in subscribers} == {"%cam%image_raw", "%cam%camera_info"}
    assert {part[12] for part in subscribers} == {"2::,1:,:,:,,"}
    assert {stamp_of(depth) for depth in depths} <= set(sent)
    assert {depth.header.frame_id for depth in depths} == {FRAME_ID}
    np.testing.assert_array_equal(meters(depths[-1]), infer(file_of(scene(), "png"), "png"))
    assert "assume the training camera" not in daemon.log.read_text()
