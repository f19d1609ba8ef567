"""Sets of model files: the test models and the paper's networks."""

from dataclasses import replace
from pathlib import Path

from nunet_models.export.model_file import Provenance, export_fused, export_staged
from nunet_models.export.untrained import untrained_graph
from nunet_models.zoo import PAPER_DECODER, GraphSpec, SerialGraph, graph_spec
from nunet_models.zoo.backbones import TINY
from nunet_models.zoo.dense import DENSE

TINY_DECODER = (8, 8, 8, 6, 4)
TINY_SIZE = (96, 128)
TINY_SEED = 7
TINY_CONFIDENCE = "tiny_unet_confidence.onnx"
TINY_WIDTH = 0.05  # of the dense systems' hidden layers
TINY_DENSE_SIZE = (48, 64)  # a dense layer has one row per pixel: half the image's size
TINY_ARCHITECTURES = (
    *("unet", "wnet", "wnet_c", "cnn", "rcnn", "unet_cnn", "unet_rcnn"),
    *("nunet3", "nunet3_c", "wnet_c_lstm"),
)
PAPER_SIZE = (480, 640)


def export_tiny(folder: Path) -> list[Path]:
    """Write the small test models: every architecture fused, W-Net Connected staged as well.

    The staged files hold the same weights as the fused one and give the same depth. One more U-Net
    has a confidence head.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for architecture in TINY_ARCHITECTURES:
        graph = untrained_graph(tiny_spec(architecture), seed=TINY_SEED)
        written.append(folder / f"tiny_{architecture}.onnx")
        export_fused(graph, written[-1], Provenance())
        if architecture == "wnet_c":
            written.append(folder / f"tiny_{architecture}.toml")
            export_staged(graph, written[-1], Provenance())
    written.append(folder / TINY_CONFIDENCE)
    export_fused(tiny_confidence(), written[-1], Provenance())
    return written


def tiny_confidence() -> SerialGraph:
    """The U-Net with a confidence head."""
    return untrained_graph(replace(tiny_spec("unet"), confidence=True), seed=TINY_SEED)


def tiny_spec(architecture: str) -> GraphSpec:
    """A network of some kilobytes: 96x128 in and out, backbone `tiny`."""
    spec = graph_spec(
        architecture,
        backbone=TINY,
        decoder=TINY_DECODER,
        input_size=TINY_SIZE,
        inner_size=TINY_SIZE,
    )
    components = tuple(
        component.changed(
            width=TINY_WIDTH,
            state_units=min(component.state_units, 4),
        )
        for component in spec.components
    )
    dense = any(component.backbone in DENSE for component in components)
    inner_size = TINY_DENSE_SIZE if dense else TINY_SIZE
    return replace(spec, components=components, inner_size=inner_size)


def export_paper(folder: Path) -> list[Path]:
    """Write the paper's three U-Net systems with ResNet-34 at 480x640, random weights.

    For benchmarks only: 100 to 200 MB each, so they are made where they are needed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for architecture in ("unet", "wnet", "wnet_c"):
        spec = graph_spec(
            architecture,
            backbone="resnet34",
            decoder=PAPER_DECODER,
            input_size=PAPER_SIZE,
            inner_size=PAPER_SIZE,
        )
        written.append(folder / f"{architecture}_resnet34.onnx")
        export_fused(untrained_graph(spec, seed=TINY_SEED), written[-1], Provenance())
    return written
