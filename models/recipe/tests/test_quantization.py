"""Quantization of a test model: integers inside, nearly the same depth, its own self-test."""

import hashlib
import json
import shutil
from types import SimpleNamespace

import numpy as np
import onnx
import pytest
from PIL import Image
from runs import TINY

from nunet_models.cli import main
from nunet_models.errors import ConfigError, ExportError
from nunet_models.evaluation.predict import Predictor
from nunet_models.export.joints import connected_joints
from nunet_models.export.onnx_file import read_metadata, run
from nunet_models.export.split import split
from nunet_models.quantization.biases import groups
from nunet_models.quantization.command import _spread
from nunet_models.quantization.static import Plan, heads, quantize


@pytest.fixture(scope="module")
def quantized(tmp_path_factory):
    from conftest import write_dataset  # noqa: PLC0415  (a module's fixture cannot use `dataset`)

    root = tmp_path_factory.mktemp("rooms")
    write_dataset(root)
    out = root / "int8.onnx"
    code = main(
        [
            *("quantize", "--model", str(TINY), "--out", str(out), "--data", str(root)),
            *("--ids", str(root / "train.txt"), "--images", "4"),
        ]
    )
    assert code == 0
    return root, out


def test_convolutions_are_quantized_and_heads_are_not(quantized):
    model = onnx.load(quantized[1])
    dequantized = {n.output[0] for n in model.graph.node if n.op_type == "DequantizeLinear"}
    convolutions = [n for n in model.graph.node if n.op_type == "Conv"]
    in_float = [n.name for n in convolutions if n.input[1] not in dequantized]
    assert sorted(in_float) == heads(onnx.load(TINY))


def test_the_head_is_the_last_convolution_of_depth_and_labels_need_none():
    model = onnx.load(TINY)
    makers = {output: node for node in model.graph.node for output in node.output}
    node = makers["depth"]
    while node.op_type != "Conv":
        node = makers[node.input[0]]
    assert heads(model) == [node.name]


def test_a_quantized_file_is_a_model_file_with_its_own_selftest(quantized):
    predictor = Predictor(quantized[1])
    selftest = json.loads(predictor.metadata["nunet.selftest"])
    assert selftest["precision"] == "int8" and "int8" in selftest["tolerance"]
    how = json.loads(predictor.metadata["nunet.training"])["quantisation"]
    assert how["method"] == "minmax"
    assert how["weight_bits"] == 7
    convolutions = [node for node in onnx.load(TINY).graph.node if node.op_type == "Conv"]
    assert how["corrected_biases"] == len(convolutions) - len(how["float_nodes"])
    digest = hashlib.sha256(b"0000\n0001\n0002\n0003\n").hexdigest()
    assert how["calibration"] == {"used": 4, "pictures": 4, "ids_sha256": digest}


def test_quantized_depth_stays_near(quantized):
    rgb = np.array(Image.open(quantized[0] / "rgb" / "0005.png"))
    before, after = Predictor(TINY)(rgb).depth, Predictor(quantized[1])(rgb).depth
    error = np.nanmean(np.abs(before - after) / before)
    assert error < 0.15, error  # random weights quantize badly


def test_sums_of_two_products_fit_into_16_bits_unless_8_bit_weights_are_asked_for(quantized):
    """Processors without VNNI add them so; 255 * 127 * 2 does not fit."""
    root, out = quantized
    assert largest_weights(out) == (set(), {64})
    assert 2 * 255 * max(largest_weights(out)[1]) <= np.iinfo(np.int16).max
    eight = root / "8_bits.onnx"
    command = ("quantize", "--model", str(TINY), "--out", str(eight), "--no-reduce-range")
    data = ("--data", str(root), "--ids", str(root / "train.txt"), "--images", "4")
    assert main([*command, *data]) == 0
    assert largest_weights(eight) == (set(), {127})
    how = json.loads(read_metadata(eight)["nunet.training"])["quantisation"]
    assert how["weight_bits"] == 8


def test_only_depth_wise_convolutions_keep_8_bits_in_the_file_that_ships():
    """They sum in 32 bits everywhere, and have few weights over which rounding averages out."""
    depthwise, others = largest_weights(TINY.parents[1] / "wnet_c.onnx")
    assert (max(depthwise), max(others)) == (127, 64)
    plan = Plan()
    shapes = [((6, 1, 3, 3), 6), ((6, 6, 3, 3), 1), ((6, 3, 3, 3), 2), ((12, 1, 3, 3), 6)]
    assert [plan.largest_weight(*shape) for shape in shapes] == [127, 64, 64, 64]


def largest_weights(path):
    """The largest magnitudes of output channels in 8-bit convolutions: depth-wise, and others."""
    model = onnx.load(path)
    tensors = {t.name: onnx.numpy_helper.to_array(t) for t in model.graph.initializer}
    read = {node.output[0]: node.input[0] for node in model.graph.node}
    found = (set(), set())
    for node in model.graph.node:
        weights = tensors.get(read.get(node.input[1])) if node.op_type == "Conv" else None
        if weights is not None:
            channels = np.abs(weights.astype(int)).max(axis=(1, 2, 3))
            found[groups(node) == 1].update(channels.tolist())
    return found


def test_what_is_quantized_is_not_quantized_again(quantized):
    with pytest.raises(ConfigError, match="not an fp32 model file"):
        quantize(quantized[1], quantized[0] / "again.onnx", iter(()), Plan())


def test_a_quantized_file_awaits_an_accuracy_of_its_own(quantized, tmp_path, capsys):
    out, found = tmp_path / "int8.onnx", tmp_path / "accuracy.json"
    measured = tmp_path / TINY.name
    shutil.copy(TINY, measured)
    found.write_text('{"model": "tiny_wnet_c.onnx", "metrics": {"rmse": 0.5}}')
    note = ["annotate", "--accuracy", str(found), "--model"]
    assert main([*note, str(measured)]) == 0
    assert json.loads(read_metadata(measured)["nunet.accuracy"])["metrics"] == {"rmse": 0.5}
    quantize(measured, out, iter([np.zeros((96, 128, 3), np.uint8)]), Plan())
    assert read_metadata(out)["nunet.accuracy"] == "{}"
    before = out.read_bytes()
    assert main([*note, str(out)]) == 1
    assert "is of the model `tiny_wnet_c.onnx`; expected `int8.onnx`" in capsys.readouterr().err
    assert out.read_bytes() == before
    found.write_text('{"model": "int8.onnx", "metrics": {"rmse": 0.6}}')
    assert main([*note, str(out)]) == 0
    values = read_metadata(out)
    assert json.loads(values["nunet.accuracy"])["metrics"] == {"rmse": 0.6}
    assert json.loads(values["nunet.selftest"])["precision"] == "int8"
    names = {"accuracy.json", "int8.onnx", TINY.name}
    assert {path.name for path in tmp_path.iterdir()} == names
    assert main(["annotate", "--model", str(out), "--license", "CC0"]) == 0
    assert read_metadata(out) == {**values, "nunet.license": "CC0"}
    assert main(["annotate", "--model", str(out)]) == 1
    assert "nothing to write; hint: `--accuracy FILE`" in capsys.readouterr().err


def test_a_failed_quantization_leaves_the_file_that_was_there(tmp_path, monkeypatch):
    def fails(*_):
        raise ExportError("a self-test cell has depth in one run and none in another")

    monkeypatch.setattr("nunet_models.quantization.static.quantized_selftest", fails)
    out = tmp_path / "int8.onnx"
    out.write_text("the old one")
    with pytest.raises(ExportError):
        quantize(TINY, out, iter([np.zeros((96, 128, 3), np.uint8)]), Plan())
    assert [path.name for path in tmp_path.iterdir()] == ["int8.onnx"]
    assert out.read_text() == "the old one"


@pytest.mark.parametrize("count", ["0", "-1"])
def test_no_images_to_calibrate_on_is_said(dataset, tmp_path, capsys, count):
    out = tmp_path / "int8.onnx"
    data = ("--data", str(dataset), "--ids", str(dataset / "train.txt"), "--images", count)
    assert main(["quantize", "--model", str(TINY), "--out", str(out), *data]) == 2
    assert f"`--images {count}`: expected one or more" in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize(
    ("count", "wanted", "indices"),
    [
        (5, 3, [0, 2, 4]),
        (3, 64, [0, 1, 2]),
        (64, 64, list(range(64))),
        (10, 1, [0]),
    ],
)
def test_calibration_images_are_spread_over_all(count, wanted, indices):
    assert spread(count, wanted) == indices


def test_calibration_images_are_spread_where_their_number_divides_none():
    """A whole step between them took the first 64 of 120: half of the rooms."""
    chosen = spread(120, 64)
    assert len(set(chosen)) == 64 and (chosen[0], chosen[-1]) == (0, 119)
    assert set(np.diff(chosen)) == {1, 2}


def spread(count, wanted):
    pairs = [SimpleNamespace(rgb=index) for index in range(count)]
    return list(_spread(pairs, wanted))


def test_a_model_is_not_quantized_over_itself(dataset, tmp_path, capsys):
    model, out = tmp_path / "model.onnx", tmp_path / "same.onnx"
    shutil.copy(TINY, model)
    out.symlink_to(model)
    data = ("--data", str(dataset), "--ids", str(dataset / "train.txt"))
    for name in (model, out):
        assert main(["quantize", "--model", str(model), "--out", str(name), *data]) == 1
        assert f"`--out {name}` would overwrite the file of `--model`" in capsys.readouterr().err
    assert model.read_bytes() == TINY.read_bytes()


def test_a_network_whose_features_are_0_is_quantized(tmp_path):
    model = onnx.load(TINY)
    makers = {output: node for node in model.graph.node for output in node.output}
    ((_, features),) = connected_joints(model)
    for tensor in model.graph.initializer:
        if tensor.name in makers[features].input[1:]:
            zeros = np.zeros_like(onnx.numpy_helper.to_array(tensor))
            tensor.CopyFrom(onnx.numpy_helper.from_array(zeros, tensor.name))
    dull, out = tmp_path / "dull.onnx", tmp_path / "int8.onnx"
    onnx.save(model, dull)
    rgb = np.random.default_rng(2).integers(0, 256, (96, 128, 3), np.uint8)
    quantize(dull, out, iter([rgb]), Plan())
    assert json.loads(read_metadata(out)["nunet.training"])["quantisation"]["joints"] == {}
    before, after = Predictor(dull)(rgb).depth, Predictor(out)(rgb).depth
    assert np.nanmean(np.abs(before - after) / before) < 0.15


def test_a_recurrent_network_is_not_quantized(tmp_path):
    """Calibrated on zeros, its integers would give the output of a network without a state."""
    images = iter([np.zeros((96, 128, 3), np.uint8)])
    with pytest.raises(ConfigError, match=r"_lstm\.onnx` is recurrent; ") as caught:
        quantize(TINY.with_name("tiny_wnet_c_lstm.onnx"), tmp_path / "int8.onnx", images, Plan())
    assert caught.value.hint
    assert not list(tmp_path.iterdir())


def test_a_fused_file_cut_at_its_joint_gives_the_same_bits(quantized, tmp_path):
    rgb = np.random.default_rng(1).integers(0, 256, (1, 96, 128, 3), dtype=np.uint8)
    for fused in (TINY, quantized[1]):
        staged = tmp_path / f"{fused.stem}.toml"
        assert main(["export", "--split", str(fused), "--out", str(staged)]) == 0
        expected = run(fused, {"rgb": rgb})
        first = run(staged.with_suffix(".segmentation.onnx"), {"rgb": rgb})
        features = first["logits"]
        second = run(staged.with_suffix(".depth.onnx"), {"rgb": rgb, "features": features})
        np.testing.assert_array_equal(second["depth"], expected["depth"])
        np.testing.assert_array_equal(first["labels"], expected["labels"])
        # The staged graph that the exporter writes is wired in the same way.
        wiring = TINY.with_suffix(".toml").read_text().replace(TINY.stem, fused.stem)
        assert staged.read_text() == wiring
        metadata = read_metadata(staged.with_suffix(".depth.onnx"))
        assert metadata == read_metadata(fused)


def test_a_graph_without_a_connected_joint_is_not_cut(tmp_path):
    plain = TINY.with_name("tiny_wnet.onnx")
    with pytest.raises(ExportError, match="has 0 connected joints"):
        split(plain, tmp_path / "plain.toml")
    assert not list(tmp_path.iterdir())


def test_a_recurrent_graph_is_not_split(tmp_path, capsys):
    fused, out = TINY.with_name("tiny_wnet_c_lstm.onnx"), tmp_path / "new" / "staged.toml"
    assert main(["export", "--split", str(fused), "--out", str(out)]) == 1
    assert "`tiny_wnet_c_lstm.onnx` is recurrent" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
