import numpy as np
import pytest
from rooms import CAMERA, plane_depth, write_list, write_set

from nunet_models.classes import IGNORE
from nunet_models.data.augment import Augmentation
from nunet_models.data.pairs import Pair
from nunet_models.data.sets.cameras import Pinhole
from nunet_models.data.sets.draw import WHOLE, Shapes, ViewRanges, drawn_view, sample, whole_view
from nunet_models.data.sets.entry import read_dataset_list
from nunet_models.data.sets.folder import CameraImage
from nunet_models.data.sets.mixture import Mixture, mixed_batches
from nunet_models.data.sets.view import View, coverage, rotation, seen
from nunet_models.zoo.spec import NYU_CAMERA, Camera

SIZE = (96, 128)
SAME = Camera(CAMERA.width, CAMERA.height, CAMERA.fx, CAMERA.fy)
PLAIN = ViewRanges(colors=Augmentation(), frame_chance=0.0)


def image_of(camera=CAMERA, window=None, depth=None):
    depth = plane_depth(camera).astype(np.float32) if depth is None else depth
    rgb = np.repeat((60 * depth)[..., None], 3, axis=2).clip(0, 255).astype(np.uint8)
    window = window or (0, 0, camera.height, camera.width)
    return CameraImage(Pair("x", rgb, depth, None), camera, window, "room")


@pytest.mark.parametrize(
    "view",
    [
        View((0, 0, 128, 96), roll=25),
        View((0, 0, 128, 96), pitch=-12),
        View((30, 20, 60, 45), roll=-30, pitch=10),
        View((10, 5, 100, 40)),
        View((-20, -15, 168, 126), pitch=20),
        View((30, 20, 60, 45), roll=20, pitch=8, flip=True),
    ],
)
def test_a_view_has_the_depth_that_a_camera_there_would_measure(view):
    found = seen(image_of(), view, size=SIZE)
    k = view.intrinsics(CAMERA, SIZE)
    camera = Pinhole(k[0, 0], k[1, 1], k[0, 2] - 0.5, k[1, 2] - 0.5, SIZE[1], SIZE[0])
    truth = plane_depth(camera, rotation(view.roll, view.pitch))
    truth = truth[:, ::-1] if view.flip else truth
    known = np.isfinite(found.depth_m)
    assert known.mean() > 0.4
    assert np.abs(found.depth_m[known] / truth[known] - 1).max() < 0.02


def test_a_roll_is_clockwise_and_a_pitch_upward():
    center = np.array([0.0, 0.0, 1.0])
    assert (rotation(0, 10) @ center)[1] < 0  # y points down
    right = rotation(10, 0) @ np.array([1.0, 0.0, 0.0])
    assert right[1] > 0


def test_colors_move_with_depth():
    found = seen(image_of(), View((20, 10, 80, 60), roll=15), size=SIZE)
    inner = seen(image_of(), View((20, 10, 80, 60), roll=15), size=SIZE)
    brightness = found.rgb[..., 0] / 60.0
    unturned = inner.depth_m * _factor(View((20, 10, 80, 60), roll=15))
    known = np.isfinite(unturned) & (found.rgb[..., 0] < 255)
    assert np.abs(brightness - unturned)[known].mean() < 0.03


def _factor(view):
    matrix = view.homography(CAMERA, SIZE)
    rows, columns = np.mgrid[: SIZE[0], : SIZE[1]] + 0.5
    return matrix[2, 0] * columns + matrix[2, 1] * rows + matrix[2, 2]


def test_without_augmentation_depth_is_scaled_as_nunetd_does():
    """nunetd multiplies by fx_input / fx_training, both at the network's width."""
    wide = Pinhole(320.0, 320.0, 319.5, 179.5, 640, 360)
    depth = np.full((360, 640), 3.0, np.float32)
    how = Shapes((96, 128), (96, 128), NYU_CAMERA)
    found = sample(image_of(wide, depth=depth), WHOLE, how=how, random=np.random.default_rng(0))
    scale = (320.0 / 640) / (NYU_CAMERA.fx / NYU_CAMERA.width)
    assert np.allclose(found.depth_m * scale, 3.0, rtol=1e-5)


def test_zooming_in_brings_a_wall_nearer_by_the_same_factor():
    depth = np.full((96, 128), 4.0, np.float32)
    ranges = ViewRanges(zoom=(2, 2), near_chance=0, whole_chance=0, turn_chance=0, wide_chance=0)
    how = Shapes(SIZE, SIZE, SAME)
    found = sample(image_of(depth=depth), ranges, how=how, random=np.random.default_rng(1))
    assert np.allclose(found.depth_m, 2.0, rtol=1e-5)


def test_a_patch_has_the_pixels_of_the_whole_view():
    depth = np.full((96, 128), 4.0, np.float32)
    how = Shapes.of_part(SIZE, 0.75, SAME)
    assert how.size == (64, 96)
    found = sample(image_of(depth=depth), WHOLE, how=how, random=np.random.default_rng(1))
    assert found.depth_m.shape == (64, 96)
    assert np.allclose(found.depth_m, 4.0, rtol=1e-5)


def test_the_frame_around_the_window_is_never_seen():
    depth = np.full((96, 128), 2.0, np.float32)
    image = image_of(depth=depth, window=(8, 8, 88, 120))
    image.pair.rgb[:] = 255
    image.pair.rgb[8:88, 8:120] = 50
    found = seen(image, whole_view(image), size=SIZE)
    assert (found.rgb == 50).all()
    assert np.isfinite(found.depth_m).all()
    outside = seen(image, View((0, 0, 128, 96), fill=7), size=SIZE)
    assert set(np.unique(outside.rgb)) == {7, 50}


def test_views_keep_most_of_the_image_and_reach_near_and_turned_ones():
    image = image_of()
    views = [drawn_view(image, PLAIN, SIZE, np.random.default_rng(i)) for i in range(300)]
    assert min(coverage(image, v) for v in views) > 0.65
    assert max(abs(v.roll) for v in views) > 20
    assert max(128 / v.crop[2] for v in views) > 3
    assert 0.15 < np.mean([v.roll != 0 for v in views]) < 0.6
    again = drawn_view(image, PLAIN, SIZE, np.random.default_rng(3))
    assert again == views[3]


def test_pixels_of_a_16_to_9_image_are_shown_square_or_stretched():
    wide = Pinhole(320.0, 320.0, 319.5, 179.5, 640, 360)
    depth = np.full((360, 640), 3.0, np.float32)
    image = image_of(wide, depth=depth)
    ranges = ViewRanges(whole_chance=1.0, turn_chance=0.0, wide_chance=0.0)
    ratios = set()
    for i in range(40):
        k = drawn_view(image, ranges, SIZE, np.random.default_rng(i)).intrinsics(wide, SIZE)
        ratios.add(round(k[1, 1] / k[0, 0], 3))
    assert ratios == {1.0, 1.333}


def test_labels_move_along_and_are_unknown_outside():
    image = image_of()
    labels = np.zeros(SIZE, np.uint8)
    labels[:, 64:] = 5
    pair = Pair("x", image.pair.rgb, image.pair.depth_m, labels)
    image = CameraImage(pair, CAMERA, image.window, "room")
    found = seen(image, View((-64, 0, 256, 96), flip=True), size=SIZE).labels
    assert (found[:, :32] == IGNORE).all()
    assert (found[:, 33:63] == 5).all()
    assert (found[:, 65:95] == 0).all()


@pytest.fixture
def mixture(tmp_path):
    write_set(tmp_path / "a")
    return Mixture(read_dataset_list(write_list(tmp_path / "l.toml", 'name = "a"\nroot = "a"')))


def batches(mixture, **more):
    how = Shapes(SIZE, SIZE, SAME)
    options = {"count": 8, "batch": 2, "seed": 1, "epoch": 0, "workers": 0} | more
    return list(mixed_batches(mixture, ViewRanges(), how=how, **options))


def test_a_resumed_epoch_draws_the_same_batches(mixture):
    whole, rest = batches(mixture), batches(mixture, first=2, workers=1)
    assert len(whole) == 4
    assert len(rest) == 2
    for one, other in zip(whole[2:], rest, strict=True):
        assert (one.rgb == other.rgb).all()
        assert np.array_equal(one.depth_m, other.depth_m, equal_nan=True)


def test_another_epoch_and_another_seed_draw_others(mixture):
    first = batches(mixture)[0].rgb
    assert not (first == batches(mixture, epoch=1)[0].rgb).all()
    assert not (first == batches(mixture, seed=2)[0].rgb).all()
