"""Files of a rendered sequence: camera, poses, truth."""

import csv
import json

import numpy as np
from PIL import Image

from nunet_models.classes import CLASSES_13
from nunet_models.rendering import sequence
from nunet_models.rendering.intrinsics import Intrinsics


def test_camera_and_poses_read_back_as_they_were_written(tmp_path):
    camera = Intrinsics(262.0, 261.5, 160.3, 119.2, 320, 240)
    sequence.write_camera(tmp_path, camera, 10)
    known = json.loads((tmp_path / "camera.json").read_text())
    assert (known["fx"], known["fy"], known["cx"], known["cy"]) == (262.0, 261.5, 160.3, 119.2)
    assert (known["width"], known["height"], known["frames_per_second"]) == (320, 240, 10)
    assert tuple(known["classes"]) == CLASSES_13
    pose = np.arange(12).reshape(3, 4) / 7
    sequence.write_poses(tmp_path, {"0000": pose, "0001": -pose})
    with (tmp_path / "poses.csv").open(newline="") as file:
        header, first, second = csv.reader(file)
    assert header[:5] == ["id", "right_x", "down_x", "ahead_x", "x"]
    assert np.abs(np.array(first[1:], float).reshape(3, 4) - pose).max() < 1e-6
    assert second[0] == "0001"
    sequence.write_poses(tmp_path, {"0001": -pose}, name="of_one.csv")
    assert (tmp_path / "of_one.csv").read_text().splitlines() == [
        ",".join(header),
        ",".join(second),
    ]


def test_truth_is_millimeters_with_0_where_there_is_none(tmp_path):
    for folder in sequence.FOLDERS:
        (tmp_path / folder).mkdir()
    depth_m = np.array([[1.2344, np.nan], [0.25, 12.0]])
    labels = np.array([[0, 255], [12, 4]], np.uint8)
    sequence.write_truth(tmp_path, "0000", depth_m, labels)
    assert np.array(Image.open(tmp_path / "depth/0000.png")).tolist() == [[1234, 0], [250, 12000]]
    assert (np.array(Image.open(tmp_path / "labels/0000.png")) == labels).all()
