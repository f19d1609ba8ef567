"""The networks: specs as plain data, backbones by name, components in series."""

from nunet_models.zoo.component import Component
from nunet_models.zoo.registry import architecture_names, graph_spec
from nunet_models.zoo.serial import SerialGraph
from nunet_models.zoo.spec import (
    LITE_DECODER,
    NYU_CAMERA,
    PAPER_DECODER,
    Camera,
    ComponentSpec,
    GraphSpec,
)

__all__ = [
    "LITE_DECODER",
    "NYU_CAMERA",
    "PAPER_DECODER",
    "Camera",
    "Component",
    "ComponentSpec",
    "GraphSpec",
    "SerialGraph",
    "architecture_names",
    "graph_spec",
]
