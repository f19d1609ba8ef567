"""Rewrites of a graph before and after quantization, which compute the same."""

import numpy as np
import onnx
import onnxruntime as ort
from runs import TINY

from nunet_models.quantization.rewrites import balance_joints, double_by_copies


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


def test_a_joint_whose_features_are_0_is_left_alone_and_the_others_are_not():
    """Divided by that range, the weights of the head would be no numbers."""
    three = TINY.with_name("tiny_nunet3_c.onnx")
    model = onnx.load(three)
    assert balance_joints(model, lambda names: dict.fromkeys(names, 0.0)) == {}
    assert model == onnx.load(three)
    factors = balance_joints(model, lambda names: dict(zip(names, (0.0, 8.0), strict=True)))
    assert list(factors.values()) == [8.0]
    for tensor in model.graph.initializer:
        assert np.isfinite(onnx.numpy_helper.to_array(tensor)).all(), tensor.name


def features_of(model, name, rgb):
    value = onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, None)
    model.graph.output.append(value)
    session = ort.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    return session.run([name], {"rgb": rgb})[0]


def test_a_plain_joint_is_left_alone():
    model = onnx.load(TINY.with_name("tiny_wnet.onnx"))
    assert balance_joints(model, lambda names: dict.fromkeys(names, 8.0)) == {}
    assert model == onnx.load(TINY.with_name("tiny_wnet.onnx"))


def upsampling(rows: int, columns: int) -> onnx.ModelProto:
    """A graph that upsamples `[1, 3, 4, 5]` bytes to `rows` x `columns`, in the QDQ form."""
    node, tensor = onnx.helper.make_node, onnx.numpy_helper.from_array
    resize = {"mode": "nearest", "nearest_mode": "floor"}
    resize["coordinate_transformation_mode"] = "asymmetric"
    byte = onnx.TensorProto.UINT8
    graph = onnx.helper.make_graph(
        [
            node("DequantizeLinear", ["x", "scale", "zero"], ["in"], "before"),
            node("Resize", ["in", "", "", "sizes"], ["out"], "resize", **resize),
            node("QuantizeLinear", ["out", "scale", "zero"], ["y"], "behind"),
        ],
        "upsampling",
        [onnx.helper.make_tensor_value_info("x", byte, [1, 3, 4, 5])],
        [onnx.helper.make_tensor_value_info("y", byte, [1, 3, rows, columns])],
        [
            tensor(np.float32(0.25), "scale"),
            tensor(np.uint8(7), "zero"),
            tensor(np.array([1, 3, rows, columns]), "sizes"),
        ],
    )
    # A value in the middle of a graph, as in every network: its shape is inferred.
    graph.value_info.append(onnx.helper.make_tensor_value_info("x", byte, [1, 3, 4, 5]))
    graph.value_info.append(onnx.helper.make_tensor_value_info("y", byte, [1, 3, rows, columns]))
    opset = [onnx.helper.make_opsetid("", 20)]
    return onnx.helper.make_model(graph, opset_imports=opset, ir_version=10)


def ran(model: onnx.ModelProto, x: np.ndarray) -> np.ndarray:
    session = ort.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    return session.run(None, {"x": x})[0]


def test_doubling_by_copies_gives_the_same_bytes():
    model = upsampling(8, 10)
    x = np.random.default_rng(0).integers(0, 256, (1, 3, 4, 5), dtype=np.uint8)
    expected = ran(model, x)
    assert double_by_copies(model) == 1
    assert {node.op_type for node in model.graph.node} == {"Transpose", "Concat", "Reshape"}
    np.testing.assert_array_equal(ran(model, x), expected)


def test_an_upsampling_that_does_not_double_is_left_alone():
    model = upsampling(7, 10)
    assert double_by_copies(model) == 0
    assert model == upsampling(7, 10)
