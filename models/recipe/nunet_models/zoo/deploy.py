"""The layers around the network in a model file: bytes in, depth and labels out."""

import torch
import torch.nn.functional as F
from torch import nn

from nunet_models.zoo import GraphSpec, SerialGraph
from nunet_models.zoo.confidence import CONFIDENCE, confidence_of

PIXEL_MEAN = 127.0
PIXEL_SCALE = 128.0
"""One normalization for every network, `(rgb - 127) / 128`: it is EfficientNet-Lite's own, and
also a DequantizeLinear, so that camera bytes can be the quantized tensor."""


def normalize(rgb: torch.Tensor) -> torch.Tensor:
    """Bytes 0..255 (any shape, any number type) to float32 -0.99..1."""
    return (rgb.float() - PIXEL_MEAN) / PIXEL_SCALE


def decode_depth(raw: torch.Tensor, spec: GraphSpec) -> torch.Tensor:
    """Raw numbers of a depth component to the graph's depth encoding, same shape.

    `metric`: the network works in log meters, where an error is relative. Nothing is clamped: the
    reader of the file invalidates depth outside `min_m..max_m`.
    """
    return raw.float().exp() if spec.encoding == "metric" else raw.float()


def confidence_bytes(log_error: torch.Tensor, size: tuple[int, int]) -> torch.Tensor:
    """Logarithms of expected errors `[B, 1, h, w]` to confidence, uint8 `[B, *size]`, bilinear."""
    levels = 255.0 * confidence_of(log_error)
    levels = F.interpolate(levels, size=size, mode="bilinear", align_corners=False)
    return levels.round().to(torch.uint8)[:, 0]


class ToInner(nn.Module):
    """uint8 `[1, H, W, 3]` to the normalized inner image, float32 `[1, 3, h, w]`."""

    def __init__(self, spec: GraphSpec) -> None:
        super().__init__()
        self.factors = spec.downsampling

    def forward(self, rgb: torch.Tensor) -> torch.Tensor:
        """Area downsampling first, so that the arithmetic runs on the smaller image."""
        planes = rgb.permute(0, 3, 1, 2).float()
        if self.factors != (1, 1):
            planes = F.avg_pool2d(planes, self.factors)
        return normalize(planes)


class FromInner(nn.Module):
    """Raw inner numbers back to the input's size."""

    def __init__(self, spec: GraphSpec) -> None:
        super().__init__()
        self.spec = spec

    def depth(self, raw: torch.Tensor) -> torch.Tensor:
        """Raw `[1, 1, h, w]` to decoded depth, float32 `[1, 1, H, W]`, bilinear."""
        depth = decode_depth(raw, self.spec)
        if self.spec.downsampling == (1, 1):
            return depth
        return F.interpolate(depth, size=self.spec.input_size, mode="bilinear", align_corners=False)

    def labels(self, logits: torch.Tensor) -> torch.Tensor:
        """Logits `[1, C, h, w]` to labels, uint8 `[1, H, W]`.

        ArgMax runs at the inner size and each label is then repeated: comparing interpolated
        logits would cost the square of the factor more, without more accurate edges. ONNX Runtime
        resizes bytes in half the time that Expand and Reshape take.
        """
        labels = logits.argmax(dim=1, keepdim=True).to(torch.uint8)
        if self.spec.downsampling != (1, 1):
            labels = F.interpolate(labels, size=self.spec.input_size, mode="nearest")
        return labels[:, 0]

    def confidence(self, log_error: torch.Tensor) -> torch.Tensor:
        """Logarithm of the expected error `[1, 1, h', w']` to confidence, uint8 `[1, H, W]`."""
        return confidence_bytes(log_error, self.spec.input_size)


class FusedModel(nn.Module):
    """A whole serial graph as one model file.

    `rgb` to `depth` and, if it segments, `labels`, and with a confidence head `confidence`.
    """

    def __init__(self, graph: SerialGraph) -> None:
        super().__init__()
        self.network = graph  # not `graph`: torch.fx keeps that name for itself
        self.to_inner = ToInner(graph.spec)
        self.from_inner = FromInner(graph.spec)
        tasks = [c.task for c in graph.spec.components]
        segmenting = [index for index, task in enumerate(tasks) if task == "segmentation"]
        self.segments = segmenting[-1] if segmenting else None  # trained the longest

    def forward(self, rgb: torch.Tensor, *state: torch.Tensor) -> tuple[torch.Tensor, ...]:
        """Tensors in the order of `input_names` to tensors in the order of `output_names`.

        Depth, labels and confidence; a recurrent graph also takes and returns its state.
        """
        image = self.to_inner(rgb)
        log_error = None
        if state:
            outputs, state = self.network.with_state(image, state)
        elif self.network.confidence is not None:
            outputs, log_error = self.network.with_confidence(image)
        else:
            outputs = self.network(image)
        results = [self.from_inner.depth(outputs[-1])]
        if self.segments is not None:
            results.append(self.from_inner.labels(outputs[self.segments]))
        if log_error is not None:
            results.append(self.from_inner.confidence(log_error))
        return (*results, *state)

    @property
    def is_recurrent(self) -> bool:
        """Whether the graph carries a state from frame to frame."""
        return self.network.spec.components[-1].is_recurrent

    @property
    def input_names(self) -> list[str]:
        """Names of the tensors that `forward` takes."""
        return ["rgb", *(given for given, _ in self.network.components[-1].state_names)]

    @property
    def output_names(self) -> list[str]:
        """Names of the tensors that `forward` gives."""
        results = ["depth"] if self.segments is None else ["depth", "labels"]
        if self.network.confidence is not None:
            results.append(CONFIDENCE)
        return [*results, *(taken for _, taken in self.network.components[-1].state_names)]

    def example(self, rgb: torch.Tensor) -> tuple[torch.Tensor, ...]:
        """Inputs for an image, the first of its stream."""
        return (rgb, *(self.network.components[-1].no_state() if self.is_recurrent else ()))


class StageModel(nn.Module):
    """One component of a serial graph as a model file of its own.

    Reads `rgb` if it is connected to the image, and `features` (raw numbers of the previous stage,
    `[1, C, h, w]`) unless it is the first. The last stage gives `depth` and, with a confidence
    head, `confidence`; an inner one gives `logits` and, if it segments, `labels`.
    """

    def __init__(self, graph: SerialGraph, index: int) -> None:
        super().__init__()
        self.component = graph.components[index]
        self.joint = graph.joint
        self.head = graph.confidence if index == len(graph.components) - 1 else None
        self.index = index
        self.spec = graph.spec
        self.to_inner = ToInner(graph.spec)
        self.from_inner = FromInner(graph.spec)

    @property
    def last(self) -> bool:
        """Whether this stage gives the graph's depth."""
        return self.index == len(self.spec.components) - 1

    @property
    def sees_image(self) -> bool:
        """Whether this stage reads the image."""
        return self.index == 0 or self.spec.components[self.index].connected

    @property
    def input_names(self) -> list[str]:
        """Names of the tensors that `forward` takes."""
        return ["rgb"] * self.sees_image + ["features"] * (self.index > 0)

    @property
    def output_names(self) -> list[str]:
        """Names of the tensors that `forward` gives."""
        if self.last:
            return ["depth"] if self.head is None else ["depth", CONFIDENCE]
        segments = self.spec.components[self.index].task == "segmentation"
        return ["logits", "labels"] if segments else ["logits"]

    def forward(self, *inputs: torch.Tensor) -> tuple[torch.Tensor, ...]:
        """Tensors in the order of `input_names` to tensors in the order of `output_names`."""
        named = dict(zip(self.input_names, inputs, strict=True))
        image = self.to_inner(named["rgb"]) if "rgb" in named else None
        before = [named["features"]] * self.index if "features" in named else []
        joined = self.joint(image, before)
        if self.head is not None:
            raw, maps = self.component.with_maps(joined)
            return self.from_inner.depth(raw), self.from_inner.confidence(self.head(maps))
        raw = self.component(joined)
        if self.last:
            return (self.from_inner.depth(raw),)
        if "labels" in self.output_names:
            return raw, self.from_inner.labels(raw)
        return (raw,)
