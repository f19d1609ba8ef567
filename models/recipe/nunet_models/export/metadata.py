"""The model file's metadata (docs/book/model-file.md), built from a spec and from measurement."""

import json
from dataclasses import asdict
from functools import partial
from typing import Any

import torch
from torch import nn
from torch.utils.flop_counter import FlopCounterMode

from nunet_models.zoo import GraphSpec, SerialGraph

DATA_LICENSE = (
    "weights: MIT OR Apache-2.0 as far as the makers can license them; trained on NYU Depth V2, "
    "whose makers allow research use"
)
UNTRAINED_LICENSE = "MIT OR Apache-2.0; random weights"


def metadata(
    graph: SerialGraph,
    *,
    selftest: dict[str, Any],
    trained: bool,
    training: dict[str, Any],
    accuracy: dict[str, Any],
    license_text: str | None = None,
    targets: str = "cpu,openvino",
) -> dict[str, str]:
    """Every key of the contract; JSON values in compact form.

    Without a `license_text` it is NYU Depth V2's, or that of random weights.
    """
    spec = graph.spec
    values: dict[str, Any] = {
        "nunet.version": "1",
        "nunet.architecture": spec.architecture,
        "nunet.components": describe_components(graph),
        "nunet.depth.encoding": spec.encoding,
        "nunet.depth.min_m": str(spec.min_m),
        "nunet.depth.max_m": str(spec.max_m),
        "nunet.camera": asdict(spec.camera),
        "nunet.inner_size": list(spec.inner_size),
        "nunet.trained": "true" if trained else "false",
        "nunet.training": training,
        "nunet.accuracy": accuracy,
        "nunet.license": license_text or (DATA_LICENSE if trained else UNTRAINED_LICENSE),
        "nunet.targets": targets,
        "nunet.selftest": selftest,
    }
    if any(c.task == "segmentation" for c in spec.components):
        values["nunet.classes"] = list(spec.classes)
    if spec.components[-1].is_recurrent:
        last = graph.components[-1]
        values["nunet.state"] = [
            {"input": given, "output": taken, "shape": list(tensor.shape)}
            for (given, taken), tensor in zip(last.state_names, last.no_state(), strict=True)
        ]
    return {k: v if isinstance(v, str) else to_json(v) for k, v in values.items()}


def inner_stage_metadata(spec: GraphSpec) -> dict[str, str]:
    """Metadata of an inner stage of a staged graph; the depth stage carries the rest."""
    return {
        "nunet.version": "1",
        "nunet.classes": to_json(list(spec.classes)),
        "nunet.inner_size": to_json(list(spec.inner_size)),
    }


def to_json(value: object) -> str:
    """Compact JSON without NaN and infinities."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False)


def describe_components(graph: SerialGraph) -> list[dict[str, Any]]:
    """Name, task, backbone, connection, parameters and measured GFLOP of every component."""
    return [
        {
            "name": spec.name,
            "task": spec.task,
            "backbone": spec.backbone,
            "connected": spec.connected and index > 0,
            "parameters": sum(p.numel() for p in module.parameters()),
            "gflop": round(operations / 1e9, 4),
        }
        for index, (spec, module, operations) in enumerate(
            zip(graph.spec.components, graph.components, _operations(graph), strict=True)
        )
    ]


def _operations(graph: SerialGraph) -> list[int]:
    """Floating-point operations of every component for one image."""
    counted = []

    def run(module: nn.Module, x: torch.Tensor) -> torch.Tensor:
        with FlopCounterMode(display=False) as counter:
            raw = module(x)
        counted.append(counter.get_total_flops())
        return raw

    with torch.no_grad():
        image = torch.zeros(1, 3, *graph.spec.inner_size)
        graph.run(image, [partial(run, module) for module in graph.components])
    return counted
