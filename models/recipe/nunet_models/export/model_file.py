"""From a network to model files: one fused file, or a staged graph of several."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch

from nunet_models.errors import ExportError
from nunet_models.export.measure import (
    BF16_MARGIN,
    FP32_MARGIN,
    TORCH_BOUND,
    UNTRAINED_BOUND,
    check_against_torch,
    image_of,
    measured_selftest,
)
from nunet_models.export.metadata import inner_stage_metadata, metadata
from nunet_models.export.onnx_file import export_onnx, write_metadata
from nunet_models.zoo import SerialGraph
from nunet_models.zoo.confidence import CONFIDENCE
from nunet_models.zoo.deploy import FusedModel, StageModel


@dataclass(frozen=True)
class Provenance:
    """Where the weights come from, for the metadata."""

    trained: bool = False
    training: dict[str, Any] = field(default_factory=dict)
    accuracy: dict[str, Any] = field(default_factory=dict)
    license_text: str | None = None


def export_fused(graph: SerialGraph, path: Path, provenance: Provenance) -> None:
    """Write the whole graph as one model file, checked against torch, self-test inside.

    # Errors
    `ExportError` when the results of the file differ from the network's; an earlier file at
    `path` is kept then.
    """
    model = FusedModel(graph.eval())
    partial = path.with_suffix(".partial.onnx")
    try:
        export_onnx(model, model.example(torch.from_numpy(image_of(graph.spec))), partial)
        write_metadata(partial, _metadata(model, partial, provenance))
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def export_staged(graph: SerialGraph, path: Path, provenance: Provenance) -> None:
    """Write a staged graph: `path` is the TOML, and `STEM.STAGE.onnx` files are written next to it.

    The depth stage carries the metadata of the whole graph. The self-test is measured on a fused
    file, made for it and removed; the stages compute the same.

    # Errors
    `ExportError` as for `export_fused`, and for a recurrent graph: stages carry no state.
    """
    fused = path.with_suffix(".fused.onnx")
    model = FusedModel(graph.eval())
    if model.is_recurrent:
        raise ExportError("a recurrent graph cannot be staged", hint="write one `.onnx`")
    export_onnx(model, (torch.from_numpy(image_of(graph.spec)),), fused)
    try:
        whole = _metadata(model, fused, provenance)
    finally:
        fused.unlink()
    outputs: list[torch.Tensor] = []
    for index, component in enumerate(graph.spec.components):
        stage = StageModel(graph, index).eval()
        named = {"rgb": torch.from_numpy(image_of(graph.spec))}
        if outputs:
            named["features"] = outputs[-1]
        examples = tuple(named[name] for name in stage.input_names)
        stage_path = path.with_name(f"{path.stem}.{component.name}.onnx")
        export_onnx(stage, examples, stage_path)
        write_metadata(stage_path, whole if stage.last else inner_stage_metadata(graph.spec))
        with torch.no_grad():
            outputs.append(stage(*examples)[0])
    path.write_text(staged_toml(graph, path.stem), encoding="utf-8")


def staged_toml(graph: SerialGraph, stem: str) -> str:
    """The text of a staged graph: one `[[stage]]` per component, wired in order."""
    stages, results = [], {}
    before = None
    for index, component in enumerate(graph.spec.components):
        stage = StageModel(graph, index)
        sources = {"rgb": "image", "features": f"{before}.logits"}
        stages.append((component.name, {name: sources[name] for name in stage.input_names}))
        for output in set(stage.output_names) & {"depth", "labels", CONFIDENCE}:
            results[output] = f"{component.name}.{output}"
        before = component.name
    return graph_toml(stem, stages, results)


def graph_toml(stem: str, stages: list[tuple[str, dict[str, str]]], results: dict[str, str]) -> str:
    """The text of a staged graph: stages by name with their input sources, and the results."""
    lines = ["version = 1"]
    for name, inputs in stages:
        wires = ", ".join(f'{tensor} = "{source}"' for tensor, source in inputs.items())
        lines += [
            "",
            "[[stage]]",
            f'name = "{name}"',
            f'model = "{stem}.{name}.onnx"',
            f"inputs = {{ {wires} }}",
            "every = 1",
        ]
    lines += ["", "[outputs]"] + [f'{name} = "{results[name]}"' for name in sorted(results)]
    return "\n".join(lines) + "\n"


def _metadata(model: FusedModel, path: Path, provenance: Provenance) -> dict[str, str]:
    bound = TORCH_BOUND if provenance.trained else UNTRAINED_BOUND
    gap = check_against_torch(model, path, image_of(model.network.spec), bound=bound)
    measured = {
        "torch_max_difference": float(f"{gap:.3g}"),
        "selftest_margin": {"fp32": FP32_MARGIN, "bf16": BF16_MARGIN},
    }
    return metadata(
        model.network,
        selftest=measured_selftest(model, path),
        trained=provenance.trained,
        training={**provenance.training, **measured},
        accuracy=provenance.accuracy,
        license_text=provenance.license_text,
    )
