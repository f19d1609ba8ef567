"""Corrected biases: with rounded weights, the means of outputs are those of the float network."""

import numpy as np
import onnx
import onnxruntime as ort
import pytest
from onnx import numpy_helper

from nunet_models.quantization.biases import correct_biases, rounding

LARGEST = 4  # coarse, so that rounding shifts means visibly


@pytest.mark.parametrize("groups", [1, 2, 6])
def test_means_of_outputs_stay_the_same_when_weights_are_rounded(groups):
    model = convolution(groups)
    x = np.ones((1, 6, 5, 7), np.float32)
    x *= np.arange(1, 7, dtype=np.float32)[None, :, None, None]
    expected = channel_means(model, x)
    uncorrected = rounded(model)
    assert np.abs(channel_means(uncorrected, x) - expected).max() > 0.1
    found = {"x": x.mean(axis=(0, 2, 3), dtype=np.float64)}
    assert (
        correct_biases(
            model, lambda names: {name: found[name] for name in names}, lambda *_: LARGEST, []
        )
        == 1
    )
    np.testing.assert_allclose(channel_means(rounded(model), x), expected, atol=1e-4)


def test_a_node_that_stays_in_float_keeps_its_bias():
    model = convolution(1)
    assert (
        correct_biases(model, lambda _: pytest.fail("no means are needed"), LARGEST, ["conv"]) == 0
    )
    assert model == convolution(1)


def test_weights_of_0_lose_nothing():
    assert not rounding(np.zeros((2, 3, 1, 1)), LARGEST).any()


def convolution(groups):
    """A 3x3 convolution of 6 channels to 12 without padding."""
    random = np.random.default_rng(0)
    weights = random.normal(size=(12, 6 // groups, 3, 3)).astype(np.float32)
    graph = onnx.helper.make_graph(
        [onnx.helper.make_node("Conv", ["x", "w", "b"], ["y"], "conv", group=groups)],
        "convolution",
        [onnx.helper.make_tensor_value_info("x", onnx.TensorProto.FLOAT, [1, 6, 5, 7])],
        [onnx.helper.make_tensor_value_info("y", onnx.TensorProto.FLOAT, [1, 12, 3, 5])],
        [
            numpy_helper.from_array(weights, "w"),
            numpy_helper.from_array(random.normal(size=12).astype(np.float32), "b"),
        ],
    )
    opset = [onnx.helper.make_opsetid("", 20)]
    return onnx.helper.make_model(graph, opset_imports=opset, ir_version=10)


def rounded(model):
    """A copy of `model` with rounded weights."""
    copy = onnx.ModelProto()
    copy.CopyFrom(model)
    weights = numpy_helper.to_array(copy.graph.initializer[0])
    near = (weights + rounding(weights, LARGEST)).astype(np.float32)
    copy.graph.initializer[0].CopyFrom(numpy_helper.from_array(near, "w"))
    return copy


def channel_means(model, x):
    session = ort.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    return session.run(None, {"x": x})[0].mean(axis=(0, 2, 3))
