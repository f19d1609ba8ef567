"""Static quantization (QDQ, per channel) of a fused model file."""

import json
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime as ort
from onnxruntime.quantization import (
    CalibrationDataReader,
    CalibrationMethod,
    QuantFormat,
    QuantType,
    quantize_static,
)
from tqdm import tqdm

from nunet_models.errors import ConfigError
from nunet_models.evaluation.predict import Predictor
from nunet_models.export.measure import INT8_MARGIN, quantized_selftest
from nunet_models.export.metadata import to_json
from nunet_models.export.onnx_file import load_model, read_metadata, write_metadata
from nunet_models.export.selftest import selftest_image
from nunet_models.quantization.biases import correct_biases, groups
from nunet_models.quantization.equalize import equalize_channels
from nunet_models.quantization.rewrites import balance_joints, double_by_copies

QUANTIZED = ("Conv", "Gemm", "MatMul", "Add", "Concat", "Resize", "Clip", "Relu", "AveragePool")
"""Operators that are faster in integers. ArgMax and Exp stay in float: neither is arithmetic-bound,
and the logarithm of depth in 256 steps over four octaves would be off by 1 % of each depth."""

METHODS = {
    "minmax": CalibrationMethod.MinMax,
    "percentile": CalibrationMethod.Percentile,
    "entropy": CalibrationMethod.Entropy,
}


@dataclass(frozen=True)
class Plan:
    """How to quantize: calibration method, which nodes stay in float, and the weights' range.

    `float_heads` keeps the convolution before each result in float: its output is read as a
    number, not as a feature. `float_nodes` names further ones. `equalize` brings channels to one
    range first (see `equalize_channels`). `reduce_range` uses 7 bits of weights (see
    `largest_weight`): with 8, the 16-bit sums of x86 processors without VNNI saturate, and exact
    sums take longer there.
    `correct_biases` keeps the means of outputs (see the function).
    """

    method: str = "minmax"
    float_heads: bool = True
    float_nodes: tuple[str, ...] = ()
    equalize: bool = True
    correct_biases: bool = True
    reduce_range: bool = True

    def largest_weight(self, shape: Sequence[int], groups: int) -> int:
        """The magnitude to which the largest weight of an output channel is rounded.

        `shape` is that of a convolution's weights, `[out, in, kh, kw]`. Two products of 255 and 64
        fit into 16 bits. Depth-wise convolutions, whose channels have few weights, sum in 32 bits.
        """
        return 64 if self.reduce_range and not _depthwise(shape, groups) else 127


def _depthwise(shape: Sequence[int], groups: int) -> bool:
    return shape[0] == groups > 1 == shape[1]


class _Images(CalibrationDataReader):
    """Feeds images, uint8 `[H, W, 3]` each, to the calibrator."""

    def __init__(self, images: Iterator[np.ndarray], predictor: Predictor) -> None:
        self.images, self.predictor = images, predictor

    def get_next(self) -> dict[str, np.ndarray] | None:
        rgb = next(self.images, None)
        return None if rgb is None else self.predictor.inputs(rgb)


def quantize(
    path: Path,
    out: Path,
    images: Iterator[np.ndarray],
    plan: Plan,
    *,
    calibration: dict[str, Any] | None = None,
) -> dict[str, str]:
    """Write the quantized file of `path` to `out` with its own self-test; returns its metadata.

    `calibration` describes `images` in the metadata. The accuracy of `path` is not copied: measure
    the new file (see `annotate`). An earlier file at `out` is replaced only at the end.

    # Errors
    `ConfigError` for a file that is quantized already or recurrent, and without an image.
    """
    values = read_metadata(path)
    _check_precision(path, values)
    model = load_model(path)
    keep = [*plan.float_nodes, *(heads(model) if plan.float_heads else ())]
    _check_names(path, model, keep)
    shown = list(images)
    if not shown:
        raise ConfigError("no image to calibrate on; expected one or more")
    prepared = _prepare(model, shown, plan, keep, Predictor(path))
    quantized = _quantized(model, shown, plan, keep)
    double_by_copies(quantized)
    training = json.loads(values["nunet.training"])
    training["quantisation"] = {
        "method": plan.method,
        "weight_bits": 7 if plan.reduce_range else 8,
        "depthwise_weight_bits": 8,
        "float_nodes": keep,
        **prepared,
        "margin": INT8_MARGIN,
        "calibration": {"used": len(shown), **(calibration or {})},
    }
    values["nunet.training"] = to_json(training)
    values["nunet.accuracy"] = to_json({})  # the float file's metrics are not this one's
    _save(quantized, values, out)
    return values


def _prepare(
    model: onnx.ModelProto,
    images: list[np.ndarray],
    plan: Plan,
    keep: list[str],
    predictor: Predictor,
) -> dict[str, Any]:
    """Change weights of `model` in place, before it is quantized; returns what the file states."""
    factors = balance_joints(model, lambda names: _magnitudes(model, names, images, predictor))
    equalized = corrected = 0
    if plan.equalize:
        equalized = equalize_channels(model, lambda n: _channel_ranges(model, n, images, predictor))
    if plan.correct_biases:
        corrected = correct_biases(
            model, lambda n: _channel_means(model, n, images, predictor), plan.largest_weight, keep
        )
    return {"joints": factors, "equalized_sites": equalized, "corrected_biases": corrected}


def _check_precision(path: Path, values: dict[str, str]) -> None:
    """Refuse what is no float file of independent images."""
    if json.loads(values.get("nunet.selftest", "{}")).get("precision") != "fp32":
        raise ConfigError(f"`{path}` is not an fp32 model file")
    if "nunet.state" in values:
        raise ConfigError(
            f"`{path}` is recurrent; calibration images are independent, so its state would be "
            "quantized to 0",
            hint="use the fp32 file",
        )


def _check_names(path: Path, model: onnx.ModelProto, keep: list[str]) -> None:
    """Refuse names of nodes that `model` does not have."""
    known = {node.name for node in model.graph.node}
    unknown = [name for name in keep if name not in known]
    if unknown:
        raise ConfigError(f"`{path.name}` has no node `{unknown[0]}` to keep in float")


def _save(model: onnx.ModelProto, values: dict[str, str], out: Path) -> None:
    """Write `model` with `values` and its own self-test, which is added to `values`."""
    partial = out.with_suffix(".partial.onnx")
    try:
        onnx.save(model, partial)
        write_metadata(partial, values)
        predictor = Predictor(partial)
        image = selftest_image(*predictor.size[::-1])
        selftest = quantized_selftest(partial, predictor.inputs(image), predictor)
        values["nunet.selftest"] = to_json(selftest)
        write_metadata(partial, values)
        partial.replace(out)
    finally:
        partial.unlink(missing_ok=True)


def _quantized(
    model: onnx.ModelProto, images: list[np.ndarray], plan: Plan, keep: list[str]
) -> onnx.ModelProto:
    """`model` in integers, ranges taken over `images`, nodes named in `keep` left in float."""
    with tempfile.TemporaryDirectory() as scratch:
        raw, balanced = Path(scratch) / "quantized.onnx", Path(scratch) / "balanced.onnx"
        onnx.save(model, balanced)
        quantize_static(
            str(balanced),
            str(raw),
            _Images(iter(_shown("calibration", images)), Predictor(balanced)),
            quant_format=QuantFormat.QDQ,
            op_types_to_quantize=list(QUANTIZED),
            nodes_to_exclude=keep,
            per_channel=True,
            reduce_range=plan.reduce_range,
            activation_type=QuantType.QUInt8,
            weight_type=QuantType.QInt8,
            calibrate_method=METHODS[plan.method],
            calibration_cache_path=None,
            extra_options={"TensorQuantOverrides": _eight_bits(model, keep)},
        )
        return onnx.load(raw)


def _eight_bits(model: onnx.ModelProto, keep: list[str]) -> dict[str, list[dict[str, Any]]]:
    """The weights of depth-wise convolutions, which keep 8 bits, as onnxruntime expects it."""
    shapes = {tensor.name: tensor.dims for tensor in model.graph.initializer}
    full = {"quant_type": QuantType.QInt8, "axis": 0, "symmetric": True, "reduce_range": False}
    return {
        node.input[1]: [dict(full)]
        for node in model.graph.node
        if node.op_type == "Conv"
        and node.name not in keep
        and node.input[1] in shapes
        and _depthwise(shapes[node.input[1]], groups(node))
    }


def _shown(what: str, images: list[np.ndarray]) -> Iterable[np.ndarray]:
    """`images` with a progress bar if stderr is a terminal."""
    return tqdm(images, desc=what, unit="image", disable=None)


def _magnitudes(
    model: onnx.ModelProto, names: list[str], images: list[np.ndarray], predictor: Predictor
) -> dict[str, float]:
    """The largest magnitude of each named tensor over `images`."""
    found = _channel_ranges(model, names, images, predictor)
    return {name: float(values.max()) for name, values in found.items()}


def _channel_ranges(
    model: onnx.ModelProto, names: list[str], images: list[np.ndarray], predictor: Predictor
) -> dict[str, np.ndarray]:
    """The largest magnitude of each channel of named tensors `[1, C, h, w]` over `images`."""
    largest: dict[str, np.ndarray] = {}
    for values in _inner_values(model, names, _shown("ranges of channels", images), predictor):
        for name, value in values.items():
            found = np.abs(value).max(axis=(0, 2, 3))
            largest[name] = np.maximum(largest.get(name, 0.0), found)
    return largest


def _channel_means(
    model: onnx.ModelProto, names: list[str], images: list[np.ndarray], predictor: Predictor
) -> dict[str, np.ndarray]:
    """The mean of each channel of named tensors `[1, C, h, w]` over `images`."""
    sums: dict[str, np.ndarray] = {}
    for values in _inner_values(model, names, _shown("means of channels", images), predictor):
        for name, value in values.items():
            sums[name] = sums.get(name, 0.0) + value.mean(axis=(0, 2, 3), dtype=np.float64)
    return {name: value / len(images) for name, value in sums.items()}


def _inner_values(
    model: onnx.ModelProto, names: list[str], images: Iterable[np.ndarray], predictor: Predictor
) -> Iterator[dict[str, np.ndarray]]:
    """The values of named tensors inside a graph, by name, image by image."""
    probe = onnx.ModelProto()
    probe.CopyFrom(model)
    del probe.graph.output[:]
    probe.graph.output.extend(
        onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, None) for name in names
    )
    session = ort.InferenceSession(probe.SerializeToString(), providers=["CPUExecutionProvider"])
    for rgb in images:
        found = session.run(names, predictor.inputs(rgb))
        yield dict(zip(names, found, strict=True))


def heads(model: onnx.ModelProto) -> list[str]:
    """Names of the nodes whose numbers reach a result through no further convolution.

    What only ArgMax reads is compared, not read as a number, and needs no more than 256 steps.
    """
    by_output = {output: node for node in model.graph.node for output in node.output}
    found: list[str] = []
    waiting = [output.name for output in model.graph.output]
    seen = set()
    while waiting:
        node = by_output.get(waiting.pop())
        if node is None or node.name in seen or node.op_type == "ArgMax":
            continue
        seen.add(node.name)
        if node.op_type in {"Conv", "Gemm", "MatMul"}:
            found.append(node.name)
        else:
            waiting += node.input
    return sorted(found)
