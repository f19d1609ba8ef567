"""The networks: specs as plain data, backbones by name, components in series."""

from nunet_models.zoo.registry import ARCHITECTURES, graph_spec
from nunet_models.zoo.serial import Component, SerialGraph
from nunet_models.zoo.spec import LITE_DECODER, PAPER_DECODER, Camera, ComponentSpec, GraphSpec

__all__ = [
    "ARCHITECTURES",
    "LITE_DECODER",
    "PAPER_DECODER",
    "Camera",
    "Component",
    "ComponentSpec",
    "GraphSpec",
    "SerialGraph",
    "graph_spec",
]
