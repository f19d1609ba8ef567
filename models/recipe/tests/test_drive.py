"""The committed drive: `models/drive` is what its README says."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from sequences import Sequence

from nunet_models.classes import CLASSES_13, IGNORE

DRIVE = Sequence(Path(__file__).parents[2] / "drive")
IDS = DRIVE.ids
SIZE = (320, 240)
SECONDS = (20, 30)
MAX_BYTES = 12_000_000
HEIGHT_M = (0.24, 0.26)
SPEED = 0.6


def test_every_image_has_depth_labels_and_a_pose():
    known = DRIVE.camera
    assert (known["width"], known["height"]) == SIZE
    assert tuple(known["classes"]) == CLASSES_13
    assert SECONDS[0] <= len(IDS) / known["frames_per_second"] <= SECONDS[1]
    assert [f"{frame:04d}" for frame in range(len(IDS))] == IDS
    for folder in ("depth", "labels"):
        assert sorted(path.stem for path in (DRIVE.folder / folder).iterdir()) == IDS
    assert sorted(DRIVE.poses) == IDS


def test_the_drive_is_small():
    files = [path for path in DRIVE.folder.rglob("*") if path.is_file()]
    assert sum(path.stat().st_size for path in files) <= MAX_BYTES


@pytest.mark.parametrize("identity", IDS[::10])
def test_an_image_its_depth_and_its_labels_are_of_one_size_and_plausible(identity):
    image = Image.open(DRIVE.folder / f"rgb/{identity}.jpg")
    depth_m, labels = DRIVE.depth_m(identity), DRIVE.labels(identity)
    assert image.size == depth_m.shape[::-1] == labels.shape[::-1] == SIZE
    assert (depth_m > 0).mean() > 0.99
    assert depth_m[depth_m > 0].min() > 0.15 and depth_m.max() < 16
    assert set(np.unique(labels)) <= {*range(len(CLASSES_13)), IGNORE}
    assert (labels != IGNORE).mean() > 0.99
    gray = np.array(image.convert("L"))
    assert 60 < gray.mean() < 200 and gray.std() > 15


def test_the_robot_drives_at_constant_speed_and_height():
    poses = np.stack([DRIVE.poses[identity] for identity in IDS])
    heights = poses[:, 2, 3]
    assert HEIGHT_M[0] <= heights.min() and heights.max() <= HEIGHT_M[1]
    steps = np.linalg.norm(np.diff(poses[:, :2, 3], axis=0), axis=1)
    assert steps * DRIVE.camera["frames_per_second"] == pytest.approx(SPEED, abs=0.02)
    # The optical axis points up a little, always.
    pitch_deg = np.degrees(np.arcsin(poses[:, 2, 2]))
    assert pitch_deg.min() > 3 and pitch_deg.max() < 5


def test_obstacles_and_rooms_are_on_the_way():
    seen = {int(label) for identity in IDS for label in np.unique(DRIVE.labels(identity))}
    names = {CLASSES_13[label] for label in seen if label != IGNORE}
    assert names >= {"chair", "table", "furniture", "objects", "wall", "floor", "picture"}
    nearest = [np.percentile(DRIVE.depth_m(identity)[:140], 2) for identity in IDS]
    assert min(nearest) < 0.8


@pytest.mark.parametrize("start", range(0, 220, 20))
def test_depth_carried_by_the_poses_meets_its_own_half_a_second_later(start):
    predicted, own = DRIVE.carried(IDS[start], IDS[start + 5])
    error_m = np.abs(predicted - own)
    assert predicted.size > 0.35 * SIZE[0] * SIZE[1]
    # Two depths rounded to millimeters differ by 0.29 mm in the median, interpolated ones by less.
    assert np.median(error_m) < 0.0006
