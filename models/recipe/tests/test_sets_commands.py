import json

import numpy as np
import pytest
import torch
from rooms import CAMERA, plane_depth, write_list, write_set
from runs import TINY, rows

from nunet_models.cli import main
from nunet_models.data.sets.cameras import Pinhole
from nunet_models.data.sets.entry import read_dataset_list
from nunet_models.data.sets.folder import CameraSet
from nunet_models.evaluation.compare import Prediction
from nunet_models.evaluation.robustness import border_errors, noise_change, roughness
from nunet_models.evaluation.sets import errors, focal_factor, set_metrics
from nunet_models.evaluation.sets_command import MEAN, mean_over_sets, table
from nunet_models.losses import scale_shift_invariant
from nunet_models.zoo.checkpoint import Checkpoint
from nunet_models.zoo.spec import NYU_CAMERA, Camera

SAME = Camera(CAMERA.width, CAMERA.height, CAMERA.fx, CAMERA.fy)


@pytest.fixture
def sets(tmp_path):
    write_set(tmp_path / "a")
    wide = Pinhole(60.0, 60.0, 63.5, 31.5, 128, 64)
    write_set(tmp_path / "b", camera=wide, scenes=("shop", "shop", "yard"))
    return write_list(
        tmp_path / "list.toml",
        'name = "a"\nroot = "a"',
        'name = "b"\nroot = "b"\nscenes = ["shop"]\ngrowing = true',
        'name = "b"\nroot = "b"\nuse = "val"\nscenes = ["yard"]',
    )


def train(sets, run, *more, epochs=2, component="segmentation"):
    return main(
        [
            *("train", "--run", str(run), "--sets", str(sets), "--component", component),
            *("--backbone", "tiny", "--inner-size", "96", "128", "--epochs", str(epochs)),
            *("--batch", "2", "--threads", "1", "--workers", "0", "--quiet", *more),
        ]
    )


def test_both_components_train_on_images_of_two_sizes_and_cameras(sets, tmp_path):
    assert train(sets, tmp_path / "seg", "--epoch-images", "4") == 0
    start = ("--architecture", "wnet_c", "--plug", f"segmentation={tmp_path / 'seg/best.pt'}")
    assert train(sets, tmp_path / "depth", *start, "--patch", "0.7", component="depth") == 0
    metrics = rows(tmp_path / "depth", "epochs.csv")[-1]
    assert {"abs_rel", "delta1", "b.abs_rel"} <= set(metrics)
    data = Checkpoint.load(tmp_path / "depth/best.pt").provenance["depth"]["data"]
    assert [(s["set"], s["images"], s["rooms"]) for s in data["train_sets"]] == [
        ("a", 4, 2),
        ("b", 2, 1),
    ]


def test_an_interrupted_run_goes_on_to_the_same_weights(sets, tmp_path):
    unet = ("--architecture", "unet")
    whole, halves = tmp_path / "whole", tmp_path / "halves"
    assert train(sets, whole, *unet, component="depth") == 0
    cut = train(sets, halves, *unet, "--minutes", "0.000001", component="depth")
    assert cut == 0
    assert Checkpoint.load(halves / "last.pt").progress["step"] == 1
    assert train(sets, halves, *unet, "--resume", component="depth") == 0
    one, other = (Checkpoint.load(run / "last.pt").weights for run in (whole, halves))
    assert all(torch.equal(one[name], other[name]) for name in one)


def test_a_run_is_resumed_with_its_own_sets_alone_but_those_that_grow(sets, tmp_path, capsys):
    unet, run = ("--architecture", "unet"), tmp_path / "run"
    assert train(sets, run, *unet, epochs=1, component="depth") == 0
    write_set(tmp_path / "b", scenes=("shop", "shop", "yard", "shop"))  # grown meanwhile
    assert train(sets, run, *unet, "--resume", epochs=2, component="depth") == 0
    write_set(tmp_path / "c", scenes=("roof", "roof"))
    edited = write_list(
        tmp_path / "other.toml", 'name = "c"\nroot = "c"', sets.read_text()[len("[[set]]") :]
    )
    assert train(edited, run, *unet, "--resume", epochs=3, component="depth") == 1
    assert "another set `c`" in capsys.readouterr().err


def test_a_set_without_labels_cannot_train_segmentation_alone(sets, tmp_path, capsys):
    for name in ("a", "b"):
        for path in (tmp_path / name / "labels").iterdir():
            path.unlink()
        (tmp_path / name / "labels").rmdir()
    assert train(sets, tmp_path / "run") == 1
    assert "the training data has no labels" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("more", "what"),
    [
        (("--data", "x"), "`--data` cannot be combined with `--sets"),
        (("--cache", "x"), "`--cache` cannot be combined with `--sets"),
        (("--train-ids", "x"), "`--train-ids` cannot be combined with `--sets"),
        (("--depth-offset", "0.5"), "`--depth-offset` cannot be combined with `--sets"),
        (("--patch", "0"), "`--patch 0.0`"),
    ],
)
def test_options_of_one_folder_and_of_a_list_do_not_mix(sets, tmp_path, capsys, more, what):
    assert train(sets, tmp_path / "run", *more) == 2
    assert what in capsys.readouterr().err


def test_one_of_a_folder_and_a_list_is_needed(tmp_path, capsys):
    assert main(["train", "--run", str(tmp_path), "--component", "depth", "--epochs", "1"]) == 2
    assert "`--data` is missing; hint: pass it, or `--sets LIST`" in capsys.readouterr().err


@pytest.mark.parametrize("more", [("--fx", "500"), ("--clip",), ("--protocol", "eigen")])
def test_options_of_one_folder_are_refused_with_a_list_of_sets(sets, capsys, more):
    assert main(["evaluate", "--model", str(TINY), "--sets", str(sets), *more]) == 2
    assert f"`{more[0]}` cannot be combined with `--sets" in capsys.readouterr().err


def test_evaluate_measures_every_set_and_their_mean(sets, capsys):
    assert main(["evaluate", "--model", str(TINY), "--sets", str(sets)]) == 0
    printed = capsys.readouterr()
    found = json.loads(printed.out)["sets"]
    assert set(found) == {"b", MEAN}
    wanted = {"abs_rel", "delta1", "abs_rel_median", "noise_mm", "roughness_mm", "turn20_ratio"}
    assert wanted | {"border_left_ratio", "baseline_abs_rel"} <= set(found["b"])
    assert found["b"]["images"] == 1
    assert "| b | 1 |" in printed.err


def figures_of(tmp_path, answer, **more):
    write_set(tmp_path / "a", scenes=("hall", "hall", "hall", "attic"))
    entry = read_dataset_list(write_list(tmp_path / "l.toml", 'name = "a"\nroot = "a"'))[0]
    return set_metrics(CameraSet(entry), lambda rgb: Prediction(answer(rgb), None), **more)


def test_the_truth_itself_is_without_error_whatever_the_camera(tmp_path):
    truth = plane_depth(CAMERA)
    factor = focal_factor(CAMERA, NYU_CAMERA)
    found = figures_of(tmp_path, lambda _: truth / factor, training=NYU_CAMERA)
    assert found["abs_rel"] < 1e-3  # depth is stored in millimeters
    assert found["delta1"] == 1.0
    half = figures_of(tmp_path, lambda _: 0.5 * truth / factor, training=NYU_CAMERA)
    assert half["abs_rel"] == pytest.approx(0.5, abs=1e-3)
    assert half["abs_rel_median"] < 1e-3
    assert half["factor"] == pytest.approx(2.0, rel=1e-3)


def test_scenes_weigh_alike_whatever_their_images(tmp_path):
    calls = iter([1.0, 1.0, 1.0, 3.0])

    def answer(rgb):
        return np.full(rgb.shape[:2], next(calls), np.float32)

    first = figures_of(tmp_path, answer, training=SAME)["abs_rel"]
    one = figures_of(tmp_path, lambda rgb: np.full(rgb.shape[:2], 1.0), training=SAME)["abs_rel"]
    three = figures_of(tmp_path, lambda rgb: np.full(rgb.shape[:2], 3.0), training=SAME)["abs_rel"]
    assert first == pytest.approx((one + three) / 2)


def test_pixels_without_depth_leave_noise_and_roughness_of_the_others(tmp_path):
    def answer(rgb):
        depth = np.full(rgb.shape[:2], 2.0, np.float32)
        depth[0, :3] = np.nan
        return depth

    found = figures_of(tmp_path, answer, training=SAME, robustness=True)
    assert (found["noise_mm"], found["roughness_mm"]) == (0.0, 0.0)
    assert np.isnan(roughness(np.full((6, 6), np.nan)))


def test_border_errors_tell_each_side_apart():
    truth = np.full((60, 80), 2.0)
    depth = truth.copy()
    depth[:, :2] *= 0.75
    depth[:, 12:15] *= 1.05
    depth[:, -1] = np.nan
    truth[-5:] = np.nan
    found = border_errors(depth, truth)
    assert found["border_left"] == pytest.approx(0.25)
    assert found["inside_left"] == pytest.approx(0.05 * 3 / 10)
    assert found["border_right"] == 0
    assert np.isnan(found["border_bottom"])


def test_noise_is_one_gray_level_and_roughness_is_grain():
    rgb = np.full((20, 20, 3), 255, np.uint8)
    assert set(np.unique(noise_change(rgb, 1))) == {254, 255}
    ramp = np.linspace(1, 2, 40)[None].repeat(40, axis=0)
    grain = np.random.default_rng(0).normal(0, 0.02, ramp.shape)
    assert roughness(ramp + grain) > 5 * roughness(ramp)


def test_errors_of_an_image_without_truth_are_none():
    assert errors(np.ones((2, 2)), np.full((2, 2), np.nan)) == {}
    found = mean_over_sets([{"images": 2, "scenes": 1, "abs_rel": 0.2}, {"images": 1, "scenes": 1}])
    assert found == {"images": 3, "scenes": 2, "abs_rel": 0.2}
    assert "| x | 3 | 0.200 |" in table({"x": found})


def test_the_scale_shift_invariant_loss_does_not_see_scale_and_shift():
    random = torch.Generator().manual_seed(0)
    truth = 1 + 3 * torch.rand(2, 1, 24, 32, generator=random)
    truth[0, 0, :4] = torch.nan
    other = 1 / (0.5 / truth.nan_to_num(2.0) + 0.1)
    assert scale_shift_invariant(other.log(), truth.log()) < 1e-5
    assert scale_shift_invariant(truth.nan_to_num(2.0).flip(-1).log(), truth.log()) > 0.5
    nothing = torch.zeros(1, 1, 4, 4, requires_grad=True)
    loss = scale_shift_invariant(nothing, torch.full((1, 1, 4, 4), torch.nan))
    loss.backward()
    assert loss.item() == 0
    assert nothing.grad.abs().sum() == 0
