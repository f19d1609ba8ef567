"""Confidence: what it means, the head's training, and its way into model files."""

import json
import math
import tomllib
from dataclasses import replace

import numpy as np
import onnx
import pytest
import torch
from rooms import write_list, write_set
from runs import TINY, rows, train

from nunet_models.cli import main
from nunet_models.errors import ConfigError
from nunet_models.evaluation.sparsification import METRICS, sparsification
from nunet_models.export import measure
from nunet_models.export.collections import TINY_CONFIDENCE, tiny_confidence, tiny_spec
from nunet_models.export.model_file import Provenance, export_fused, export_staged
from nunet_models.export.onnx_file import run
from nunet_models.export.untrained import untrained_graph
from nunet_models.losses import expected_error
from nunet_models.quantization.static import heads
from nunet_models.zoo import SerialGraph
from nunet_models.zoo.checkpoint import Checkpoint
from nunet_models.zoo.confidence import CONFIDENCE, confidence_of
from nunet_models.zoo.deploy import FusedModel, confidence_bytes


def with_head(architecture="wnet_c"):
    return replace(tiny_spec(architecture), confidence=True)


@pytest.fixture(scope="module")
def graph():
    return untrained_graph(with_head(), seed=3)


@pytest.fixture(scope="module")
def files(graph, tmp_path_factory):
    folder = tmp_path_factory.mktemp("confidence")
    export_fused(graph, folder / "fused.onnx", Provenance())
    export_staged(graph, folder / "staged.toml", Provenance())
    return folder


@pytest.fixture
def trained(dataset, tmp_path):
    """A trained graph without a head."""
    first, second = tmp_path / "seg", tmp_path / "depth"
    assert train(dataset, first, epochs=1) == 0
    start = ("--start", str(first / "best.pt"))
    assert train(dataset, second, *start, component="depth", epochs=1) == 0
    return second / "best.pt"


# what it means


def test_a_relative_error_has_the_documented_confidence():
    log_error = torch.tensor([[0.01, 0.1], [0.3, 1.0]]).log()[None, None]
    levels = confidence_bytes(log_error, (2, 2))
    assert levels.dtype == torch.uint8
    assert levels.tolist() == [[[249, 203], [128, 26]]]
    assert confidence_of(torch.tensor(-math.inf)) == 1.0


def test_the_loss_is_least_at_the_mean_error_around_the_image_s_own_scale():
    truth = torch.tensor([1.0, 1.0, 1.0, 1.0, math.nan]).reshape(1, 1, 1, 5)
    # errors of scale do not count: the median of the four is 0.5
    raw = (0.5 + torch.tensor([-0.2, 0.0, 0.1, 0.5, 9.0])).reshape(1, 1, 1, 5).requires_grad_()
    s = torch.full((1, 1, 1, 5), math.log(0.2), requires_grad=True)  # mean of 0.2, 0, 0.1, 0.5
    loss = expected_error(s, raw, truth)
    loss.backward()
    assert loss.item() == pytest.approx(1 + math.log(0.2))
    assert s.grad.sum().item() == pytest.approx(0.0, abs=1e-6)
    assert raw.grad is None, "the network does not learn from it"
    for other in (0.15, 0.25):
        assert expected_error(torch.full_like(s, math.log(other)), raw, truth) > loss


def test_the_loss_of_images_without_truth_is_zero():
    s = torch.zeros(2, 1, 2, 2, requires_grad=True)
    loss = expected_error(s, torch.zeros(2, 1, 4, 4), torch.full((2, 1, 4, 4), math.nan))
    loss.backward()
    assert loss.item() == 0.0 and s.grad.abs().sum() == 0.0


def test_sparsification_of_numbers_worked_out_by_hand():
    error = np.array([0.4, 0.1, 0.2, 0.3])
    found = sparsification(error, np.array([0, 255, 100, 100], np.uint8))
    assert set(found) == set(METRICS)
    assert found["certain_50"] == pytest.approx((0.1 + 0.25) / 2), "a tie counts as its mean"
    assert found["certain_75"] == pytest.approx(0.2)
    assert found["certain_90"] == pytest.approx(0.25)
    assert (found["oracle_50"], found["oracle_75"]) == pytest.approx((0.15, 0.2))
    # of 5 to 100 %: 1 pixel at 5 to 35, 2 at 40 to 60, 3 at 65 to 85, 4 above
    assert found["area"] == pytest.approx(5 * 0.025 / 20)
    assert found["area_random"] == pytest.approx((7 * 0.15 + 5 * 0.1 + 5 * 0.05) / 20)


def test_a_perfect_confidence_is_the_oracle_and_a_constant_one_is_random():
    error = np.random.default_rng(0).random(1000)
    best = sparsification(error, (250 - 200 * np.ceil(error * 256) / 256).astype(np.uint8))
    assert best["area"] < 0.01 * best["area_random"]
    same = sparsification(error, np.full(1000, 7, np.uint8))
    assert same["area"] == pytest.approx(same["area_random"])
    assert sparsification(error[:0], np.zeros(0, np.uint8)) == {}


# the head


def test_depth_is_the_same_with_a_head_and_confidence_varies(graph):
    image = torch.randn(2, 3, 96, 128)
    with torch.no_grad():
        outputs, log_error = graph.with_confidence(image)
        plain = graph(image)
    assert all(torch.equal(one, other) for one, other in zip(outputs, plain, strict=True))
    assert log_error.shape == (2, 1, 24, 32)
    assert log_error.std() > 0.1


@pytest.mark.parametrize("architecture", ["unet_cnn", "wnet_c_lstm"])
def test_a_graph_whose_decoder_cannot_be_read_has_no_head(architecture):
    with pytest.raises(ConfigError, match="cannot have a confidence head"):
        with_head(architecture)


def test_a_spec_of_before_has_no_head():
    values = tiny_spec("wnet_c").to_json()
    del values["confidence"]
    assert SerialGraph(type(tiny_spec("wnet_c")).from_json(values)).confidence is None


def test_the_head_learns_alone_and_resumes_to_the_same_weights(dataset, tmp_path, trained):
    whole, halved = tmp_path / "whole", tmp_path / "halved"
    how = ("--start", str(trained), "--lr", "0.01")
    assert train(dataset, whole, *how, component=CONFIDENCE, epochs=6) == 0
    cut = ("--minutes", "1e-9")
    assert train(dataset, halved, *how, *cut, component=CONFIDENCE, epochs=6) == 0
    assert train(dataset, halved, *how, "--resume", component=CONFIDENCE, epochs=6) == 0
    before = Checkpoint.load(trained)
    after, again = (Checkpoint.load(run / "last.pt") for run in (whole, halved))
    assert all(torch.equal(after.weights[name], value) for name, value in before.weights.items())
    assert all(torch.equal(again.weights[name], value) for name, value in after.weights.items())
    assert after.spec.confidence and after.untrained_component() is None
    metrics = rows(whole, "epochs.csv")
    assert metrics[0]["rmse"] == metrics[-1]["rmse"], "depth does not change"
    assert np.load(whole / "evolution" / "0006.npy").dtype == np.uint8


def test_the_head_finds_the_pixels_with_errors(dataset, tmp_path, trained):
    how = ("--start", str(trained), "--lr", "0.03", "--ema", "0", "--augmentation", "none")
    more = ("--validate-every", "40", "--warmup", "0", "--weight-decay", "0")
    assert train(dataset, tmp_path / "run", *how, *more, component=CONFIDENCE, epochs=40) == 0
    (metrics,) = rows(tmp_path / "run", "epochs.csv")
    assert float(metrics["area_median"]) < 0.8 * float(metrics["area_random_median"])


def test_the_head_trains_on_a_dataset_list_and_reports_each_set(dataset, tmp_path, trained):
    write_set(tmp_path / "a")
    write_set(tmp_path / "b", scenes=("yard",))
    sets = write_list(
        tmp_path / "list.toml",
        'name = "a"\nroot = "a"',
        'name = "b"\nroot = "b"\nuse = "val"',
    )
    code = main(
        [
            *("train", "--run", str(tmp_path / "run"), "--sets", str(sets), "--quiet"),
            *("--start", str(trained), "--component", CONFIDENCE, "--epochs", "1"),
            *("--batch", "2", "--threads", "1", "--workers", "0"),
        ]
    )
    assert code == 0
    (metrics,) = rows(tmp_path / "run", "epochs.csv")
    assert {"area", "certain_50", "b.certain_50", "b.oracle_90"} <= set(metrics)


@pytest.mark.parametrize(
    ("more", "word"),
    [
        ((), "`--component confidence` needs a trained network; hint: `--start CHECKPOINT`"),
        (("--start", "x.pt", "--dropout", "0.1"), "`--dropout` does not apply to"),
        (("--start", "x.pt", "--compile"), "`--compile` does not apply to"),
        (("--start", "x.pt", "--unfrozen"), "`--unfrozen` does not apply to"),
        (("--start", "x.pt", "--frames", "2"), "`--frames` does not apply to"),
    ],
)
def test_options_without_meaning_for_the_head_are_refused(dataset, tmp_path, capsys, more, word):
    assert train(dataset, tmp_path / "run", *more, component=CONFIDENCE) == 2
    assert word in capsys.readouterr().err


def test_a_component_that_changes_drops_the_head(graph, dataset, tmp_path, capsys):
    history = {name: [{"epoch": 1}] for name in ("segmentation", "depth", CONFIDENCE)}
    start = tmp_path / "start.pt"
    Checkpoint(graph.spec, graph.state_dict(), None, history).save(start)
    more = ("--start", str(start))
    assert train(dataset, tmp_path / "run", *more, component="depth", epochs=1) == 0
    assert "the confidence head of" in capsys.readouterr().err
    left = Checkpoint.load(tmp_path / "run" / "last.pt")
    assert not left.spec.confidence and CONFIDENCE not in left.history
    assert not any(name.startswith(CONFIDENCE) for name in left.weights)


# model files


def test_a_file_with_a_head_has_a_third_output_and_the_same_depth(graph, files):
    plain = replace(graph.spec, confidence=False)
    without = SerialGraph(plain)
    without.load_state_dict({k: v for k, v in graph.state_dict().items() if CONFIDENCE not in k})
    export_fused(without.eval(), files / "without.onnx", Provenance())
    rgb = {"rgb": measure.image_of(graph.spec)}
    one, other = (run(files / name, rgb) for name in ("fused.onnx", "without.onnx"))
    assert list(one) == ["depth", "labels", "confidence"]
    assert list(other) == ["depth", "labels"]
    assert one["confidence"].shape == (1, 96, 128) and one["confidence"].dtype == np.uint8
    assert np.ptp(one["confidence"]) > 50
    assert np.abs(one["depth"] - other["depth"]).max() < 1e-4
    assert np.array_equal(one["labels"], other["labels"])


def test_the_depth_stage_gives_the_same_confidence(graph, files):
    rgb = measure.image_of(graph.spec)
    staged = tomllib.loads((files / "staged.toml").read_text())
    assert staged["outputs"]["confidence"] == "depth.confidence"
    features = run(files / "staged.segmentation.onnx", {"rgb": rgb})["logits"]
    found = run(files / "staged.depth.onnx", {"rgb": rgb, "features": features})
    fused = run(files / "fused.onnx", {"rgb": rgb})
    assert np.abs(found["confidence"].astype(int) - fused["confidence"]).max() <= 1


def test_a_fused_file_is_split_with_its_confidence(graph, files, tmp_path):
    out = tmp_path / "parts.toml"
    assert main(["export", "--split", str(files / "fused.onnx"), "--out", str(out)]) == 0
    assert tomllib.loads(out.read_text())["outputs"] == {
        "confidence": "depth.confidence",
        "depth": "depth.depth",
        "labels": "segmentation.labels",
    }
    rgb = measure.image_of(graph.spec)
    features = run(tmp_path / "parts.segmentation.onnx", {"rgb": rgb})["logits"]
    found = run(tmp_path / "parts.depth.onnx", {"rgb": rgb, "features": features})
    fused = run(files / "fused.onnx", {"rgb": rgb})
    assert np.array_equal(found["confidence"], fused["confidence"])


def test_the_test_model_in_git_is_what_the_recipe_makes():
    path = TINY.with_name(TINY_CONFIDENCE)
    model = FusedModel(tiny_confidence().eval())
    rgb = measure.image_of(model.network.spec)
    measure.check_against_torch(model, path, rgb, bound=measure.UNTRAINED_BOUND)


def test_quantization_keeps_the_head_in_float_and_evaluate_measures_it(
    files, dataset, tmp_path, capsys
):
    fused, out = files / "fused.onnx", tmp_path / "int8.onnx"
    more = ("--data", str(dataset), "--ids", str(dataset / "train.txt"))
    assert main(["quantize", "--model", str(fused), "--out", str(out), *more]) == 0
    assert len(heads(onnx.load(fused))) == 2, "the last convolutions of depth and confidence"
    rgb = {"rgb": measure.image_of(with_head())}
    one, other = (run(path, rgb)["confidence"].astype(int) for path in (fused, out))
    assert np.abs(one - other).mean() < 20  # random weights quantize badly
    capsys.readouterr()
    assert main(["evaluate", "--model", str(out), *more]) == 0
    found = json.loads(capsys.readouterr().out)["sparsification"]
    assert set(found) == {"images", "abs_rel", *METRICS, "median_fit"}
    assert set(found["median_fit"]) == {"abs_rel", *METRICS}
    assert found["images"] == 4
    assert found["oracle_50"] < found["certain_50"]


def test_evaluate_of_sets_prints_a_table_of_the_confidence(files, tmp_path, capsys):
    write_set(tmp_path / "a")
    write_set(tmp_path / "b", scenes=("yard",))
    sets = write_list(
        tmp_path / "list.toml",
        'name = "a"\nroot = "a"',
        'name = "b"\nroot = "b"\nuse = "val"',
    )
    model = str(files / "fused.onnx")
    assert main(["evaluate", "--model", model, "--sets", str(sets), "--accuracy-only"]) == 0
    printed = capsys.readouterr()
    assert "| set | AbsRel | certain 90 % |" in printed.err
    assert "certain_50_median" in json.loads(printed.out)["sets"]["b"]


def test_a_blend_keeps_a_head_that_the_other_lacks(graph, tmp_path):
    history = {name: [{"epoch": 1}] for name in ("segmentation", "depth", CONFIDENCE)}
    new, old, out = (tmp_path / name for name in ("new.pt", "old.pt", "out.pt"))
    Checkpoint(graph.spec, graph.state_dict(), None, history).save(new)
    other = untrained_graph(tiny_spec("wnet_c"), seed=5)
    Checkpoint(other.spec, other.state_dict(), None, history).save(old)
    arguments = ["export", "--checkpoint", str(new), "--out", str(out), "--blend", f"{old}=0.5"]
    assert main(arguments) == 0
    mixed = Checkpoint.load(out)
    for name, value in graph.confidence.state_dict().items():
        assert torch.allclose(mixed.weights[f"{CONFIDENCE}.{name}"].float(), value, atol=2e-3)
    assert mixed.graph().confidence is not None
