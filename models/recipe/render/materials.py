"""Procedural materials: colours are linear RGB, sizes are metres in an object's own frame."""

from functools import cache

import bpy

Colour = tuple[float, float, float]


class _Graph:
    """A material's node tree with a Principled BSDF, and short ways to add to it."""

    def __init__(self, name: str, *, roughness: float, colour: Colour = (0.8, 0.8, 0.8)) -> None:
        self.material = bpy.data.materials.new(name)
        self.material.use_nodes = True
        self.tree = self.material.node_tree
        self.surface = self.tree.nodes["Principled BSDF"]
        self.surface.inputs["Roughness"].default_value = roughness
        self.surface.inputs["Base Color"].default_value = (*colour, 1)
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

    def place(self, scale: Colour = (1, 1, 1), *, space: str = "Object") -> bpy.types.NodeSocket:
        """Coordinates in metres of the object, moved by a random amount, stretched by `scale`."""
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

    def ramp(self, by: bpy.types.NodeSocket, *stops: tuple[float, Colour]) -> object:
        """Colours between stops."""
        node = self.add("ShaderNodeValToRGB", Fac=by)
        elements = node.color_ramp.elements
        for index, (position, colour) in enumerate(stops):
            element = elements[index] if index < 2 else elements.new(position)
            element.position = position
            element.color = (*colour, 1)
        return node.outputs[0]

    def steps(self, by: bpy.types.NodeSocket, *stops: tuple[float, Colour]) -> object:
        """Colours by steps, none between."""
        colour = self.ramp(by, *stops)
        colour.node.color_ramp.interpolation = "CONSTANT"
        return colour

    def mix(self, first: object, second: object, by: object, kind: str = "MIX") -> object:
        """Two colours mixed."""
        node = self.tree.nodes.new("ShaderNodeMixRGB")
        node.blend_type = kind
        for name, value in (("Fac", by), ("Color1", first), ("Color2", second)):
            self.feed(node, name, value)
        return node.outputs[0]

    def colour(self, value: bpy.types.NodeSocket) -> None:
        """Colour of the surface."""
        self.feed(self.surface, "Base Color", value)

    def bump(self, height: bpy.types.NodeSocket, distance: float, strength: float = 1) -> None:
        """Make the surface uneven."""
        node = self.add("ShaderNodeBump", Height=height, Distance=distance, Strength=strength)
        self.feed(self.surface, "Normal", node.outputs[0])


def _times(colour: Colour, factor: float) -> Colour:
    return (colour[0] * factor, colour[1] * factor, colour[2] * factor)


@cache
def plaster(colour: Colour) -> bpy.types.Material:
    """Painted plaster: hardly visible stains, a roller's grain."""
    graph = _Graph("plaster", roughness=0.85)
    place = graph.place()
    stains = graph.noise(place, 1.3, 6)
    graph.colour(graph.ramp(stains, (0.25, _times(colour, 0.92)), (0.75, _times(colour, 1.04))))
    graph.bump(graph.noise(place, 180, 3), 0.0015, 0.5)
    return graph.material


@cache
def wood(colour: Colour, grain: str = "x", gloss: float = 0.5) -> bpy.types.Material:
    """Wood whose grain runs along an axis of the object."""
    graph = _Graph("wood", roughness=1 - gloss)
    across, along = 1.0, 0.07
    stretch = tuple(along if axis == grain else across for axis in "xyz")
    place = graph.place(stretch)
    rings = graph.noise(place, 14, 5)
    fibres = graph.noise(place, 130, 3)
    tone = graph.ramp(
        rings, (0.3, _times(colour, 0.6)), (0.5, colour), (0.72, _times(colour, 1.25))
    )
    fibre = graph.ramp(fibres, (0.3, (0.72, 0.7, 0.68)), (0.6, (1, 1, 1)))
    graph.colour(graph.mix(tone, fibre, 0.8, "MULTIPLY"))
    graph.bump(fibres, 0.001, 0.4)
    return graph.material


@cache
def floorboards(colour: Colour) -> bpy.types.Material:
    """Boards of 11 cm along y, each of its own tone."""
    graph = _Graph("floorboards", roughness=0.38)
    place = graph.add("ShaderNodeTexCoord").outputs["Object"]
    turned = graph.add("ShaderNodeMapping", Vector=place, Rotation=(0, 0, 1.5708)).outputs[0]
    boards = graph.add(
        "ShaderNodeTexBrick",
        Vector=turned,
        Color1=(*_times(colour, 0.7), 1),
        Color2=(*_times(colour, 1.25), 1),
        Mortar=(*_times(colour, 0.15), 1),
        Scale=1.0,
        Mortar_Size=0.0018,
        Bias=0.0,
        Brick_Width=1.3,
        Row_Height=0.11,
    )
    stretched = graph.add("ShaderNodeMapping", Vector=place, Scale=(1, 0.06, 1)).outputs[0]
    fibres = graph.noise(stretched, 60, 5)
    fibre = graph.ramp(fibres, (0.3, (0.55, 0.5, 0.45)), (0.65, (1, 1, 1)))
    graph.colour(graph.mix(boards.outputs[0], fibre, 0.7, "MULTIPLY"))
    graph.bump(graph.mix(boards.outputs[1], fibres, 0.15), 0.002, -0.4)
    return graph.material


@cache
def fabric(colour: Colour, weave: float = 260, contrast: float = 0.25) -> bpy.types.Material:
    """Woven cloth: `weave` is threads a metre, `contrast` how much they differ."""
    graph = _Graph("fabric", roughness=0.95)
    graph.surface.inputs["Sheen Weight"].default_value = 0.25
    place = graph.place()
    threads = graph.noise(place, weave / 2, 6)
    worn = graph.noise(place, 4, 4)
    tone = graph.ramp(
        threads, (0.3, _times(colour, 1 - contrast)), (0.7, _times(colour, 1 + contrast))
    )
    shade = graph.ramp(worn, (0.3, (0.8, 0.8, 0.8)), (0.7, (1, 1, 1)))
    graph.colour(graph.mix(tone, shade, 1.0, "MULTIPLY"))
    graph.bump(threads, 0.004, 0.6)
    return graph.material


@cache
def striped(first: Colour, second: Colour, width: float, axis: str = "x") -> bpy.types.Material:
    """Cloth with stripes across an axis."""
    graph = _Graph("striped", roughness=0.95)
    place = graph.place()
    bands = graph.tree.nodes.new("ShaderNodeTexWave")
    bands.bands_direction = axis.upper()
    graph.feed(bands, "Vector", place)
    graph.feed(bands, "Scale", 0.314 / width)
    graph.feed(bands, "Distortion", 0.15)
    threads = graph.noise(place, 220, 3)
    graph.colour(graph.steps(bands.outputs[1], (0, first), (0.45, second)))
    graph.bump(threads, 0.004, 0.5)
    return graph.material


@cache
def carpet(colour: Colour) -> bpy.types.Material:
    """Short pile: speckled and rough."""
    graph = _Graph("carpet", roughness=1.0)
    graph.surface.inputs["Sheen Weight"].default_value = 0.3
    place = graph.add("ShaderNodeTexCoord").outputs["Object"]
    pile = graph.noise(place, 100, 6)
    trodden = graph.noise(place, 1.8, 3)
    tone = graph.ramp(pile, (0.3, _times(colour, 0.45)), (0.7, _times(colour, 1.4)))
    shade = graph.ramp(trodden, (0.3, (0.82, 0.82, 0.82)), (0.7, (1, 1, 1)))
    graph.colour(graph.mix(tone, shade, 1.0, "MULTIPLY"))
    graph.bump(pile, 0.012, 0.8)
    return graph.material


@cache
def rug(ground: Colour, figure: Colour) -> bpy.types.Material:
    """A woven rug with a pattern of lozenges."""
    graph = _Graph("rug", roughness=1.0)
    place = graph.add("ShaderNodeTexCoord").outputs["Object"]
    turned = graph.add("ShaderNodeMapping", Vector=place, Rotation=(0, 0, 0.7854)).outputs[0]
    lozenges = graph.add("ShaderNodeTexVoronoi", Vector=turned, Scale=4.2, Randomness=0.0)
    lozenges.distance = "CHEBYCHEV"
    pattern = graph.steps(
        lozenges.outputs["Distance"],
        (0, figure),
        (0.16, ground),
        (0.32, _times(figure, 0.6)),
        (0.38, ground),
        (0.47, figure),
    )
    pile = graph.noise(place, 140, 4)
    grain = graph.ramp(pile, (0.3, (0.6, 0.6, 0.6)), (0.7, (1, 1, 1)))
    graph.colour(graph.mix(pattern, grain, 1.0, "MULTIPLY"))
    graph.bump(pile, 0.01, 0.7)
    return graph.material


@cache
def tiles(colour: Colour, size: float) -> bpy.types.Material:
    """Square floor or wall tiles."""
    graph = _Graph("tiles", roughness=0.3)
    place = graph.add("ShaderNodeTexCoord").outputs["Object"]
    grid = graph.add(
        "ShaderNodeTexBrick",
        Vector=place,
        Color1=(*_times(colour, 0.9), 1),
        Color2=(*_times(colour, 1.08), 1),
        Mortar=(*_times(colour, 0.45), 1),
        Scale=1.0,
        Mortar_Size=0.004,
        Brick_Width=size,
        Row_Height=size,
    )
    grid.offset = 0
    cloud = graph.ramp(graph.noise(place, 7, 6), (0.3, (0.85,) * 3), (0.7, (1, 1, 1)))
    graph.colour(graph.mix(grid.outputs[0], cloud, 1.0, "MULTIPLY"))
    graph.bump(grid.outputs[1], 0.003, -0.5)
    return graph.material


@cache
def paint(colour: Colour, roughness: float = 0.45) -> bpy.types.Material:
    """Lacquer, plastic or ceramic, with finger marks."""
    graph = _Graph("paint", roughness=roughness)
    smudges = graph.noise(graph.place(), 6, 5)
    graph.colour(graph.ramp(smudges, (0.3, _times(colour, 0.92)), (0.7, _times(colour, 1.05))))
    return graph.material


@cache
def metal(colour: Colour = (0.6, 0.6, 0.62), roughness: float = 0.35) -> bpy.types.Material:
    """Brushed metal."""
    graph = _Graph("metal", roughness=roughness, colour=colour)
    graph.surface.inputs["Metallic"].default_value = 1.0
    return graph.material


@cache
def screen() -> bpy.types.Material:
    """A display that is switched off."""
    graph = _Graph("screen", roughness=0.12, colour=(0.008, 0.008, 0.01))
    return graph.material


@cache
def book(colour: Colour, band: Colour) -> bpy.types.Material:
    """A book's back with a title and two rules; generated coordinates run from 0 to 1."""
    graph = _Graph("book", roughness=0.55)
    height = graph.add("ShaderNodeSeparateXYZ", Vector=graph.place(space="Generated")).outputs[2]
    marks = graph.steps(
        height, (0, colour), (0.1, band), (0.12, colour), (0.62, band), (0.84, colour)
    )
    worn = graph.ramp(graph.noise(graph.place(), 40, 4), (0.3, (0.8,) * 3), (0.7, (1, 1, 1)))
    graph.colour(graph.mix(marks, worn, 1.0, "MULTIPLY"))
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
"""Paintings' colours from below to above: a summer field, a lake at dusk."""


@cache
def landscape(seed: int, glow: float = 0.0) -> bpy.types.Material:
    """A painting, or a screen that shows one: sky, hills, a field; generated coordinates."""
    graph = _Graph("painting", roughness=0.6)
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
    picture = graph.ramp(sum_of.outputs[0], *zip(stops, palette, strict=True))
    strokes = graph.ramp(graph.noise(moved, 45, 3), (0.3, (0.7,) * 3), (0.65, (1, 1, 1)))
    painted = graph.mix(picture, strokes, 1.0, "MULTIPLY")
    graph.colour(painted)
    graph.feed(graph.surface, "Emission Color", painted)
    graph.surface.inputs["Emission Strength"].default_value = glow
    return graph.material


@cache
def leaf(colour: Colour) -> bpy.types.Material:
    """A leaf, light shining through a little."""
    graph = _Graph("leaf", roughness=0.45)
    spots = graph.noise(graph.place(), 25, 4)
    graph.colour(graph.ramp(spots, (0.3, _times(colour, 0.6)), (0.7, _times(colour, 1.2))))
    return graph.material


@cache
def glowing(colour: Colour, strength: float) -> bpy.types.Material:
    """A lamp's shade."""
    graph = _Graph("glowing", roughness=0.9, colour=(0.8, 0.75, 0.65))
    graph.surface.inputs["Emission Color"].default_value = (*colour, 1)
    graph.surface.inputs["Emission Strength"].default_value = strength
    return graph.material


@cache
def pane() -> bpy.types.Material:
    """Window glass without refraction: mostly clear, a faint reflection."""
    graph = _Graph("pane", roughness=0.05)
    clear = graph.tree.nodes.new("ShaderNodeBsdfTransparent")
    mirror = graph.add("ShaderNodeBsdfGlossy", Roughness=0.02)
    mixed = graph.add("ShaderNodeMixShader", Fac=0.06)
    graph.tree.links.new(clear.outputs[0], mixed.inputs[1])
    graph.tree.links.new(mirror.outputs[0], mixed.inputs[2])
    graph.tree.links.new(mixed.outputs[0], graph.tree.nodes["Material Output"].inputs[0])
    return graph.material


@cache
def outdoors(strength: float) -> bpy.types.Material:
    """What the window shows, shining by itself: meadow, trees, a bright sky."""
    graph = _Graph("outdoors", roughness=1.0, colour=(0, 0, 0))
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
