"""How a graph is prepared for integers without a change of what it computes in float."""

from collections.abc import Callable, Iterator

import numpy as np
import onnx
from onnx import numpy_helper

IMAGE_CHANNELS = 3

Ranges = Callable[[list[str]], dict[str, float]]
"""The largest magnitude of named tensors over the calibration pictures."""


def balance_joints(model: onnx.ModelProto, ranges: Ranges) -> dict[str, float]:
    """Bring the features that cross a connected joint into the image's range; gives the factors.

    One scale quantises what a convolution reads. Where logits up to 20 lie beside an image within
    1, a step of that scale is a seventh of the image. So the head that makes the logits is divided
    by their range, and the weights that read them are multiplied by it: labels are the same, since
    the greatest logit stays the greatest, and so is everything behind the joint.
    """
    joints = list(_joints(model))
    if not joints:
        return {}
    found = ranges([features for _, features, _, _ in joints])
    factors = {}
    for concat, features, head, readers in joints:
        factor = found[features]
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
    for concat in model.graph.node:
        if concat.op_type != "Concat" or len(concat.input) != 2:
            continue
        heads = [makers.get(name) for name in concat.input]
        image = [head is not None and head.op_type == "Div" for head in heads]
        readers = consumers.get(concat.output[0], [])
        if image.count(True) != 1 or any(reader.op_type != "Conv" for reader in readers):
            continue
        if not image[0]:
            continue  # the image comes first in every graph of ours
        head = heads[1]
        others = [n for n in consumers.get(concat.input[1], []) if n is not concat]
        # Whoever else reads the features must not notice a positive factor.
        if (
            head is not None
            and head.op_type == "Conv"
            and all(n.op_type == "ArgMax" for n in others)
        ):
            yield concat, concat.input[1], head, readers


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
