"""Splits a fused model file of two components at its joint into a staged graph."""

from pathlib import Path

import onnx
from onnx.utils import Extractor

from nunet_models.errors import ExportError
from nunet_models.export.joints import connected_joints
from nunet_models.export.model_file import graph_toml
from nunet_models.export.onnx_file import describe, load_model, read_metadata, save_whole
from nunet_models.zoo.confidence import CONFIDENCE

FEATURES, LOGITS = "features", "logits"
OF_AN_INNER_STAGE = ("nunet.version", "nunet.classes", "nunet.inner_size")


def split(fused: Path, out: Path, *, names: tuple[str, str] = ("segmentation", "depth")) -> None:
    """Write `out`, the TOML of a staged graph, and next to it one `STEM.NAME.onnx` per stage.

    The file is split at the features of the connected joint. The stages give the same results as
    the fused file, bit for bit: quantized features are dequantized on their way out and quantized
    again with the same scale. (Features that were balanced before quantization keep their factor:
    the labels are the same, the logits are scaled.)

    # Errors
    `ExportError` if the file has no connected joint, more than one, or is recurrent, or has no
    labels. Nothing is written then.
    """
    model = load_model(fused)
    values = read_metadata(fused)
    if "nunet.state" in values:
        raise ExportError(
            f"`{fused.name}` is recurrent, and stages carry no state", hint="run the fused `.onnx`"
        )
    given = {output.name for output in model.graph.output}
    if "labels" not in given:
        raise ExportError(
            f"`{fused.name}` has no labels, and its first stage would have no result",
            hint="`export --checkpoint CHECKPOINT --out NAME.toml` writes its components",
        )
    features = _features(model, fused)
    first = _part(model, ["rgb"], [features, "labels"])
    of_depth = ["depth", *({CONFIDENCE} & given)]
    second = _part(model, ["rgb", features], of_depth)
    _rename(first, features, LOGITS)
    _rename(second, features, FEATURES)
    _as_integers_again(second, model, features)
    inner = {key: values[key] for key in OF_AN_INNER_STAGE if key in values}
    describe(first, inner)
    describe(second, values)
    out.parent.mkdir(parents=True, exist_ok=True)
    for part, name in ((first, names[0]), (second, names[1])):
        save_whole(part, out.with_name(f"{out.stem}.{name}.onnx"))
    wires = {"rgb": "image", FEATURES: f"{names[0]}.{LOGITS}"}
    stages = [(names[0], {"rgb": "image"}), (names[1], wires)]
    results = {name: f"{names[1]}.{name}" for name in of_depth}
    results["labels"] = f"{names[0]}.labels"
    out.write_text(graph_toml(out.stem, stages, results), encoding="utf-8")


def _features(model: onnx.ModelProto, path: Path) -> str:
    """The tensor that crosses the joint: what is concatenated with the image, behind it."""
    found = [features for _, features in connected_joints(model)]
    if len(found) != 1:
        raise ExportError(
            f"`{path.name}` has {len(found)} connected joints",
            hint="only a graph of two connected components can be split",
        )
    return found[0]


def _part(model: onnx.ModelProto, inputs: list[str], outputs: list[str]) -> onnx.ModelProto:
    inferred = onnx.shape_inference.infer_shapes(model)
    return Extractor(inferred).extract_model(inputs, outputs)


def _rename(part: onnx.ModelProto, old: str, new: str) -> None:
    for node in part.graph.node:
        for names in (node.input, node.output):
            for index, name in enumerate(names):
                if name == old:
                    names[index] = new
    for value in (*part.graph.input, *part.graph.output):
        if value.name == old:
            value.name = new


def _as_integers_again(part: onnx.ModelProto, whole: onnx.ModelProto, features: str) -> None:
    """Quantize the incoming features with their former scale; nothing for a float file."""
    maker = next(node for node in whole.graph.node if features in node.output)
    if maker.op_type != "DequantizeLinear":
        return
    parameters = list(maker.input[1:])
    have = {tensor.name for tensor in part.graph.initializer}
    part.graph.initializer.extend(
        tensor
        for tensor in whole.graph.initializer
        if tensor.name in parameters and tensor.name not in have
    )
    arrived, back = f"{FEATURES}_integers", f"{FEATURES}_numbers"
    _rename(part, FEATURES, back)
    next(value for value in part.graph.input if value.name == back).name = FEATURES
    node = onnx.helper.make_node
    arriving = [
        node("QuantizeLinear", [FEATURES, *parameters], [arrived], arrived),
        node("DequantizeLinear", [arrived, *parameters], [back], back),
    ]
    nodes = [*arriving, *part.graph.node]
    del part.graph.node[:]
    part.graph.node.extend(nodes)
