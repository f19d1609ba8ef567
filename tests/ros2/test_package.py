"""The node of `ros/nunet_ros`: it starts nunetd, restarts it, and ends it with itself."""

import runpy
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest
import rclpy
from conftest import ROOT, TIMEOUT_S, Receiver, nunetd
from rclpy.parameter import Parameter
from sensor_msgs.msg import Image

sys.path.insert(0, str(ROOT / "ros/nunet_ros"))
from nunet_ros.command import DEFAULTS, command, network_of
from nunet_ros.node import NunetNode


def test_empty_parameters_leave_the_defaults_of_nunetd() -> None:
    words = command({**DEFAULTS, "mount": "0,0,0.2,0,0,0", "arguments": ["", "--frames", "9"]}, "dds")
    expected = "nunetd run --source /dev/video0 --camera front --mount 0,0,0.2,0,0,0 --ros2-topics default"
    assert " ".join(words) == f"{expected} --ros2-depth 32FC1 --ros2 dds --frames 9"


def test_a_topic_of_images_takes_the_place_of_the_source() -> None:
    words = command({**DEFAULTS, "image_topic": "/camera/image_raw"}, "zenoh")
    assert words[:4] == ["nunetd", "run", "--source", "ros2:/camera/image_raw@zenoh"]
    assert words[-2:] == ["--ros2", "zenoh"]


def test_nunetd_uses_the_network_of_other_nodes() -> None:
    assert network_of("rmw_zenoh_cpp") == "zenoh"
    assert network_of("rmw_fastrtps_cpp") == network_of("rmw_cyclonedds_cpp") == "dds"


def test_launch_arguments_replace_only_what_they_name_in_the_parameter_file(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """With stand-ins for the `launch` packages, which the package index does not have."""
    given = {"camera": "rear"}
    packages = {"launch": ["actions", "conditions", "substitutions"]}
    packages["launch_ros"] = ["actions", "parameter_descriptions", "substitutions"]
    for package, modules in packages.items():
        for name in [package, *(f"{package}.{module}" for module in modules)]:
            monkeypatch.setitem(sys.modules, name, MagicMock())
    configuration = lambda name: SimpleNamespace(perform=lambda _: given.get(name, ""))  # noqa: E731
    sys.modules["launch.substitutions"].LaunchConfiguration = configuration
    sys.modules["launch_ros.parameter_descriptions"].ParameterValue = lambda value, value_type: value
    sys.modules["launch_ros.actions"].Node = dict
    launch = runpy.run_path(str(ROOT / "ros/nunet_ros/launch/nunet.launch.py"))
    (node,) = launch["nunet_node"](None)
    assert node["parameters"][1:] == [{"camera": "rear"}]
    given.clear()
    (node,) = launch["nunet_node"](None)
    assert len(node["parameters"]) == 1, "the file alone"
    assert set(launch["ARGUMENTS"]) <= set(DEFAULTS)


@pytest.fixture
def make_node() -> object:
    """Makes nodes with parameters, and ends them."""
    context = rclpy.Context()
    rclpy.init(context=context)
    nodes: list[NunetNode] = []

    def make(**parameters: object) -> NunetNode:
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        nodes.append(NunetNode(context=context, parameter_overrides=overrides))
        return nodes[-1]

    yield make
    for node in nodes:
        node.destroy_node()
    rclpy.shutdown(context=context)


def test_the_node_publishes_through_nunetd_and_ends_it(make_node: object, receiver: Receiver) -> None:
    image = min((ROOT / "models/clip/rgb").iterdir())
    node = make_node(
        executable=nunetd(), source=str(image.parent), camera="rosnode", model="unet",
        topics="depth/half/image_raw", arguments=["--loop", "--rate", "5"],
    )  # fmt: skip
    received = receiver.subscribe(Image, "/rosnode/depth/half/image_raw")
    receiver.spin_until(lambda: len(received) > 3)
    process = node._process
    assert process.poll() is None
    node.destroy_node()
    assert process.wait(TIMEOUT_S) == 0
    assert node.has_ended


def failing(folder: Path, code: int) -> tuple[str, Path]:
    """A program that ends with an exit code, and the file to which each start adds a line."""
    program, starts = folder / "failing", folder / "starts"
    program.write_text(f"#!/bin/sh\necho start >> {starts}\nexit {code}\n")
    program.chmod(0o755)
    return str(program), starts


def test_nunetd_is_started_again_after_a_failure(make_node: object, tmp_path: Path) -> None:
    program, starts = failing(tmp_path, 1)
    node = make_node(executable=program, restart_delay_s=0.1)
    end = time.monotonic() + TIMEOUT_S
    while not starts.exists() or len(starts.read_text().splitlines()) < 3:
        assert time.monotonic() < end
        time.sleep(0.05)
    assert not node.has_ended


def test_wrong_arguments_end_the_node(make_node: object, tmp_path: Path) -> None:
    program, starts = failing(tmp_path, 2)
    node = make_node(executable=program, restart_delay_s=0.1)
    end = time.monotonic() + TIMEOUT_S
    while not node.has_ended:
        assert time.monotonic() < end
        time.sleep(0.05)
    assert starts.read_text() == "start\n"
