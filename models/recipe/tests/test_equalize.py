"""Channels of one range compute the same in float and keep more of their steps in integers."""

import numpy as np
import onnx
import onnxruntime as ort
import pytest
from onnx import helper, numpy_helper
from test_quantization import TINY

from nunet_models.export.onnx_file import load_model
from nunet_models.quantization.equalize import LEAST_SHARE, equalize_channels

SHAPE = (1, 2, 8, 8)


def conv(name, weights, source, *, group=1):
    """A 3x3 convolution with a bias, and its weights."""
    random = np.random.default_rng(len(name))
    bias = random.normal(0, 0.2, len(weights)).astype(np.float32)
    tensors = [
        numpy_helper.from_array(weights.astype(np.float32), f"{name}.w"),
        numpy_helper.from_array(bias, f"{name}.b"),
    ]
    inputs = [source, f"{name}.w", f"{name}.b"]
    node = helper.make_node("Conv", inputs, [name], name, pads=[1] * 4, group=group)
    return node, tensors


def weights(outputs, inputs, *, spread=1.0):
    """Weights whose output channels differ in range by up to `spread`."""
    random = np.random.default_rng(outputs * 7 + inputs)
    scale = np.geomspace(1.0, spread, outputs)[:, None, None, None]
    return random.normal(0, 0.5, (outputs, inputs, 3, 3)) * scale


def model_of(*layers, output):
    nodes, tensors = [], []
    for node, own in layers:
        nodes.append(node)
        tensors += own
    graph = helper.make_graph(
        nodes,
        "test",
        [helper.make_tensor_value_info("x", onnx.TensorProto.FLOAT, SHAPE)],
        [helper.make_tensor_value_info(output, onnx.TensorProto.FLOAT, list("nchw"))],
        tensors,
    )
    opset = [helper.make_opsetid("", 18)]
    model = helper.make_model(graph, opset_imports=opset, ir_version=10)
    onnx.checker.check_model(model)
    return model


def plain(kind, sources, name, **attributes):
    return helper.make_node(kind, sources, [name], name, **attributes), []


def upsampled(source, name):
    scales = numpy_helper.from_array(np.array([1, 1, 2, 2], np.float32), f"{name}.s")
    node = helper.make_node("Resize", [source, "", f"{name}.s"], [name], name, mode="nearest")
    return node, [scales]


def residual_unet():
    """Two convolutions added to a third, one of them seen twice; upsampling beside a skip."""
    return model_of(
        conv("a", weights(4, 2, spread=50), "x"),
        conv("b", weights(4, 4, spread=9), "a"),
        plain("Add", ["a", "b"], "sum"),
        conv("down", weights(6, 4, spread=20), "sum"),
        plain("Relu", ["down"], "down.r"),
        upsampled("down.r", "up"),
        upsampled("sum", "skip"),
        plain("Concat", ["up", "skip"], "both", axis=1),
        conv("out", weights(1, 10), "both"),
        output="out",
    )


def values(model, names, x):
    probe = onnx.ModelProto()
    probe.CopyFrom(model)
    del probe.graph.output[:]
    probe.graph.output.extend(
        helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, None) for name in names
    )
    session = ort.InferenceSession(probe.SerializeToString(), providers=["CPUExecutionProvider"])
    return dict(zip(names, session.run(names, {"x": x}), strict=True))


def ranges_on(model, x):
    def ranges(names):
        return {n: np.abs(v).max(axis=(0, 2, 3)) for n, v in values(model, names, x).items()}

    return ranges


X = np.random.default_rng(1).normal(0, 1, SHAPE).astype(np.float32)


def equalized(model):
    after = onnx.ModelProto()
    after.CopyFrom(model)
    return after, equalize_channels(after, ranges_on(model, X))


def test_residuals_skips_and_upsampling_compute_the_same_with_equal_channels():
    before = residual_unet()
    after, sites = equalized(before)
    assert sites == 2  # the chain of `a`, `b` and their sum; what is upsampled
    one, other = (values(m, ["out"], X)["out"] for m in (before, after))
    assert np.allclose(one, other, rtol=1e-4, atol=1e-4 * np.abs(one).max())
    ranges = ranges_on(after, X)(["sum", "a", "b", "down.r"])
    chain = np.max([ranges[name] for name in ("sum", "a", "b")], axis=0)
    assert chain == pytest.approx(1.0, rel=1e-4)
    assert ranges["down.r"].max() == pytest.approx(1.0, rel=1e-4)


@pytest.mark.parametrize("between", ["Sigmoid", "Clip", "depthwise", "output"])
def test_what_cannot_be_compensated_is_left_alone(between):
    first = conv("a", weights(4, 2, spread=50), "x")
    last = conv("out", weights(1, 4), "y")
    if between == "depthwise":
        middle = conv("y", weights(4, 1), "a", group=4)
    elif between == "Clip":
        limits = [numpy_helper.from_array(np.float32(v), f"l{v}") for v in (0, 6)]
        middle = (helper.make_node("Clip", ["a", "l0", "l6"], ["y"], "y"), limits)
    else:
        middle = plain("Sigmoid" if between == "Sigmoid" else "Identity", ["a"], "y")
    model = model_of(first, middle, last, output="a" if between == "output" else "out")
    before = model.SerializeToString()
    after, _ = equalized(model)
    a = {t.name: numpy_helper.to_array(t) for t in after.graph.initializer}
    b = {t.name: numpy_helper.to_array(t) for t in onnx.load_from_string(before).graph.initializer}
    assert np.array_equal(a["a.w"], b["a.w"])


def test_a_channel_that_is_never_used_is_not_blown_up():
    own = weights(4, 2)
    own[2] = 0
    model = model_of(
        conv("a", own, "x"),
        plain("Relu", ["a"], "r"),
        conv("out", weights(1, 4), "r"),
        output="out",
    )
    bias = next(t for t in model.graph.initializer if t.name == "a.b")
    quiet = numpy_helper.to_array(bias).copy()
    quiet[2] = 0
    bias.CopyFrom(numpy_helper.from_array(quiet, "a.b"))
    after, sites = equalized(model)
    assert sites == 1
    found = {t.name: numpy_helper.to_array(t) for t in after.graph.initializer}
    assert all(np.isfinite(tensor).all() for tensor in found.values())
    largest = ranges_on(model, X)(["r"])["r"].max()
    assert found["out.w"][0, 2] == pytest.approx(LEAST_SHARE * largest * weights(1, 4)[0, 2])


def test_a_concatenation_with_what_cannot_be_scaled_takes_its_range():
    model = model_of(
        conv("a", weights(3, 2, spread=30), "x"),
        plain("Relu", ["a"], "r"),
        plain("Concat", ["r", "x"], "both", axis=1),
        conv("out", weights(1, 5), "both"),
        output="out",
    )
    after, sites = equalized(model)
    assert sites == 1
    ranges = ranges_on(after, X)(["r"])["r"]
    assert ranges == pytest.approx(np.abs(X).max(), rel=1e-4)
    one, other = (values(m, ["out"], X)["out"] for m in (model, after))
    assert np.allclose(one, other, rtol=1e-4, atol=1e-4 * np.abs(one).max())


def test_a_whole_network_computes_the_same(tmp_path):
    model = load_model(TINY)
    after = onnx.ModelProto()
    after.CopyFrom(model)
    rgb = np.random.default_rng(0).integers(0, 256, (1, 96, 128, 3), np.uint8)

    def ranges(names):
        probe = onnx.ModelProto()
        probe.CopyFrom(model)
        del probe.graph.output[:]
        probe.graph.output.extend(helper.make_tensor_value_info(n, 1, None) for n in names)
        session = ort.InferenceSession(
            probe.SerializeToString(), providers=["CPUExecutionProvider"]
        )
        found = session.run(names, {"rgb": rgb})
        return {n: np.abs(v).max(axis=(0, 2, 3)) for n, v in zip(names, found, strict=True)}

    assert equalize_channels(after, ranges) > 3
    depths = []
    for one in (model, after):
        session = ort.InferenceSession(one.SerializeToString(), providers=["CPUExecutionProvider"])
        depths.append(session.run(["depth"], {"rgb": rgb})[0])
    assert np.allclose(*depths, rtol=1e-4)
