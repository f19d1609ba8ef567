"""Quantisation of a test model: integers inside, nearly the same depth, its own self-test."""

import json
from pathlib import Path

import numpy as np
import onnx
import onnxruntime as ort
import pytest
from PIL import Image

from nunet_models.cli import main
from nunet_models.errors import ConfigError
from nunet_models.evaluation.predict import Predictor
from nunet_models.quantisation.rewrites import balance_joints
from nunet_models.quantisation.static import Plan, heads, quantise

TINY = Path(__file__).parents[2] / "tiny" / "tiny_wnet_c.onnx"


@pytest.fixture(scope="module")
def quantised(tmp_path_factory):
    from conftest import write_dataset  # noqa: PLC0415  (a module's fixture cannot use `dataset`)

    root = tmp_path_factory.mktemp("rooms")
    write_dataset(root)
    out = root / "int8.onnx"
    code = main(
        [
            *("quantize", "--model", str(TINY), "--out", str(out), "--data", str(root)),
            *("--ids", str(root / "train.txt"), "--pictures", "4"),
        ]
    )
    assert code == 0
    return root, out


def test_convolutions_are_quantised_and_heads_are_not(quantised):
    model = onnx.load(quantised[1])
    dequantised = {n.output[0] for n in model.graph.node if n.op_type == "DequantizeLinear"}
    convolutions = [n for n in model.graph.node if n.op_type == "Conv"]
    in_float = [n.name for n in convolutions if n.input[1] not in dequantised]
    assert sorted(in_float) == heads(onnx.load(TINY))


def test_heads_are_the_last_convolution_of_each_result():
    assert len(heads(onnx.load(TINY))) == 2


def test_a_quantised_file_is_a_model_file_with_its_own_selftest(quantised):
    predictor = Predictor(quantised[1])
    selftest = json.loads(predictor.metadata["nunet.selftest"])
    assert selftest["precision"] == "int8" and "int8" in selftest["tolerance"]
    assert json.loads(predictor.metadata["nunet.training"])["quantisation"]["method"] == "minmax"


def test_quantised_depth_stays_near(quantised):
    rgb = np.array(Image.open(quantised[0] / "rgb" / "0005.png"))
    before, after = Predictor(TINY)(rgb).depth, Predictor(quantised[1])(rgb).depth
    error = np.nanmean(np.abs(before - after) / before)
    assert error < 0.15, error  # random weights quantise badly


def test_what_is_quantised_is_not_quantised_again(quantised):
    with pytest.raises(ConfigError, match="no fp32 model file"):
        quantise(quantised[1], quantised[0] / "again.onnx", iter(()), Plan())


def test_balanced_joints_compute_the_same_and_cross_within_one():
    model = onnx.load(TINY)
    seen = {}

    def ranges(names):
        seen["names"] = names
        return dict.fromkeys(names, 8.0)

    factors = balance_joints(model, ranges)
    assert list(factors.values()) == [8.0] and len(seen["names"]) == 1
    rgb = np.random.default_rng(1).integers(0, 256, (1, 96, 128, 3), np.uint8)
    before, after = (
        ort.InferenceSession(m.SerializeToString(), providers=["CPUExecutionProvider"])
        for m in (onnx.load(TINY), model)
    )
    depth, labels = before.run(["depth", "labels"], {"rgb": rgb})
    balanced_depth, balanced_labels = after.run(["depth", "labels"], {"rgb": rgb})
    np.testing.assert_allclose(balanced_depth, depth, rtol=1e-4)
    assert (balanced_labels == labels).all()
    logits = [features_of(m, seen["names"][0], rgb) for m in (onnx.load(TINY), model)]
    np.testing.assert_allclose(logits[1], logits[0] / 8.0, rtol=1e-5, atol=1e-7)


def features_of(model, name, rgb):
    value = onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, None)
    model.graph.output.append(value)
    session = ort.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    return session.run([name], {"rgb": rgb})[0]


def test_a_plain_joint_is_left_alone():
    model = onnx.load(TINY.with_name("tiny_wnet.onnx"))
    assert balance_joints(model, lambda names: dict.fromkeys(names, 8.0)) == {}
    assert model == onnx.load(TINY.with_name("tiny_wnet.onnx"))
