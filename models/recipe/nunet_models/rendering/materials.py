"""Procedural materials: colors are linear RGB, sizes are meters in an object's own frame."""

from __future__ import annotations

from functools import cache

import bpy

from nunet_models.rendering.graph import Color, Graph, times


@cache
def plaster(color: Color) -> bpy.types.Material:
    """Painted plaster: hardly visible stains, a roller's grain."""
    graph = Graph("plaster", roughness=0.85)
    place = graph.place()
    stains = graph.noise(place, 1.3, 6)
    graph.color(graph.ramp(stains, (0.25, times(color, 0.92)), (0.75, times(color, 1.04))))
    graph.bump(graph.noise(place, 180, 3), 0.0015, 0.5)
    return graph.material


@cache
def wood(color: Color, grain: str = "x", gloss: float = 0.5) -> bpy.types.Material:
    """Wood whose grain runs along an axis of the object."""
    graph = Graph("wood", roughness=1 - gloss)
    across, along = 1.0, 0.07
    stretch = tuple(along if axis == grain else across for axis in "xyz")
    place = graph.place(stretch)
    rings = graph.noise(place, 14, 5)
    fibres = graph.noise(place, 130, 3)
    tone = graph.ramp(rings, (0.3, times(color, 0.6)), (0.5, color), (0.72, times(color, 1.25)))
    fibre = graph.ramp(fibres, (0.3, (0.72, 0.7, 0.68)), (0.6, (1, 1, 1)))
    graph.color(graph.mix(tone, fibre, 0.8, "MULTIPLY"))
    graph.bump(fibres, 0.001, 0.4)
    return graph.material


@cache
def floorboards(color: Color) -> bpy.types.Material:
    """Boards of 11 cm along y, each of its own tone."""
    graph = Graph("floorboards", roughness=0.38)
    place = graph.add("ShaderNodeTexCoord").outputs["Object"]
    turned = graph.add("ShaderNodeMapping", Vector=place, Rotation=(0, 0, 1.5708)).outputs[0]
    boards = graph.add(
        "ShaderNodeTexBrick",
        Vector=turned,
        Color1=(*times(color, 0.7), 1),
        Color2=(*times(color, 1.25), 1),
        Mortar=(*times(color, 0.15), 1),
        Scale=1.0,
        Mortar_Size=0.0018,
        Bias=0.0,
        Brick_Width=1.3,
        Row_Height=0.11,
    )
    stretched = graph.add("ShaderNodeMapping", Vector=place, Scale=(1, 0.06, 1)).outputs[0]
    fibres = graph.noise(stretched, 60, 5)
    fibre = graph.ramp(fibres, (0.3, (0.55, 0.5, 0.45)), (0.65, (1, 1, 1)))
    graph.color(graph.mix(boards.outputs[0], fibre, 0.7, "MULTIPLY"))
    graph.bump(graph.mix(boards.outputs[1], fibres, 0.15), 0.002, -0.4)
    return graph.material


@cache
def fabric(color: Color, weave: float = 260, contrast: float = 0.25) -> bpy.types.Material:
    """Woven cloth: `weave` is threads per meter, `contrast` how much they differ."""
    graph = Graph("fabric", roughness=0.95)
    graph.surface.inputs["Sheen Weight"].default_value = 0.25
    place = graph.place()
    threads = graph.noise(place, weave / 2, 6)
    worn = graph.noise(place, 4, 4)
    tone = graph.ramp(threads, (0.3, times(color, 1 - contrast)), (0.7, times(color, 1 + contrast)))
    shade = graph.ramp(worn, (0.3, (0.8, 0.8, 0.8)), (0.7, (1, 1, 1)))
    graph.color(graph.mix(tone, shade, 1.0, "MULTIPLY"))
    graph.bump(threads, 0.004, 0.6)
    return graph.material


@cache
def striped(first: Color, second: Color, width: float, axis: str = "x") -> bpy.types.Material:
    """Cloth with stripes across an axis."""
    graph = Graph("striped", roughness=0.95)
    place = graph.place()
    bands = graph.tree.nodes.new("ShaderNodeTexWave")
    bands.bands_direction = axis.upper()
    graph.feed(bands, "Vector", place)
    graph.feed(bands, "Scale", 0.314 / width)
    graph.feed(bands, "Distortion", 0.15)
    threads = graph.noise(place, 220, 3)
    graph.color(graph.steps(bands.outputs[1], (0, first), (0.45, second)))
    graph.bump(threads, 0.004, 0.5)
    return graph.material


@cache
def carpet(color: Color) -> bpy.types.Material:
    """Short pile: speckled and rough."""
    graph = Graph("carpet", roughness=1.0)
    graph.surface.inputs["Sheen Weight"].default_value = 0.3
    place = graph.add("ShaderNodeTexCoord").outputs["Object"]
    pile = graph.noise(place, 100, 6)
    trodden = graph.noise(place, 1.8, 3)
    tone = graph.ramp(pile, (0.3, times(color, 0.45)), (0.7, times(color, 1.4)))
    shade = graph.ramp(trodden, (0.3, (0.82, 0.82, 0.82)), (0.7, (1, 1, 1)))
    graph.color(graph.mix(tone, shade, 1.0, "MULTIPLY"))
    graph.bump(pile, 0.012, 0.8)
    return graph.material


@cache
def rug(ground: Color, figure: Color) -> bpy.types.Material:
    """A woven rug with a pattern of lozenges."""
    graph = Graph("rug", roughness=1.0)
    place = graph.add("ShaderNodeTexCoord").outputs["Object"]
    turned = graph.add("ShaderNodeMapping", Vector=place, Rotation=(0, 0, 0.7854)).outputs[0]
    lozenges = graph.add("ShaderNodeTexVoronoi", Vector=turned, Scale=4.2, Randomness=0.0)
    lozenges.distance = "CHEBYCHEV"
    pattern = graph.steps(
        lozenges.outputs["Distance"],
        (0, figure),
        (0.16, ground),
        (0.32, times(figure, 0.6)),
        (0.38, ground),
        (0.47, figure),
    )
    pile = graph.noise(place, 140, 4)
    grain = graph.ramp(pile, (0.3, (0.6, 0.6, 0.6)), (0.7, (1, 1, 1)))
    graph.color(graph.mix(pattern, grain, 1.0, "MULTIPLY"))
    graph.bump(pile, 0.01, 0.7)
    return graph.material


@cache
def tiles(color: Color, size: float) -> bpy.types.Material:
    """Square floor or wall tiles."""
    graph = Graph("tiles", roughness=0.3)
    place = graph.add("ShaderNodeTexCoord").outputs["Object"]
    grid = graph.add(
        "ShaderNodeTexBrick",
        Vector=place,
        Color1=(*times(color, 0.9), 1),
        Color2=(*times(color, 1.08), 1),
        Mortar=(*times(color, 0.45), 1),
        Scale=1.0,
        Mortar_Size=0.004,
        Brick_Width=size,
        Row_Height=size,
    )
    grid.offset = 0
    cloud = graph.ramp(graph.noise(place, 7, 6), (0.3, (0.85,) * 3), (0.7, (1, 1, 1)))
    graph.color(graph.mix(grid.outputs[0], cloud, 1.0, "MULTIPLY"))
    graph.bump(grid.outputs[1], 0.003, -0.5)
    return graph.material


@cache
def paint(color: Color, roughness: float = 0.45) -> bpy.types.Material:
    """Lacquer, plastic or ceramic, with finger marks."""
    graph = Graph("paint", roughness=roughness)
    smudges = graph.noise(graph.place(), 6, 5)
    graph.color(graph.ramp(smudges, (0.3, times(color, 0.92)), (0.7, times(color, 1.05))))
    return graph.material


@cache
def metal(color: Color = (0.6, 0.6, 0.62), roughness: float = 0.35) -> bpy.types.Material:
    """Brushed metal."""
    graph = Graph("metal", roughness=roughness, color=color)
    graph.surface.inputs["Metallic"].default_value = 1.0
    return graph.material


@cache
def leaf(color: Color) -> bpy.types.Material:
    """A leaf, light shining through a little."""
    graph = Graph("leaf", roughness=0.45)
    spots = graph.noise(graph.place(), 25, 4)
    graph.color(graph.ramp(spots, (0.3, times(color, 0.6)), (0.7, times(color, 1.2))))
    return graph.material


@cache
def glowing(color: Color, strength: float) -> bpy.types.Material:
    """A lamp's shade."""
    graph = Graph("glowing", roughness=0.9, color=(0.8, 0.75, 0.65))
    graph.surface.inputs["Emission Color"].default_value = (*color, 1)
    graph.surface.inputs["Emission Strength"].default_value = strength
    return graph.material


@cache
def pane() -> bpy.types.Material:
    """Window glass without refraction: mostly clear, a faint reflection."""
    graph = Graph("pane", roughness=0.05)
    clear = graph.tree.nodes.new("ShaderNodeBsdfTransparent")
    mirror = graph.add("ShaderNodeBsdfGlossy", Roughness=0.02)
    mixed = graph.add("ShaderNodeMixShader", Fac=0.06)
    graph.tree.links.new(clear.outputs[0], mixed.inputs[1])
    graph.tree.links.new(mirror.outputs[0], mixed.inputs[2])
    graph.tree.links.new(mixed.outputs[0], graph.tree.nodes["Material Output"].inputs[0])
    return graph.material


@cache
def mirror() -> bpy.types.Material:
    """A mirror."""
    return metal((0.9, 0.9, 0.9), 0.02)


@cache
def concrete(color: Color) -> bpy.types.Material:
    """Concrete or linoleum: large stains, small specks."""
    graph = Graph("concrete", roughness=0.6)
    place = graph.place()
    stains = graph.noise(place, 0.9, 5)
    specks = graph.ramp(graph.noise(place, 70, 2), (0.35, (0.75,) * 3), (0.65, (1, 1, 1)))
    tone = graph.ramp(stains, (0.3, times(color, 0.7)), (0.7, times(color, 1.2)))
    graph.color(graph.mix(tone, specks, 0.8, "MULTIPLY"))
    return graph.material


@cache
def bricks(color: Color, mortar: Color, size: tuple[float, float]) -> bpy.types.Material:
    """A brick or panel wall; bricks of `size` on the object's x and z."""
    graph = Graph("bricks", roughness=0.85)
    place = graph.add("ShaderNodeTexCoord").outputs["Object"]
    turned = graph.add("ShaderNodeMapping", Vector=place, Rotation=(1.5708, 0, 0)).outputs[0]
    grid = graph.add(
        "ShaderNodeTexBrick",
        Vector=turned,
        Color1=(*times(color, 0.75), 1),
        Color2=(*times(color, 1.2), 1),
        Mortar=(*mortar, 1),
        Scale=1.0,
        Mortar_Size=0.006,
        Brick_Width=size[0],
        Row_Height=size[1],
    )
    graph.color(grid.outputs[0])
    return graph.material


@cache
def checkered(first: Color, second: Color, size: float) -> bpy.types.Material:
    """Tiles of two colors."""
    graph = Graph("checkered", roughness=0.35)
    place = graph.add("ShaderNodeTexCoord").outputs["Object"]
    node = graph.add(
        "ShaderNodeTexChecker",
        Vector=place,
        Color1=(*first, 1),
        Color2=(*second, 1),
        Scale=1 / size,
    )
    graph.color(node.outputs[0])
    return graph.material
