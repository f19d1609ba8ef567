"""Channels of a tensor brought to one range, so that one scale quantizes all of them well.

A tensor of activations has one scale. A channel that reaches a tenth of the tensor's range keeps
26 of its 256 steps. Between a convolution and the ones that read it, with nothing but ReLU,
addition, nearest upsampling and concatenation on the way, each channel can be divided by a factor
and the weights that read it multiplied by it: the float network computes the same. (Nagel et al.,
"Data-free quantization through weight equalization and bias correction", 2019.)
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import onnx
from onnx import numpy_helper

ChannelRanges = Callable[[list[str]], dict[str, np.ndarray]]
"""The largest magnitude of each channel of named tensors over the calibration images."""

LEAST_SHARE = 0.02
"""Channels that reach less of their tensor's range are treated as if they reached this much: they
say little, and rare values beyond the calibration images would be cut off."""


@dataclass(frozen=True)
class Reader:
    """A convolution that reads the channels of a tensor from `first` on."""

    node: onnx.NodeProto
    first: int


@dataclass
class Site:
    """Tensors whose channels are scaled together: the links of a residual chain, or one tensor.

    `ranged` are those of them that get a scale of their own: what only a ReLU reads gets none.
    `makers` are the convolutions that they come from, `readers` those that read them, `beside` the
    other tensors of the concatenations on the way: one scale quantizes all of them.
    """

    tensors: list[str] = field(default_factory=list)
    ranged: list[str] = field(default_factory=list)
    makers: list[onnx.NodeProto] = field(default_factory=list)
    readers: list[Reader] = field(default_factory=list)
    beside: list[str] = field(default_factory=list)


def equalize_channels(model: onnx.ModelProto, ranges: ChannelRanges) -> int:
    """Scale the channels of every site in place; returns how many sites there are.

    Every channel of a site then reaches 1, or the range of the tensors that are concatenated with
    it and cannot be scaled.
    Channels that are 0 over all calibration images are left as they are.
    """
    sites = _sites(model)
    if not sites:
        return 0
    scaled = {name for site in sites for name in site.tensors}
    fixed = {name for site in sites for name in site.beside} - scaled
    found = ranges(sorted({name for site in sites for name in site.ranged} | fixed))
    for site in sites:
        own = np.max([found[name] for name in site.ranged], axis=0)
        if not own.max() > 0.0:
            continue
        beside = [float(found[name].max()) for name in site.beside if name in fixed]
        factors = np.maximum(own, LEAST_SHARE * own.max()) / max(beside, default=1.0)
        for maker in site.makers:
            _divide_outputs(model, maker, factors)
        for reader in site.readers:
            _multiply_inputs(model, reader, factors)
    return len(sites)


def _sites(model: onnx.ModelProto) -> list[Site]:
    links = _Links.of(model)
    found: list[Site] = []
    done: set[str] = set()
    for node in model.graph.node:
        if node.op_type != "Conv" or node.output[0] in done:
            continue
        search = _Search(links)
        whole = search.include(node.output[0])
        done.update(search.site.tensors)
        if whole and search.site.readers:
            found.append(search.site)
    return found


@dataclass(frozen=True)
class _Links:
    """The producer and the consumers of each tensor of a graph."""

    makers: dict[str, onnx.NodeProto]
    consumers: dict[str, list[onnx.NodeProto]]
    shapes: dict[str, list[int]]
    outputs: set[str]

    @classmethod
    def of(cls, model: onnx.ModelProto) -> "_Links":
        consumers: dict[str, list[onnx.NodeProto]] = {}
        for node in model.graph.node:
            for name in node.input:
                consumers.setdefault(name, []).append(node)
        return cls(
            {output: node for node in model.graph.node for output in node.output},
            consumers,
            {tensor.name: list(tensor.dims) for tensor in model.graph.initializer},
            {output.name for output in model.graph.output},
        )

    def channels(self, tensor: str) -> int | None:
        """Channels of a tensor, from the convolutions that make it; None if unknown."""
        node = self.makers.get(tensor)
        if node is None:
            return None
        if node.op_type == "Conv":
            return self.shapes[node.input[1]][0]
        if node.op_type == "Concat":
            widths = [self.channels(name) for name in node.input]
            return None if None in widths else sum(widths)
        return self.channels(node.input[0]) if node.op_type in _SAME_CHANNELS else None

    def source(self, tensor: str) -> str:
        """What a tensor is a copy of: upsampling to the nearest keeps ranges."""
        node = self.makers.get(tensor)
        return self.source(node.input[0]) if node and node.op_type == "Resize" else tensor


_SAME_CHANNELS = {"Relu", "Clip", "Resize", "Add"}


class _Search:
    """Finds all that must be scaled with a tensor; each method says whether it can be."""

    def __init__(self, links: _Links) -> None:
        self.links, self.site = links, Site()

    def include(self, tensor: str) -> bool:
        """`tensor`, what makes it and what reads it."""
        if tensor in self.site.tensors:
            return True
        self.site.tensors.append(tensor)
        if any(reader.op_type != "Relu" for reader in self.links.consumers.get(tensor, [])):
            self.site.ranged.append(tensor)
        node = self.links.makers.get(tensor)
        return node is not None and self._made_by(node) and self._read(tensor, 0)

    def _made_by(self, node: onnx.NodeProto) -> bool:
        if node.op_type == "Conv":
            self.site.makers.append(node)
            return len(node.input) == 3
        if node.op_type == "Relu":
            return self.include(node.input[0])
        return node.op_type == "Add" and all(self.include(name) for name in node.input)

    def _read(self, tensor: str, first: int) -> bool:
        nodes = self.links.consumers.get(tensor, [])
        if tensor in self.links.outputs or not nodes:
            return False
        return all(self._through(node, tensor, first) for node in nodes)

    def _through(self, node: onnx.NodeProto, tensor: str, first: int) -> bool:
        if node.op_type == "Conv":
            self.site.readers.append(Reader(node, first))
            return node.input[0] == tensor and _integer(node, "group", 1) == 1
        if node.op_type in {"Relu", "Add"}:
            return first == 0 and self.include(node.output[0])
        if node.op_type == "Concat":
            return self._concatenated(node, tensor, first)
        if node.op_type == "Resize" and _text(node, "mode", "nearest") == "nearest":
            return self._read(node.output[0], first)
        return False

    def _concatenated(self, node: onnx.NodeProto, tensor: str, first: int) -> bool:
        inputs = list(node.input)
        if _integer(node, "axis", 0) != 1 or inputs.count(tensor) != 1:
            return False
        widths = [self.links.channels(name) for name in inputs[: inputs.index(tensor)]]
        self.site.beside += [self.links.source(name) for name in inputs if name != tensor]
        return None not in widths and self._read(node.output[0], first + sum(widths))


def _integer(node: onnx.NodeProto, name: str, default: int) -> int:
    return next((a.i for a in node.attribute if a.name == name), default)


def _text(node: onnx.NodeProto, name: str, default: str) -> str:
    return next((a.s.decode() for a in node.attribute if a.name == name), default)


def _divide_outputs(model: onnx.ModelProto, conv: onnx.NodeProto, factors: np.ndarray) -> None:
    _change(model, conv.input[1], lambda w: w / factors[:, None, None, None])
    _change(model, conv.input[2], lambda b: b / factors)


def _multiply_inputs(model: onnx.ModelProto, reader: Reader, factors: np.ndarray) -> None:
    def scaled(weights: np.ndarray) -> np.ndarray:
        weights = weights.copy()
        weights[:, reader.first : reader.first + len(factors)] *= factors[None, :, None, None]
        return weights

    _change(model, reader.node.input[1], scaled)


def _change(model: onnx.ModelProto, name: str, change: Callable[[np.ndarray], np.ndarray]) -> None:
    tensor = next(t for t in model.graph.initializer if t.name == name)
    values = change(numpy_helper.to_array(tensor)).astype(np.float32)
    tensor.CopyFrom(numpy_helper.from_array(values, name))
