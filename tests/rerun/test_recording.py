"""Rerun opens a recording of nunetd: the entities it finds, and their values against nunetd's own files."""

import json
import os
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from rerun.chunk import McapReader

ROOT = Path(__file__).parents[2]
FRAMES = 3
TIMEOUT_S = 120.0
MOUNT = (0.1, -0.2, 0.25)
"""Where the camera is on the robot, meters; it looks straight ahead."""

DEPTH = "/demo/depth/image_raw"
CLOUD = "/demo/depth/points"
OBSTACLES = "/demo/obstacles/points"
PER_FRAME = {
    "/demo/camera_info": "Pinhole:image_from_camera",
    "/demo/image_raw/compressed": "EncodedImage:blob",
    "/demo/labels/image_raw": "DepthImage:buffer",
    "/demo/depth/camera_info": "Pinhole:image_from_camera",
    "/demo/scan": "sensor_msgs.msg.LaserScan:message",
    DEPTH: "DepthImage:buffer",
    CLOUD: "Points3D:positions",
    OBSTACLES: "Points3D:positions",
}
"""Each entity with one value per frame, and its component in Rerun."""


@dataclass
class Opened:
    """What Rerun reads from a recording:
    the rows of each component of each entity, in the order of the file.
    """

    rows: dict[tuple[str, str], list[pa.Scalar]]
    out: Path
    """What the same run wrote as files: the last frame."""

    def last(self, entity: str, component: str, dtype: type) -> np.ndarray:
        """The values of the last frame, flat."""
        values = self.rows[entity, component][-1].values
        while isinstance(values, (pa.ListArray, pa.FixedSizeListArray)):
            values = values.flatten()
        return values.to_numpy().view(dtype)


@pytest.fixture(scope="module")
def opened(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Opened]:
    """A recording of the demo with an untrained network, opened by Rerun."""
    folder = tmp_path_factory.mktemp("rerun")
    nunetd = os.environ.get("NUNETD") or str(ROOT / "target/debug/nunetd")
    command = [nunetd, "run", "--model", str(ROOT / "models/tiny/tiny_wnet_c.onnx"), "--source", "demo"]
    command += ["--frames", str(FRAMES), "--record", str(folder / "demo.mcap"), "--out", str(folder / "out")]
    command += ["--mount", ",".join(map(str, (*MOUNT, 0, 0, 0)))]
    environment = {**os.environ, "NUNET_IPC_ROOT": str(folder / "ipc"), "ORT_DISABLE_TELEMETRY": "1"}
    run = subprocess.run(
        command, env=environment, capture_output=True, text=True, timeout=TIMEOUT_S, check=False
    )
    assert run.returncode == 0, run.stderr
    rows: dict[tuple[str, str], list[pa.Scalar]] = {}
    for chunk in McapReader(folder / "demo.mcap").stream():
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            rows.setdefault((chunk.entity_path, name), []).extend(batch.column(name))
    yield Opened(rows, folder / "out")


def test_every_topic_is_an_entity_with_one_value_per_frame(opened: Opened) -> None:
    counts = {
        entity: len(opened.rows.get((entity, component), [])) for entity, component in PER_FRAME.items()
    }
    assert counts == dict.fromkeys(PER_FRAME, FRAMES)


def test_all_entities_of_a_frame_have_its_stamp(opened: Opened) -> None:
    def stamps(entity: str) -> set[int]:
        return {stamp.value for stamp in opened.rows[entity, "ros2_timestamp"]}

    assert len(stamps(DEPTH)) == FRAMES
    assert {entity: stamps(entity) for entity in PER_FRAME} == dict.fromkeys(PER_FRAME, stamps(DEPTH))


def test_depth_is_an_image_in_meters(opened: Opened) -> None:
    depth_m = np.load(opened.out / "depth.npy")
    (form,) = opened.rows[DEPTH, "DepthImage:format"][-1].as_py()
    assert (form["width"], form["height"]) == depth_m.shape[::-1]
    assert np.array_equal(
        opened.last(DEPTH, "DepthImage:buffer", np.float32), depth_m.ravel(), equal_nan=True
    )


def test_the_cloud_is_depth_through_the_pinhole(opened: Opened) -> None:
    depth_m = np.load(opened.out / "depth.npy")
    points = opened.last(CLOUD, "Points3D:positions", np.float32).reshape(-1, 3)
    fx, _, _, _, fy, _, cx, cy, _ = opened.last(
        "/demo/depth/camera_info", "Pinhole:image_from_camera", np.float32
    )
    y_px, x_px = np.indices(depth_m.shape)
    expected = np.stack([(x_px - cx) / fx * depth_m, (y_px - cy) / fy * depth_m, depth_m], axis=-1).reshape(
        -1, 3
    )
    valid = np.isfinite(points[:, 2])
    assert valid.any()
    np.testing.assert_allclose(points[valid], expected[valid], rtol=1e-5, atol=1e-5)
    # The cloud ends at a distance from the camera, the depth image does not.
    distance_m = np.linalg.norm(expected, axis=1)
    assert np.all(np.isnan(distance_m[~valid]) | (distance_m[~valid] > distance_m[valid].max()))


def test_the_camera_is_where_the_mount_puts_it(opened: Opened) -> None:
    position_m = opened.last("/tf_static", "Transform3D:translation", np.float32)
    quaternion = opened.last("/tf_static", "Transform3D:quaternion", np.float32)
    np.testing.assert_allclose(position_m, MOUNT, rtol=1e-6)
    # From the optical frame (x right, y down, z ahead) to the robot's (x ahead, y left, z up).
    np.testing.assert_allclose(quaternion, [-0.5, 0.5, -0.5, 0.5], atol=1e-6)
    assert opened.rows["/tf_static", "Transform3D:parent_frame"][0].as_py() == ["base_link"]
    assert opened.rows["/tf_static", "Transform3D:child_frame"][0].as_py() == ["demo_optical_frame"]


def test_obstacles_are_points_in_the_frame_of_the_robot(opened: Opened) -> None:
    count = json.loads((opened.out / "obstacles.json").read_text())["points"]
    points = opened.last(OBSTACLES, "Points3D:positions", np.float32).reshape(-1, 3)
    height_m = opened.last(OBSTACLES, "Points3D:height", np.float32)
    assert len(points) == len(height_m) == count > 0
    assert opened.rows[OBSTACLES, "CoordinateFrame:frame"][-1].as_py() == ["base_link"]
