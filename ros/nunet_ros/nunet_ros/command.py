"""The command line of nunetd, from parameters."""

from collections.abc import Mapping, Sequence

DEFAULTS: dict[str, object] = {
    "executable": "nunetd",
    "source": "/dev/video0",
    "image_topic": "",
    "camera": "front",
    "model": "",
    "calibration": "",
    "intrinsics": "",
    "mount": "",
    "topics": "default",
    "depth_format": "32FC1",
    "restart_delay_s": 2.0,
    "arguments": [""],
}
"""The parameters and their defaults. ROS cannot tell the type of an empty list, so it has one empty text."""

FLAGS = {
    "source": "--source",
    "camera": "--camera",
    "model": "--model",
    "calibration": "--calibration",
    "intrinsics": "--intrinsics",
    "mount": "--mount",
    "topics": "--ros2-topics",
    "depth_format": "--ros2-depth",
}


def network_of(rmw_implementation: str) -> str:
    """The network of other nodes, as nunetd names it."""
    return "zenoh" if rmw_implementation == "rmw_zenoh_cpp" else "dds"


def command(parameters: Mapping[str, object], network: str) -> list[str]:
    """`nunetd run` with the flags of all parameters that are not empty.

    A topic of images takes the source's place.
    """
    topic = parameters["image_topic"]
    parameters = {**parameters, "source": f"ros2:{topic}@{network}"} if topic else parameters
    flags = [
        word
        for name, flag in FLAGS.items()
        if parameters[name] != ""
        for word in (flag, str(parameters[name]))
    ]
    further = parameters["arguments"]
    assert isinstance(further, Sequence)
    # The node's environment has the domain, the discovery range and Zenoh's configuration.
    return [
        str(parameters["executable"]),
        "run",
        *flags,
        "--ros2",
        network,
        *(word for word in further if word),
    ]
