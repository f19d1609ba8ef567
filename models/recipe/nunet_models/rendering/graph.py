"""A material's node tree, and short ways to add to it."""

from __future__ import annotations

import bpy

Color = tuple[float, float, float]


class Graph:
    """A material's node tree with a Principled BSDF, and short ways to add to it."""

    def __init__(self, name: str, *, roughness: float, color: Color = (0.8, 0.8, 0.8)) -> None:
        self.material = bpy.data.materials.new(name)
        self.material.use_nodes = True
        self.tree = self.material.node_tree
        self.surface = self.tree.nodes["Principled BSDF"]
        self.surface.inputs["Roughness"].default_value = roughness
        self.surface.inputs["Base Color"].default_value = (*color, 1)
        self.surface.inputs["Specular IOR Level"].default_value = 0.35

    def add(self, kind: str, **inputs: object) -> bpy.types.Node:
        """A node whose inputs are values or other nodes' outputs."""
        node = self.tree.nodes.new(kind)
        for name, value in inputs.items():
            self.feed(node, name.replace("_", " "), value)
        return node

    def feed(self, node: bpy.types.Node, name: str, value: object) -> None:
        """Set an input to a value, or link it to an output."""
        if isinstance(value, bpy.types.NodeSocket):
            self.tree.links.new(value, node.inputs[name])
        else:
            node.inputs[name].default_value = value

    def place(self, scale: Color = (1, 1, 1), *, space: str = "Object") -> bpy.types.NodeSocket:
        """Coordinates in meters of the object, moved by a random amount, stretched by `scale`."""
        coordinates = self.add("ShaderNodeTexCoord").outputs[space]
        if space == "Object":
            random = self.add("ShaderNodeObjectInfo").outputs["Random"]
            shift = self.tree.nodes.new("ShaderNodeVectorMath")
            shift.operation = "MULTIPLY_ADD"
            self.tree.links.new(random, shift.inputs[0])
            shift.inputs[1].default_value = (3.0, 7.0, 5.0)
            self.tree.links.new(coordinates, shift.inputs[2])
            coordinates = shift.outputs[0]
        return self.add("ShaderNodeMapping", Vector=coordinates, Scale=scale).outputs[0]

    def noise(self, at: bpy.types.NodeSocket, scale: float, detail: float = 4) -> object:
        """Fractal noise, 0 to 1."""
        return self.add(
            "ShaderNodeTexNoise", Vector=at, Scale=scale, Detail=detail, Roughness=0.6
        ).outputs[0]

    def ramp(self, by: bpy.types.NodeSocket, *stops: tuple[float, Color]) -> object:
        """Colors between stops."""
        node = self.add("ShaderNodeValToRGB", Fac=by)
        elements = node.color_ramp.elements
        for index, (position, color) in enumerate(stops):
            element = elements[index] if index < 2 else elements.new(position)
            element.position = position
            element.color = (*color, 1)
        return node.outputs[0]

    def steps(self, by: bpy.types.NodeSocket, *stops: tuple[float, Color]) -> object:
        """Colors by steps, none between."""
        color = self.ramp(by, *stops)
        color.node.color_ramp.interpolation = "CONSTANT"
        return color

    def mix(self, first: object, second: object, by: object, kind: str = "MIX") -> object:
        """Two colors mixed."""
        node = self.tree.nodes.new("ShaderNodeMixRGB")
        node.blend_type = kind
        for name, value in (("Fac", by), ("Color1", first), ("Color2", second)):
            self.feed(node, name, value)
        return node.outputs[0]

    def color(self, value: bpy.types.NodeSocket) -> None:
        """Color of the surface."""
        self.feed(self.surface, "Base Color", value)

    def bump(self, height: bpy.types.NodeSocket, distance: float, strength: float = 1) -> None:
        """Make the surface uneven."""
        node = self.add("ShaderNodeBump", Height=height, Distance=distance, Strength=strength)
        self.feed(self.surface, "Normal", node.outputs[0])


def times(color: Color, factor: float) -> Color:
    """A color made brighter or darker."""
    return (color[0] * factor, color[1] * factor, color[2] * factor)
