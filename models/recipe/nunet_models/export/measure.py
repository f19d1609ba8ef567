"""Measures a model file at export: difference to the network, and spread between runtimes."""

from pathlib import Path
from typing import Protocol

import numpy as np
import onnxruntime as ort
import torch

from nunet_models.errors import ExportError
from nunet_models.export.onnx_file import run
from nunet_models.export.selftest import SelfTestGrid, grid_from_outputs, selftest_image
from nunet_models.zoo import GraphSpec
from nunet_models.zoo.confidence import CONFIDENCE
from nunet_models.zoo.deploy import FusedModel

FP32_MARGIN = 10.0  # other processors and providers differ more than one machine's settings
INT8_MARGIN = 3.0  # integer sums are exact, but providers fuse and round in other places
INT8_LABEL_CELLS = 3  # of 48; OpenVINO 1.24 differs from ONNX Runtime's own kernels in two
BF16_MARGIN = 3.0  # bf16 differs much; three times that still detects a wrong channel
FLOOR = 0.001  # in the depth's unit: smaller errors do not matter
TORCH_BOUND = 0.001  # largest difference of a pixel between torch and ONNX Runtime, meters
CONFIDENCE_BOUND = 2  # levels of 255: rounding, and the error's exponential of an exponential
UNTRAINED_BOUND = 0.01  # random weights magnify rounding more than trained ones

_LEVELS = (
    ort.GraphOptimizationLevel.ORT_DISABLE_ALL,
    ort.GraphOptimizationLevel.ORT_ENABLE_BASIC,
    ort.GraphOptimizationLevel.ORT_ENABLE_EXTENDED,
    ort.GraphOptimizationLevel.ORT_ENABLE_ALL,
)


def image_of(spec: GraphSpec) -> np.ndarray:
    """The self-test image as the model's input, uint8 `[1, H, W, 3]`."""
    height, width = spec.input_size
    return selftest_image(width, height)[None]


class DepthLimits(Protocol):
    """What decoding needs: a `GraphSpec`, or a model file's reader."""

    encoding: str
    min_m: float
    max_m: float


def decoded(depth: np.ndarray, spec: DepthLimits) -> np.ndarray:
    """Depth as the daemon publishes it: NaN where there is no measurement; same shape."""
    valid = np.isfinite(depth)
    if spec.encoding == "metric":
        valid &= (depth >= spec.min_m) & (depth <= spec.max_m)
    elif spec.encoding == "minmax":
        depth = depth.clip(0.0, 1.0)
    return np.where(valid, depth, np.float32(np.nan))


def selftest_grid(outputs: dict[str, np.ndarray], spec: DepthLimits) -> SelfTestGrid:
    """The self-test's grid of a model's outputs on the self-test image."""
    return grid_from_outputs(decoded(outputs["depth"], spec), outputs.get("labels"))


def named_inputs(model: FusedModel, rgb: np.ndarray) -> dict[str, np.ndarray]:
    """Inputs of ONNX Runtime for `rgb`, uint8 `[1, H, W, 3]`: a state starts at zero."""
    example = model.example(torch.from_numpy(rgb))
    return {n: v.numpy() for n, v in zip(model.input_names, example, strict=True)}


def torch_outputs(model: FusedModel, rgb: np.ndarray, *, bf16: bool = False) -> dict:
    """Outputs by name of the torch network; `bf16` runs its convolutions in bfloat16."""
    with torch.inference_mode(), torch.autocast("cpu", torch.bfloat16, enabled=bf16):
        values = model(*model.example(torch.from_numpy(rgb)))
    return {n: v.numpy() for n, v in zip(model.output_names, values, strict=True)}


def check_against_torch(
    model: FusedModel, path: Path, rgb: np.ndarray, *, bound: float = TORCH_BOUND
) -> float:
    """Largest depth difference between torch and ONNX Runtime on `rgb`, in the depth's unit.

    # Errors
    `ExportError` when it exceeds `bound`.
    """
    ours, theirs = torch_outputs(model, rgb), run(path, named_inputs(model, rgb))
    gap = float(np.abs(theirs["depth"] - ours["depth"]).max())
    if not gap <= bound:
        raise ExportError(
            f"`{path.name}` differs from the network by {gap:.3g} at the worst pixel, "
            f"more than {bound}"
        )
    if CONFIDENCE in ours:
        _check_confidence(path, theirs[CONFIDENCE], ours[CONFIDENCE])
    return gap


def _check_confidence(path: Path, theirs: np.ndarray, ours: np.ndarray) -> None:
    gap = int(np.abs(theirs.astype(int) - ours.astype(int)).max())
    if gap > CONFIDENCE_BOUND:
        raise ExportError(
            f"confidence of `{path.name}` differs from the network's by {gap} levels at the worst "
            f"pixel, more than {CONFIDENCE_BOUND}"
        )


def measured_selftest(model: FusedModel, path: Path) -> dict:
    """Run the self-test through every optimization level and thread count; `nunet.selftest`."""
    spec = model.network.spec
    rgb = image_of(spec)
    grids = _grids_over_settings(path, named_inputs(model, rgb), spec)
    others = [*grids[1:], selftest_grid(torch_outputs(model, rgb), spec)]
    bf16 = selftest_grid(torch_outputs(model, rgb, bf16=True), spec)
    tolerance = {
        "fp32": _tolerance(grids[0], others, FP32_MARGIN),
        "bf16": _tolerance(grids[0], [bf16], BF16_MARGIN),
    }
    return grids[0].to_json(precision="fp32", tolerance=tolerance)


def quantized_selftest(path: Path, inputs: dict[str, np.ndarray], limits: DepthLimits) -> dict:
    """The same for a quantized file, which torch cannot check; `inputs` hold the image."""
    grids = _grids_over_settings(path, inputs, limits)
    tolerance = _tolerance(grids[0], grids[1:], INT8_MARGIN)
    tolerance["label_cells"] = max(INT8_LABEL_CELLS, tolerance["label_cells"])
    return grids[0].to_json(precision="int8", tolerance={"int8": tolerance})


def _grids_over_settings(
    path: Path, inputs: dict[str, np.ndarray], limits: DepthLimits
) -> list[SelfTestGrid]:
    """Grids at every optimization level with one and two threads, the default first."""
    settings = [(level, threads) for level in reversed(_LEVELS) for threads in (1, 2)]
    return [
        selftest_grid(run(path, inputs, threads=t, level=level), limits) for level, t in settings
    ]


def _tolerance(grid: SelfTestGrid, others: list[SelfTestGrid], margin: float) -> dict[str, float]:
    distances = [grid.distance(other) for other in others]
    depth = max(FLOOR, margin * max(depth for depth, _ in distances))
    cells = int(margin * max(cells for _, cells in distances)) + grid.close_calls
    if not np.isfinite(depth):
        raise ExportError("a self-test cell has depth in one run and none in another")
    return {"depth": round(depth, 6), "label_cells": cells}
