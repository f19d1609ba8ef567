"""Writing and running ONNX files."""

import warnings
from pathlib import Path

import numpy as np
import onnx
import onnxruntime as ort
import torch
from torch import nn

from nunet_models.errors import ConfigError

OPSET = 18  # the exporter's own set: nothing is converted, and ONNX Runtime 1.24 to 1.31 run it


def export_onnx(module: nn.Module, examples: tuple[torch.Tensor, ...], path: Path) -> None:
    """Write `module` to `path`, weights inside; it names its tensors itself.

    `module` has `input_names` and `output_names`; dimensions are those of `examples`, fixed.
    """
    module.eval()
    with torch.no_grad(), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # deprecations inside the exporter
        torch.onnx.export(
            module,
            examples,
            path,
            input_names=module.input_names,
            output_names=module.output_names,
            opset_version=OPSET,
            dynamo=True,
            external_data=False,
            optimize=True,
            verbose=False,
        )


def write_metadata(path: Path, values: dict[str, str]) -> None:
    """Set the file's `metadata_props` to `values`, and remove the exporter's own entries.

    Doc strings and stack traces of the exporter would carry the exporting machine's paths. The file
    is replaced atomically: a crash keeps the earlier file.
    """
    model = load_model(path)
    describe(model, values)
    save_whole(model, path)


def describe(model: onnx.ModelProto, values: dict[str, str]) -> None:
    """As `write_metadata`, for a model in memory."""
    for part in (model, model.graph, *model.graph.node):
        part.doc_string = ""
        del part.metadata_props[:]
    for value in (*model.graph.value_info, *model.graph.input, *model.graph.output):
        del value.metadata_props[:]
    for tensor in model.graph.initializer:
        del tensor.metadata_props[:]
    onnx.helper.set_model_props(model, values)
    model.producer_name, model.producer_version = "nunet_models", ""
    onnx.checker.check_model(model, full_check=True)


def save_whole(model: onnx.ModelProto, path: Path) -> None:
    """Write `model` atomically."""
    partial = path.with_name(f"{path.name}.partial")
    try:
        onnx.save(model, partial)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def load_model(path: Path) -> onnx.ModelProto:
    """An ONNX file, its weights inside it.

    # Errors
    `ConfigError` naming a file that is missing, truncated or not an ONNX file.
    """
    if not path.is_file():
        raise ConfigError(f"no model file `{path}`")
    if path.suffix == ".toml":
        raise ConfigError(
            f"`{path}` is a staged graph; expected an ONNX file",
            hint="use the fused `.onnx`, which computes the same",
        )
    try:
        return onnx.load(path, load_external_data=False)
    except Exception as error:  # protobuf's own, of several modules
        raise ConfigError(
            f"cannot read `{path}` as an ONNX file: {error}", hint="check that the file is complete"
        ) from error


def read_metadata(path: Path) -> dict[str, str]:
    """The file's `metadata_props`; errors as of `load_model`."""
    model = load_model(path)
    return {prop.key: prop.value for prop in model.metadata_props}


def session(
    path: Path,
    *,
    threads: int = 1,
    level: ort.GraphOptimizationLevel = ort.GraphOptimizationLevel.ORT_ENABLE_ALL,
) -> ort.InferenceSession:
    """A session on the CPU provider that does not spin while it waits.

    # Errors
    `ConfigError` naming a file that ONNX Runtime cannot open.
    """
    options = ort.SessionOptions()
    options.intra_op_num_threads = threads
    options.graph_optimization_level = level
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    # Without it, 8-bit sums saturate on x86 processors without VNNI. nunetd sets it too.
    options.add_session_config_entry("session.x64quantprecision", "1")
    try:
        return ort.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # ONNX Runtime's own, one class per kind without a common one
        raise ConfigError(f"ONNX Runtime cannot open `{path}`: {error}") from error


def run(path: Path, inputs: dict[str, np.ndarray], **how: object) -> dict[str, np.ndarray]:
    """Run a file once: named arrays in, named arrays out."""
    opened = session(path, **how)
    names = [output.name for output in opened.get_outputs()]
    return dict(zip(names, opened.run(names, inputs), strict=True))
