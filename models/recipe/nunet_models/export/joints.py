"""The joints of a connected graph in its file: image and features are concatenated there."""

from collections.abc import Iterator

import onnx

IMAGE_CHANNELS = 3


def connected_joints(model: onnx.ModelProto) -> Iterator[tuple[onnx.NodeProto, str]]:
    """Every Concat of image and features, with the name of the features.

    The image is always the first input. Image and features may be quantized.
    """
    makers = {output: node for node in model.graph.node for output in node.output}
    for node in model.graph.node:
        if node.op_type == "Concat" and len(node.input) == 2 and _is_image(makers, node.input[0]):
            yield node, node.input[1]


def _is_image(makers: dict[str, onnx.NodeProto], name: str) -> bool:
    """Whether a tensor is the normalized image, integers or not."""
    node = makers.get(name)
    while node is not None and node.op_type in {"DequantizeLinear", "QuantizeLinear"}:
        node = makers.get(node.input[0])
    return node is not None and node.op_type == "Div"
