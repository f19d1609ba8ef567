"""Biases corrected for the rounding of weights, so that means of outputs stay the same.

Rounding adds to a convolution's output the rounded-off part of its weights times its input. Few
weights per channel, as in depth-wise convolutions, do not average it out: whole channels shift, and
depth with them. The mean shift follows from the mean of each input channel, and is subtracted from
the bias. (Nagel et al., "Data-free quantization through weight equalization and bias correction",
2019, with means of calibration images instead of those of batch normalization.)
"""

from collections.abc import Callable, Sequence

import numpy as np
import onnx
from onnx import numpy_helper

ChannelMeans = Callable[[list[str]], dict[str, np.ndarray]]
"""The mean of each channel of named tensors over the calibration images."""
Largest = Callable[[Sequence[int], int], int]
"""To which magnitude the largest weight of an output channel is rounded, by shape and groups."""


def correct_biases(
    model: onnx.ModelProto, means: ChannelMeans, largest: Largest, keep: list[str]
) -> int:
    """Correct the bias of every convolution in place; returns how many there are.

    The weights of each output channel will be rounded to multiples of their largest magnitude
    divided by what `largest` returns. Nodes named in `keep` stay in float. Zeros beyond the border
    of an image are not counted in the means.
    """
    tensors = {tensor.name: tensor for tensor in model.graph.initializer}
    found = [
        node
        for node in model.graph.node
        if node.op_type == "Conv"
        and node.name not in keep
        and len(node.input) == len(("input", "weights", "bias"))
        and {*node.input[1:]} <= tensors.keys()
    ]
    if not found:
        return 0
    inputs = means(sorted({node.input[0] for node in found}))
    for node in found:
        weights, bias = (tensors[name] for name in node.input[1:])
        values = numpy_helper.to_array(weights).astype(np.float64)
        lost = rounding(values, largest(values.shape, groups(node)))
        shift = _mean_output(lost, inputs[node.input[0]])
        corrected = (numpy_helper.to_array(bias) - shift).astype(np.float32)
        bias.CopyFrom(numpy_helper.from_array(corrected, bias.name))
    return len(found)


def groups(node: onnx.NodeProto) -> int:
    """The number of groups of a convolution."""
    return next((a.i for a in node.attribute if a.name == "group"), 1)


def rounding(weights: np.ndarray, largest: int) -> np.ndarray:
    """What rounding adds to weights `[out, in, kh, kw]`, per output channel and symmetric."""
    steps = np.abs(weights).max(axis=(1, 2, 3), keepdims=True) / largest
    steps = np.where(steps > 0.0, steps, 1.0)
    return np.rint(weights / steps) * steps - weights


def _mean_output(weights: np.ndarray, means: np.ndarray) -> np.ndarray:
    """The mean of each output channel of weights `[out, in, kh, kw]`, with input of `means`.

    With several groups, `in` is the number of input channels of one group.
    """
    count = means.size // weights.shape[1]
    summed = weights.sum(axis=(2, 3)).reshape(count, -1, weights.shape[1])
    return np.einsum("goi,gi->go", summed, means.reshape(count, -1)).ravel()
