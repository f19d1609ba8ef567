"""The committed clip of rendered rooms: `models/clip` is what its README says."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from sequences import Sequence

from nunet_models.classes import CLASSES_13, IGNORE

CLIP = Path(__file__).parents[2] / "clip"
SEQUENCE = Sequence(CLIP)
IDS = SEQUENCE.ids
SIZE = (640, 480)
MAX_BYTES = 4_000_000
# Each room ends within 7 m, and the camera keeps away from things.
NEAREST_MM, FARTHEST_MM = 400, 7000


def test_three_rooms_of_eight_images_each_with_depth_labels_and_a_pose():
    assert Counter(identity.rsplit("_", 1)[0] for identity in IDS) == dict.fromkeys(
        ("bedroom", "living", "study"), 8
    )
    for folder in ("depth", "labels"):
        assert sorted(path.stem for path in (CLIP / folder).iterdir()) == IDS
    assert sorted(SEQUENCE.poses) == IDS


def test_the_clip_is_small():
    assert sum(path.stat().st_size for path in CLIP.rglob("*") if path.is_file()) <= MAX_BYTES


def test_the_camera_is_that_of_the_readme_s_command():
    known = SEQUENCE.camera
    numbers = ",".join(f"{known[name]:.3f}" for name in ("fx", "fy", "cx", "cy"))
    assert (known["width"], known["height"]) == SIZE
    assert f"--intrinsics {numbers}@640x480" in (CLIP / "README.md").read_text()
    assert tuple(known["classes"]) == CLASSES_13


@pytest.mark.parametrize("identity", IDS)
def test_an_image_its_depth_and_its_labels_are_of_one_size_and_plausible(identity):
    image = Image.open(CLIP / f"rgb/{identity}.jpg")
    depth = Image.open(CLIP / f"depth/{identity}.png")
    labels = Image.open(CLIP / f"labels/{identity}.png")
    assert image.size == depth.size == labels.size == SIZE
    assert (image.mode, depth.mode, labels.mode) == ("RGB", "I;16", "L")

    millimeters = np.array(depth)
    measured = millimeters[millimeters > 0]
    assert measured.size > 0.99 * millimeters.size
    assert measured.min() > NEAREST_MM and measured.max() < FARTHEST_MM

    classes = np.array(labels)
    assert set(np.unique(classes)) <= {*range(len(CLASSES_13)), IGNORE}
    assert (classes != IGNORE).mean() > 0.99
    assert len(np.unique(classes)) >= 7

    gray = np.array(image.convert("L"))
    assert 80 < gray.mean() < 160 and gray.std() > 30


def test_every_class_is_somewhere():
    seen = {int(label) for i in IDS for label in np.unique(Image.open(CLIP / f"labels/{i}.png"))}
    assert seen >= set(range(len(CLASSES_13)))


@pytest.mark.parametrize("room", ("bedroom", "living", "study"))
def test_depth_carried_by_the_poses_from_first_to_last_frame_meets_its_own(room):
    """Ray lengths instead of depth miss by 17 mm and more, a center 5 pixels off by 0.36 mm."""
    predicted, own = SEQUENCE.carried(f"{room}_00", f"{room}_07")
    error_m = np.abs(predicted - own)
    assert predicted.size > 0.8 * SIZE[0] * SIZE[1]
    # Two depths rounded to millimeters differ by 0.29 mm in the median, interpolated less.
    assert np.median(error_m) < 0.00032
    # The rest are places that something nearer hides from the other image.
    assert (error_m < 0.01).mean() > 0.97
