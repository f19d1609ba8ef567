"""Materials that show something: paintings, photos, screens, book spines, the view outside."""

from __future__ import annotations

from functools import cache

import bpy

from nunet_models.rendering.graph import Color, Graph


@cache
def screen() -> bpy.types.Material:
    """A display that is switched off."""
    graph = Graph("screen", roughness=0.12, color=(0.008, 0.008, 0.01))
    return graph.material


@cache
def book(color: Color, band: Color) -> bpy.types.Material:
    """A book's back with a title and two rules; generated coordinates run from 0 to 1."""
    graph = Graph("book", roughness=0.55)
    height = graph.add("ShaderNodeSeparateXYZ", Vector=graph.place(space="Generated")).outputs[2]
    marks = graph.steps(height, (0, color), (0.1, band), (0.12, color), (0.62, band), (0.84, color))
    worn = graph.ramp(graph.noise(graph.place(), 40, 4), (0.3, (0.8,) * 3), (0.7, (1, 1, 1)))
    graph.color(graph.mix(marks, worn, 1.0, "MULTIPLY"))
    return graph.material


_PALETTES = (
    (
        (0.05, 0.08, 0.03),
        (0.35, 0.28, 0.07),
        (0.06, 0.12, 0.1),
        (0.1, 0.16, 0.24),
        (0.75, 0.6, 0.42),
        (0.25, 0.42, 0.62),
    ),
    (
        (0.02, 0.06, 0.1),
        (0.05, 0.2, 0.26),
        (0.3, 0.42, 0.42),
        (0.16, 0.07, 0.06),
        (0.7, 0.25, 0.08),
        (0.75, 0.55, 0.3),
    ),
)
"""Paintings' colors from below to above: a summer field, a lake at dusk."""


@cache
def landscape(seed: int, glow: float = 0.0) -> bpy.types.Material:
    """A painting, or a screen that shows one: sky, hills, a field; generated coordinates."""
    graph = Graph("painting", roughness=0.6)
    place = graph.place(space="Generated")
    moved = graph.add("ShaderNodeMapping", Vector=place, Location=(seed * 3.7, 0, 0)).outputs[0]
    hills = graph.noise(moved, 2.6, 6)
    height = graph.add("ShaderNodeSeparateXYZ", Vector=place).outputs[2]
    sum_of = graph.tree.nodes.new("ShaderNodeMath")
    sum_of.operation = "MULTIPLY_ADD"
    graph.tree.links.new(hills, sum_of.inputs[0])
    sum_of.inputs[1].default_value = 0.55
    graph.tree.links.new(height, sum_of.inputs[2])
    stops = (0.2, 0.48, 0.62, 0.74, 0.78, 0.92)
    palette = _PALETTES[seed % len(_PALETTES)]
    view = graph.ramp(sum_of.outputs[0], *zip(stops, palette, strict=True))
    strokes = graph.ramp(graph.noise(moved, 45, 3), (0.3, (0.7,) * 3), (0.65, (1, 1, 1)))
    painted = graph.mix(view, strokes, 1.0, "MULTIPLY")
    graph.color(painted)
    graph.feed(graph.surface, "Emission Color", painted)
    graph.surface.inputs["Emission Strength"].default_value = glow
    return graph.material


@cache
def outdoors(strength: float) -> bpy.types.Material:
    """What the window shows, emissive: meadow, trees, a bright sky."""
    graph = Graph("outdoors", roughness=1.0, color=(0, 0, 0))
    place = graph.add("ShaderNodeTexCoord").outputs["Object"]
    height = graph.add("ShaderNodeSeparateXYZ", Vector=place).outputs[2]
    crowns = graph.noise(place, 0.8, 8)
    edge = graph.tree.nodes.new("ShaderNodeMath")
    edge.operation = "MULTIPLY_ADD"
    graph.tree.links.new(crowns, edge.inputs[0])
    edge.inputs[1].default_value = -5.0
    graph.tree.links.new(height, edge.inputs[2])
    # The backdrop begins 8 m below the floor; its trees end about 3 m above it.
    scaled = graph.add("ShaderNodeMapRange", Value=edge.outputs[0])
    for name, value in (("From Min", 2.0), ("From Max", 14.0)):
        scaled.inputs[name].default_value = value
    view = graph.ramp(
        scaled.outputs[0],
        (0.1, (0.16, 0.22, 0.07)),
        (0.3, (0.04, 0.08, 0.02)),
        (0.5, (0.16, 0.24, 0.08)),
        (0.55, (0.8, 0.88, 1.0)),
        (0.9, (0.45, 0.65, 1.0)),
    )
    leaves = graph.ramp(graph.noise(place, 9, 5), (0.35, (0.45,) * 3), (0.62, (1, 1, 1)))
    graph.feed(graph.surface, "Emission Color", graph.mix(view, leaves, 0.5, "MULTIPLY"))
    graph.surface.inputs["Emission Strength"].default_value = strength
    return graph.material


@cache
def photo(path: str, glow: float = 0.0) -> bpy.types.Material:
    """An image file stretched over an upright board's front; emissive with `glow`."""
    graph = Graph("photo", roughness=0.5)
    parts = graph.add("ShaderNodeSeparateXYZ", Vector=graph.place(space="Generated"))
    flat = graph.add("ShaderNodeCombineXYZ", X=parts.outputs[0], Y=parts.outputs[2])
    texture = graph.add("ShaderNodeTexImage", Vector=flat.outputs[0])
    texture.image = bpy.data.images.load(path, check_existing=True)
    graph.color(texture.outputs[0])
    graph.feed(graph.surface, "Emission Color", texture.outputs[0])
    graph.surface.inputs["Emission Strength"].default_value = glow
    return graph.material
