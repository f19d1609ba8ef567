"""The parameters of `examples/nav2` are those that Nav2 documents,
and its topics those that nunetd records.
"""

import os
import pathlib
import subprocess

from mcap.reader import make_reader
from ruamel.yaml import YAML

ROOT = pathlib.Path(__file__).parents[2]
PARAMETERS = ROOT / "examples/nav2/nav2_params.yaml"

# Of docs.nav2.org, "Obstacle Layer Parameters" and "Collision Monitor Node", read on 2026-11-29.
LAYER = {
    "plugin",
    "enabled",
    "footprint_clearing_enabled",
    "min_obstacle_height",
    "max_obstacle_height",
    "combination_method",
    "tf_filter_tolerance",
    "observation_sources",
}
LAYER_SOURCE = {
    "topic",
    "sensor_frame",
    "observation_persistence",
    "expected_update_rate",
    "data_type",
    "transport_type",
    "min_obstacle_height",
    "max_obstacle_height",
    "inf_is_valid",
    "marking",
    "clearing",
    "obstacle_max_range",
    "obstacle_min_range",
    "raytrace_max_range",
    "raytrace_min_range",
}
MONITOR = {
    "base_frame_id",
    "odom_frame_id",
    "cmd_vel_in_topic",
    "cmd_vel_out_topic",
    "state_topic",
    "transform_tolerance",
    "source_timeout",
    "base_shift_correction",
    "stop_pub_timeout",
    "polygons",
    "observation_sources",
    "use_realtime_priority",
    "enable_stamped_cmd_vel",
    "bond_heartbeat_period",
}
POLYGON = {
    "type",
    "points",
    "action_type",
    "min_points",
    "slowdown_ratio",
    "linear_limit",
    "angular_limit",
    "visualize",
    "polygon_pub_topic",
    "enabled",
}
MONITOR_SOURCE = {"type", "topic", "min_height", "max_height", "enabled", "source_timeout"}


def names(listed):
    """The names in a list, or in a string with spaces between them."""
    return listed.split() if isinstance(listed, str) else listed


def check(table, known, groups):
    """Every key is known, or a group that is listed, whose keys are."""
    listed = {name: keys for key, keys in groups.items() for name in names(table[key])}
    assert set(table) - known == set(listed)
    for name, keys in listed.items():
        assert set(table[name]) <= keys, name


def parameters():
    return YAML(typ="safe").load(PARAMETERS.read_text())


def test_every_parameter_is_documented():
    found = parameters()
    costmap = found["local_costmap"]["local_costmap"]["ros__parameters"]
    check(costmap["obstacle_layer"], LAYER, {"observation_sources": LAYER_SOURCE})
    monitor = found["collision_monitor"]["ros__parameters"]
    check(monitor, MONITOR, {"polygons": POLYGON, "observation_sources": MONITOR_SOURCE})
    assert monitor["source_timeout"] > 0, "0 would let the robot drive on without data"


def test_each_source_has_heights_that_keep_its_points():
    """Nav2's default is 0.0 for both heights of a source, so only points at exactly this height are kept."""
    costmap = parameters()["local_costmap"]["local_costmap"]["ros__parameters"]
    layer = costmap["obstacle_layer"]
    assert isinstance(layer["observation_sources"], str), "Nav2's layer declares a string, unlike its monitor"
    for name in names(layer["observation_sources"]):
        assert layer[name]["min_obstacle_height"] < layer[name]["max_obstacle_height"], name
    scan = layer["front_scan"]
    assert layer["min_obstacle_height"] <= scan["min_obstacle_height"] < 0 < scan["max_obstacle_height"]


def test_topics_and_frame_are_those_of_nunetd(nunetd, tmp_path):
    recording = tmp_path / "front.mcap"
    source = ["--source", "demo", "--frames", "2", "--camera", f"front-{os.getpid()}"]
    model = ["--model", str(ROOT / "models/tiny/tiny_wnet_c.onnx")]
    more = ["--mount", "0,0,0.25,0,0,0", "--record", str(recording)]
    subprocess.run([nunetd, "-q", *model, *source, *more], check=True)
    with recording.open("rb") as file:
        channels = make_reader(file).get_summary().channels.values()
    recorded = {channel.topic.replace(f"front-{os.getpid()}", "front") for channel in channels}
    found = parameters()
    layer = found["local_costmap"]["local_costmap"]["ros__parameters"]["obstacle_layer"]
    monitor = found["collision_monitor"]["ros__parameters"]
    topics = {
        table[name]["topic"] for table in (layer, monitor) for name in names(table["observation_sources"])
    }
    assert topics == {"/front/obstacles/points", "/front/scan"}
    assert topics <= recorded
    assert monitor["base_frame_id"] == "base_link"
