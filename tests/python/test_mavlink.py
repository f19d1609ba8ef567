"""`--mavlink`: obstacles as pymavlink reads them, compared with the LaserScan of the same frames."""

import contextlib
import itertools
import math
import os
import pathlib
import subprocess

os.environ["MAVLINK20"] = "1"  # read by pymavlink when it is imported

import pytest
from conftest import running
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from pymavlink import mavutil

ROOT = pathlib.Path(__file__).parents[2]
UNKNOWN = 65535
BIN_DEG = 5
# The leg of a chair and a box to the left, a corridor to the right.
IMAGE = ROOT / "models/drive/rgb/0117.jpg"
CAMERA = ["--mount", "0,0,0.25,0,-0.07,0", "--intrinsics", "262,262,160.3,119.2@320x240"]


@contextlib.contextmanager
def autopilot():
    """A UDP port of loopback that reads MAVLink, and its address."""
    connection = mavutil.mavlink_connection("udpin:127.0.0.1:0", dialect="common")
    try:
        yield connection, f"udpout:127.0.0.1:{connection.port.getsockname()[1]}"
    finally:
        connection.close()


def command(nunetd, name, *more):
    model = ["--model", str(ROOT / "models/wnet_c.onnx"), "--camera", f"pytest-{name}-{os.getpid()}"]
    return [nunetd, "-q", *model, "--source", str(IMAGE), "--loop", "--rate", "20", *CAMERA, *more]


def received(connection, kind):
    message = connection.recv_match(type=kind, blocking=True, timeout=60)
    assert message is not None, f"no {kind} within 60 s"
    return message


def expected(scan):
    """The distances of a LaserScan, which counts counterclockwise, around the vehicle:
    clockwise, 0 = forward.
    """
    max_cm = int(100 * scan.range_max + 0.01)
    half = math.degrees(scan.angle_increment) / 2
    distances = []
    for index in range(72):
        touching, covered = [], 0.0
        for number, beam in enumerate(scan.ranges):
            clockwise = -math.degrees(scan.angle_min + number * scan.angle_increment)
            away = abs((index * BIN_DEG - clockwise + 180) % 360 - 180)
            overlap = min(BIN_DEG / 2 + half - away, 2 * half)
            if overlap > 0.01:
                touching.append(beam)
                covered += overlap if math.isinf(beam) else 0
        near = min((beam for beam in touching if math.isfinite(beam)), default=math.inf)
        if near <= scan.range_max:
            distances.append(int(100 * near + 0.01))
        else:
            distances.append(max_cm + 1 if covered > BIN_DEG - 0.05 else UNKNOWN)
    return distances


def test_the_ring_of_distances_is_the_scan_of_the_same_frame_the_other_way_around(nunetd, tmp_path):
    recording = tmp_path / "drive.mcap"
    with autopilot() as (connection, address):
        subprocess.run(
            command(nunetd, "ring", "--frames", "3", "--mavlink", address, "--record", str(recording)),
            check=True,
        )
        message = received(connection, "OBSTACLE_DISTANCE")
    with recording.open("rb") as file:
        messages = make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
        scan = next(scan for _, channel, _, scan in messages if channel.topic.endswith("/scan"))
    ring = list(message.distances)
    assert ring == expected(scan)
    left, right = ring[71:65:-1], ring[1:7]
    assert left != right, "the scene is asymmetric, so a mirrored ring would be noticed"
    assert max(left) < 200 < max(right), "the leg of the chair is to the left, the corridor to the right"
    assert all(distance == UNKNOWN for distance in ring[8:65]), "nothing is seen beside and behind"
    assert (message.increment, message.increment_f, message.angle_offset) == (BIN_DEG, BIN_DEG, 0)
    assert message.frame == mavutil.mavlink.MAV_FRAME_BODY_FRD
    assert (message.min_distance, message.max_distance) == (0, 450)
    stamp = scan.header.stamp
    assert message.time_usec == stamp.sec * 1_000_000 + stamp.nanosec // 1000


def test_an_autopilot_sees_a_computer_that_is_alive_and_distances_10_to_15_times_per_second(nunetd):
    with autopilot() as (connection, address), running(command(nunetd, "alive", "--mavlink", address)):
        heartbeat = received(connection, "HEARTBEAT")
        assert heartbeat.type == mavutil.mavlink.MAV_TYPE_ONBOARD_CONTROLLER
        assert heartbeat.get_srcComponent() == mavutil.mavlink.MAV_COMP_ID_OBSTACLE_AVOIDANCE
        times = [received(connection, "OBSTACLE_DISTANCE").time_usec for _ in range(10)]
    periods = [later - earlier for earlier, later in itertools.pairwise(times)]
    assert all(later > earlier for earlier, later in itertools.pairwise(times)), "none is sent again"
    assert sum(periods) / len(periods) > 60_000, "20 frames per second are too many"


def test_two_cameras_of_another_vehicle_are_two_components_of_its_system(nunetd):
    senders = set()
    with autopilot() as (connection, address):
        for component in (196, 197):
            chosen = f"{address},system=42,component={component}"
            subprocess.run(command(nunetd, "ids", "--frames", "3", "--mavlink", chosen), check=True)
        # All have been sent, so nothing is waited for.
        while (message := connection.recv_match(type="OBSTACLE_DISTANCE")) is not None:
            senders.add((message.get_srcSystem(), message.get_srcComponent()))
    assert senders == {(42, 196), (42, 197)}


@pytest.mark.parametrize(
    "more, words",
    [
        (["--mavlink", "udp:127.0.0.1:14550"], "is not a MAVLink address"),
        (["--mavlink", "udpout:127.0.0.1:14550,system=0"], "is not a MAVLink address"),
        (["--mavlink", "udpout:127.0.0.1:14550", "--mount", "0,0,-1,0,0,0"], "above the floor"),
    ],
)
def test_a_wrong_address_or_place_is_refused_with_a_hint(nunetd, more, words):
    done = subprocess.run([nunetd, "run", *more], check=False, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert words in done.stderr
    assert "\nhint: " in done.stderr
