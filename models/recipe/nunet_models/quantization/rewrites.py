"""Changes of a graph before and after quantization that do not change its results."""

from collections.abc import Callable, Iterator

import numpy as np
import onnx
from onnx import numpy_helper

from nunet_models.export.joints import IMAGE_CHANNELS, connected_joints

Ranges = Callable[[list[str]], dict[str, float]]
"""The largest magnitude of named tensors over the calibration images."""


def balance_joints(model: onnx.ModelProto, ranges: Ranges) -> dict[str, float]:
    """Bring the features that cross a connected joint into the image's range; returns the factors.

    One scale quantizes what a convolution reads. Where logits up to 20 are concatenated with an
    image within 1, a step of that scale is a seventh of the image. So the head that makes the
    logits is divided by their range, and the weights that read them are multiplied by it: labels
    are the same, since the greatest logit stays the greatest, and so are all later results.
    Features that are 0 over all calibration images have no range to be divided by, and are left as
    they are.
    """
    joints = list(_joints(model))
    if not joints:
        return {}
    found = ranges([features for _, features, _, _ in joints])
    factors = {}
    for concat, features, head, readers in joints:
        factor = found[features]
        if not factor > 0.0:
            continue
        _rescale(model, head.input[1:], lambda values, f=factor: values / f)
        for reader in readers:
            _rescale(model, reader.input[1:2], lambda weights, f=factor: _scaled_from(weights, f))
        factors[concat.name] = factor
    return factors


Joint = tuple[onnx.NodeProto, str, onnx.NodeProto, list[onnx.NodeProto]]
"""A Concat, the features' name, the head that makes them, and who reads the Concat."""


def _joints(model: onnx.ModelProto) -> Iterator[Joint]:
    """Every connected joint whose features may be rescaled."""
    makers = {output: node for node in model.graph.node for output in node.output}
    consumers = _consumers(model)
    for concat, features in connected_joints(model):
        readers = consumers.get(concat.output[0], [])
        head = makers.get(features)
        others = [n for n in consumers.get(features, []) if n is not concat]
        # All other consumers of the features must be invariant to a positive factor.
        if (
            head is not None
            and head.op_type == "Conv"
            and all(n.op_type == "ArgMax" for n in others)
            and all(n.op_type == "Conv" for n in readers)
        ):
            yield concat, features, head, readers


def double_by_copies(model: onnx.ModelProto) -> int:
    """Turn nearest upsampling by two, of integers, into copies; returns how many were turned.

    ONNX Runtime 1.31 computes integers with channels last, where its Resize moves byte by byte.
    There a pixel doubled in width is its channels written twice, and a row doubled in height is
    written twice: two Concats, which copy whole runs. The transposes around them meet those that
    ONNX Runtime puts around its convolutions, and vanish.
    """
    shapes = {
        value.name: [d.dim_value for d in value.type.tensor_type.shape.dim]
        for value in onnx.shape_inference.infer_shapes(model).graph.value_info
    }
    makers = {output: node for node in model.graph.node for output in node.output}
    consumers = _consumers(model)
    nodes: list[onnx.NodeProto] = []
    turned: set[str] = set()
    for node in model.graph.node:
        copies = _doubled(model, node, makers, consumers, shapes)
        if copies:
            nodes += copies
            turned |= {node.output[0], copies[-1].output[0]}
        elif not turned.intersection(node.output):
            nodes.append(node)
    del model.graph.node[:]
    model.graph.node.extend(nodes)
    _remove_unread(model)
    return len(turned) // 2


def _doubled(
    model: onnx.ModelProto,
    resize: onnx.NodeProto,
    makers: dict[str, onnx.NodeProto],
    consumers: dict[str, list[onnx.NodeProto]],
    shapes: dict[str, list[int]],
) -> list[onnx.NodeProto]:
    """What takes the place of `resize` and of the Quantize behind it; nothing where it may not."""
    if resize.op_type != "Resize" or _attribute(resize, "mode") != b"nearest":
        return []
    before, readers = makers.get(resize.input[0]), consumers.get(resize.output[0], [])
    if before is None or before.op_type != "DequantizeLinear":
        return []
    if [reader.op_type for reader in readers] != ["QuantizeLinear"]:
        return []
    if _parameters(model, before) != _parameters(model, readers[0]):
        return []
    source, target = before.input[0], readers[0].output[0]
    small, large = shapes.get(source), shapes.get(target)
    if not small or not large or large[2:] != [2 * extent for extent in small[2:]]:
        return []
    batch, channels, height, width = small
    made = [f"{resize.name}_{step}" for step in ("last", "wide", "rows", "tall", "pixels")]
    rows = _constant(model, f"{resize.name}_as_rows", [batch, height, 2 * width * channels])
    pixels = _constant(model, f"{resize.name}_as_pixels", [batch, 2 * height, 2 * width, channels])
    node = onnx.helper.make_node
    return [
        node("Transpose", [source], made[:1], made[0], perm=[0, 2, 3, 1]),
        node("Concat", [made[0]] * 2, made[1:2], made[1], axis=3),
        node("Reshape", [made[1], rows], made[2:3], made[2]),
        node("Concat", [made[2]] * 2, made[3:4], made[3], axis=2),
        node("Reshape", [made[3], pixels], made[4:5], made[4]),
        node("Transpose", [made[4]], [target], f"{resize.name}_first", perm=[0, 3, 1, 2]),
    ]


def _attribute(node: onnx.NodeProto, name: str) -> bytes:
    return next((attribute.s for attribute in node.attribute if attribute.name == name), b"")


def _parameters(model: onnx.ModelProto, node: onnx.NodeProto) -> list[list[float]]:
    """Scale and zero point of a node that quantizes or does the reverse."""
    return [numpy_helper.to_array(_initializer(model, name)).tolist() for name in node.input[1:]]


def _constant(model: onnx.ModelProto, name: str, shape: list[int]) -> str:
    model.graph.initializer.append(numpy_helper.from_array(np.array(shape, np.int64), name))
    return name


def _remove_unread(model: onnx.ModelProto) -> None:
    """Remove nodes and weights whose results are not used."""
    graph = model.graph
    while True:
        read = {name for node in graph.node for name in node.input}
        read |= {output.name for output in graph.output}
        unread = [node for node in graph.node if not read.intersection(node.output)]
        if not unread:
            break
        for node in unread:
            graph.node.remove(node)
    for tensor in [tensor for tensor in graph.initializer if tensor.name not in read]:
        graph.initializer.remove(tensor)


def _consumers(model: onnx.ModelProto) -> dict[str, list[onnx.NodeProto]]:
    found: dict[str, list[onnx.NodeProto]] = {}
    for node in model.graph.node:
        for name in node.input:
            found.setdefault(name, []).append(node)
    return found


def _initializer(model: onnx.ModelProto, name: str) -> onnx.TensorProto:
    return next(tensor for tensor in model.graph.initializer if tensor.name == name)


def _rescale(model: onnx.ModelProto, names: list[str], change: Callable) -> None:
    for name in names:
        tensor = _initializer(model, name)
        values = change(numpy_helper.to_array(tensor)).astype(np.float32)
        tensor.CopyFrom(numpy_helper.from_array(values, name))


def _scaled_from(weights: np.ndarray, factor: float) -> np.ndarray:
    """Weights `[out, in, kh, kw]` with all input channels behind the image's multiplied."""
    weights = weights.copy()
    weights[:, IMAGE_CHANNELS:] *= factor
    return weights
