"""Normals and objectness: truth against values worked out by hand, losses and metrics."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from nunet_models.classes import CLASSES_13, IGNORE
from nunet_models.data.batches import Batch
from nunet_models.tasks.inner import INNER_TASKS, truth_of
from nunet_models.tasks.normals import REACH, surface_normals
from nunet_models.tasks.objectness import box_maps
from nunet_models.training import validate_inner as validate_inner_module
from nunet_models.zoo import Camera, graph_spec

SIZE = (24, 32)
FOCAL = (28.0, 26.0)
SPEC = graph_spec(
    "nunet3_c",
    tasks=("segmentation", "normals", "depth"),
    input_size=SIZE,
    inner_size=SIZE,
    camera=Camera(width=64, height=48, fx=56.0, fy=52.0),
)
FLOOR, CHAIR, TABLE, WINDOW = (CLASSES_13.index(n) for n in ("floor", "chair", "table", "window"))


def plane(normal, distance=2.0, size=SIZE):
    """Depth `[1, 1, h, w]` of the plane at `distance` along its unit normal toward the camera."""
    v, u = np.mgrid[: size[0], : size[1]]
    x, y = (u - (size[1] - 1) / 2) / FOCAL[0], (v - (size[0] - 1) / 2) / FOCAL[1]
    facing = -(normal[0] * x + normal[1] * y + normal[2])
    return torch.from_numpy((distance / facing).astype(np.float32))[None, None]


def batch_of(depth_m=None, labels=None):
    depth_m = torch.full((1, 1, *SIZE), torch.nan) if depth_m is None else depth_m
    labels = np.full(SIZE, IGNORE) if labels is None else labels
    return Batch(None, depth_m, torch.from_numpy(labels.astype(np.int64))[None])


def degrees(found, normal):
    cosine = (found * torch.tensor(normal).reshape(1, 3, 1, 1)).sum(1)
    return cosine.clamp(-1, 1).arccos().rad2deg()


@pytest.mark.parametrize(
    "normal", [(0.0, 0.0, -1.0), (0.6, 0.0, -0.8), (-0.48, 0.36, -0.8), (0.0, -0.8, -0.6)]
)
def test_a_plane_has_its_own_normal_at_every_pixel(normal):
    found = surface_normals(plane(normal), FOCAL)
    error = degrees(found, normal)
    known = error.isfinite()
    assert known.float().mean() > 0.8 and error[known].max() < 0.2
    assert torch.allclose(found.norm(dim=1)[known], torch.ones(1))


def test_surfaces_on_both_sides_of_an_edge_do_not_mix():
    tilted = (0.28, 0.0, -0.96)
    depth = plane((0.0, 0.0, -1.0), distance=4.0)
    depth[..., 16:] = plane(tilted, distance=1.0)[..., 16:]
    found = surface_normals(depth, FOCAL)
    assert degrees(found, (0.0, 0.0, -1.0))[..., :16].max() < 0.2
    assert degrees(found, tilted)[..., 16:].max() < 0.2


def test_pixels_without_depth_or_enough_neighbors_have_no_normal():
    depth = plane((0.0, 0.0, -1.0))
    depth[..., 10, 10] = torch.nan
    depth[..., 12, :] = 9.0  # one row of another surface: 7 neighbors
    known = surface_normals(depth, FOCAL).isfinite().all(1)[0]
    assert not known[10, 10] and not known[12].any()
    assert int(known.sum()) == known.numel() - 1 - SIZE[1]


def test_neighbors_of_a_single_row_have_no_normal(monkeypatch):
    monkeypatch.setattr("nunet_models.tasks.normals.LEAST_NEIGHBORS", 2 * REACH)
    depth = torch.full((1, 1, *SIZE), torch.nan)
    depth[..., 12, :] = 2.0
    assert not surface_normals(depth, FOCAL).isfinite().any()


def test_normals_of_depth_in_steps_of_four_centimeters_are_within_some_degrees():
    """NYU Depth V2's 8-bit depth has such steps."""
    normal, size = (-0.36, 0.48, -0.8), (60, 80)
    depth = (plane(normal, size=size) / 0.04).round() * 0.04
    error = degrees(surface_normals(depth, FOCAL), normal)
    assert error[error.isfinite()].mean() < 6.0


def test_the_loss_of_normals_is_half_the_squared_distance_and_1_minus_cosine_of_unit_vectors():
    batch = batch_of(plane((0.0, 0.0, -1.0)))
    raw = torch.tensor([0.6, 0.0, -0.8]).reshape(1, 3, 1, 1).expand(1, 3, *SIZE)
    loss = INNER_TASKS["normals"].loss(raw, batch, SPEC)
    assert loss.item() == pytest.approx(1 - 0.8, rel=1e-4)
    longer = INNER_TASKS["normals"].loss(2 * raw, batch, SPEC)
    assert longer.item() == pytest.approx((1.2**2 + 0.6**2) / 2, rel=1e-4)


def test_normals_take_the_camera_at_the_inner_size():
    """FOCAL is that of SPEC's camera, at half its size."""
    normal = (-0.48, 0.36, -0.8)
    raw = torch.tensor(normal).reshape(1, 3, 1, 1).expand(1, 3, *SIZE)
    assert INNER_TASKS["normals"].loss(raw, batch_of(plane(normal)), SPEC).item() < 1e-4


def test_angular_error_is_pooled_over_pixels_and_does_not_depend_on_length():
    metrics = INNER_TASKS["normals"].metrics(SPEC)
    assert metrics.values() == {}
    for vector in ((0.0, 0.0, -3.0), (0.0, math.sin(0.35), -math.cos(0.35))):
        raw = torch.tensor(vector).reshape(1, 3, 1, 1).expand(1, 3, *SIZE)
        metrics.add(raw, batch_of(plane((0.0, 0.0, -1.0))))
    values = metrics.values()
    angle = math.degrees(0.35)  # 20.05
    assert values["angle_deg"] == pytest.approx(angle / 2, abs=0.02)
    assert [values[f"within_{n}"] for n in (11, 22, 30)] == [0.5, 1.0, 1.0]
    assert INNER_TASKS["normals"].score(values) == -values["angle_deg"]


def labels_with_things():
    labels = np.full(SIZE, FLOOR)
    labels[2:6, 3:11] = CHAIR
    labels[4:6, 5:9] = FLOOR  # a gap below its seat is inside of the box
    labels[6:12, 11:15] = CHAIR  # touches the first one by a corner
    labels[15:20, 20:30] = TABLE
    labels[0:3, 20:30] = WINDOW
    labels[22, 1] = TABLE  # one pixel of 768: less than 0.2 %
    return labels


def things():
    return [CLASSES_13.index(n) for n in ("chair", "table", "sofa")]


def test_boxes_bound_the_connected_components_of_things():
    labels = labels_with_things()
    inside, center = box_maps(labels, things())
    expected = np.zeros(SIZE)
    expected[2:12, 3:15] = 1.0  # both chairs: corners connect
    expected[15:20, 20:30] = 1.0
    assert np.array_equal(inside, expected)
    assert center[17, 24] == center[17, 25] == center.max() and center[17, 24] > 0.9
    # a standard deviation is a sixth of the side: 5 / 6 rows, 10 / 6 columns
    by_hand = math.exp(-0.5 * ((2 * 6 / 5) ** 2 + (4.5 * 6 / 10) ** 2))
    assert center[15, 20] == pytest.approx(by_hand, rel=1e-4)
    assert not center[inside == 0.0].any()


def test_boxes_that_overlap_keep_both_centers():
    labels = np.full(SIZE, FLOOR)
    labels[2:20, 2:30] = TABLE
    labels[2:7, 2:7] = CHAIR
    _, center = box_maps(labels, things())
    assert center[4, 4] == 1.0 and center[10, 15] > 0.9


def test_pixels_without_a_label_are_unknown_outside_of_boxes_alone():
    labels = labels_with_things()
    labels[4:6, 5:9] = IGNORE
    labels[22:, 20:] = IGNORE
    maps = box_maps(labels, things())
    unknown = np.isnan(maps)
    assert np.array_equal(unknown[0], unknown[1])
    assert unknown[0].sum() == 2 * 12 and unknown[0][22:, 20:].all()


def test_the_loss_of_objectness_is_the_cross_entropy_of_known_pixels():
    labels = labels_with_things()
    labels[22:] = IGNORE
    truth = box_maps(labels, things())[None]
    raw = torch.zeros(1, 2, *SIZE)
    raw[:, :, 22:] = 1e3  # unknown
    loss = INNER_TASKS["objectness"].loss(raw, batch_of(labels=labels), SPEC)
    assert loss.item() == pytest.approx(math.log(2), rel=1e-5)
    right = torch.from_numpy(truth).nan_to_num(0.5).logit(eps=1e-6)
    assert INNER_TASKS["objectness"].loss(right, batch_of(labels=labels), SPEC) < 0.1


def test_images_without_truth_have_no_loss_and_no_metrics():
    for name, channels in (("normals", 3), ("objectness", 2)):
        raw = torch.randn(1, channels, *SIZE, requires_grad=True)
        loss = INNER_TASKS[name].loss(raw, batch_of(), SPEC)
        loss.backward()
        assert loss.item() == 0.0 and not raw.grad.any()
        metrics = INNER_TASKS[name].metrics(SPEC)
        metrics.add(raw.detach(), batch_of())
        assert metrics.values() == {}


def test_objectness_is_measured_by_the_overlap_of_boxes():
    labels = labels_with_things()
    inside = box_maps(labels, things())[0] == 1.0
    assert inside.sum() == 120 + 50
    raw = torch.full((1, 2, *SIZE), -1.0)
    raw[0, 0, 2:12, 3:15] = 1.0  # the chairs alone
    raw[0, 0, 21:23, 0:5] = 1.0  # and 10 pixels of the floor
    metrics = INNER_TASKS["objectness"].metrics(SPEC)
    metrics.add(raw, batch_of(labels=labels))
    values = metrics.values()
    outside = 768 - 170
    assert values["box_iou"] == pytest.approx(120 / 180)
    assert values["box_miou"] == pytest.approx((120 / 180 + (outside - 10) / (outside + 50)) / 2)
    assert values["box_share"] == pytest.approx(170 / 768)
    assert INNER_TASKS["objectness"].score(values) == values["box_miou"]


def test_windows_and_what_surrounds_things_are_no_things():
    stuff = np.repeat([CLASSES_13.index(n) for n in ("ceiling", "wall", "window", "floor")], 6)
    batch = batch_of(labels=stuff[:, None] * np.ones(SIZE[1], int))
    metrics = INNER_TASKS["objectness"].metrics(SPEC)
    metrics.add(torch.full((1, 2, *SIZE), -1.0), batch)
    assert metrics.values() == {"box_miou": 1.0, "box_iou": 0.0, "box_share": 0.0}


def test_each_task_names_its_truth():
    tasks = ("segmentation", "normals", "objectness", "depth")
    assert [truth_of(task) for task in tasks] == ["labels", "depth", "labels", "depth"]


def test_what_is_shown_is_between_0_and_1():
    toward = torch.tensor([0.0, 0.0, -5.0]).reshape(1, 3, 1, 1)
    assert INNER_TASKS["normals"].shown(toward).item() == 1.0
    assert INNER_TASKS["normals"].shown(-toward).item() == 0.0
    assert INNER_TASKS["objectness"].shown(torch.zeros(1, 2, 1, 1)).item() == 0.5


def test_metrics_of_several_images_are_pooled_over_their_pixels():
    normal = (0.0, 0.0, -1.0)
    whole, part = plane(normal), plane(normal)
    part[..., : SIZE[1] // 2] = torch.nan
    right = torch.tensor(normal).reshape(1, 3, 1, 1).expand(1, 3, *SIZE)
    graph = SimpleNamespace(spec=SPEC, confidence=None, components=[None] * 3)
    answers = iter([right, right.roll(1, dims=1)])  # the second one is wrong by 90 degrees
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(validate_inner_module, "run_components", lambda *_: (next(answers), None))
        batches = [Batch(torch.zeros(1, 3, *SIZE), d, None) for d in (whole, part)]
        found = validate_inner_module.validate_inner(graph, batches, component=1, bf16=False)
    pixels = [int(surface_normals(d, FOCAL).isfinite().all(dim=1).sum()) for d in (whole, part)]
    assert pixels[0] > 1.5 * pixels[1] > 0
    assert found["angle_deg"] == pytest.approx(90.0 * pixels[1] / sum(pixels), abs=0.1)
