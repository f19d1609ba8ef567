"""Renders the open scene: the image, and depth and labels at pixel centers."""

from __future__ import annotations

import tempfile
from pathlib import Path

import bpy
import numpy as np
from PIL import Image

NONE = 255
"""Label of a pixel without a class."""

DEPTH_NONE_MM = 0


def prepare(exposure: float, samples: int) -> None:
    """Set up Cycles on the processor, with denoising and short light paths."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.use_persistent_data = True
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.samples = samples
    cycles.use_adaptive_sampling = False
    cycles.use_denoising = True
    cycles.denoiser = "OPENIMAGEDENOISE"
    cycles.denoising_input_passes = "RGB_ALBEDO_NORMAL"
    cycles.max_bounces, cycles.diffuse_bounces, cycles.glossy_bounces = 5, 4, 2
    cycles.transparent_max_bounces = 4
    cycles.sample_clamp_indirect = 4
    cycles.caustics_reflective = cycles.caustics_refractive = False
    cycles.use_light_tree = True
    scene.view_settings.view_transform = "AgX"
    scene.view_settings.look = "AgX - Medium High Contrast"
    scene.view_settings.exposure = exposure
    scene.world = bpy.data.worlds.new("dark")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs[0].default_value = (0.03, 0.03, 0.03, 1)


def image(seed: int) -> np.ndarray:
    """The scene as the camera sees it: RGB of 8 bits, before the sensor's noise."""
    scene = bpy.context.scene
    scene.cycles.seed = seed
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGB"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "image.png"
        scene.render.filepath = str(path)
        bpy.ops.render.render(write_still=True)
        return np.array(Image.open(path).convert("RGB"))


def with_noise(rgb: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """A small sensor's faults: shot and read noise, darker corners."""
    linear = (rgb / 255.0) ** 2.2
    height, width = linear.shape[:2]
    y, x = np.mgrid[0:height, 0:width]
    radius2 = ((x - width / 2) ** 2 + (y - height / 2) ** 2) / (width**2 / 4 + height**2 / 4)
    linear *= (1 - 0.16 * radius2)[:, :, None]
    deviation = np.sqrt(6e-5 * linear + 5e-8)
    # Bayer sensors interpolate color, so its noise is coarser than brightness'.
    common = random.normal(size=(height, width, 1))
    own = random.normal(size=(height // 2 + 1, width // 2 + 1, 3))
    own = own.repeat(2, axis=0).repeat(2, axis=1)[:height, :width]
    noisy = linear + deviation * (0.9 * common + 0.35 * own)
    return (noisy.clip(0, 1) ** (1 / 2.2) * 255 + 0.5).astype(np.uint8)


def truth() -> tuple[np.ndarray, np.ndarray]:
    """Depth in meters along the optical axis (NaN = none) and labels at pixel centers.

    One ray per pixel through its center, without any filter; all surfaces count as opaque, so that
    a window has the depth of its pane.
    """
    scene, layer = bpy.context.scene, bpy.context.view_layer
    layer.use_pass_z = layer.use_pass_object_index = True
    layer.material_override = _opaque()
    cycles = scene.cycles
    kept = (cycles.samples, cycles.use_denoising, cycles.pixel_filter_type, cycles.max_bounces)
    cycles.samples, cycles.use_denoising, cycles.max_bounces = 1, False, 0
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 0.01
    with tempfile.TemporaryDirectory() as folder:
        write_passes(scene, folder, {"depth": "Depth", "index": "IndexOB"})
        bpy.ops.render.render()
        depth_m = read_pass(Path(folder), "depth")[:, :, 0].astype(np.float64)
        index = read_pass(Path(folder), "index")[:, :, 0]
    scene.use_nodes = False
    layer.material_override = None
    cycles.samples, cycles.use_denoising, cycles.pixel_filter_type, cycles.max_bounces = kept
    cycles.filter_width = 1.5
    index = np.rint(index).astype(int)
    labels = np.where(index > 0, index - 1, NONE).astype(np.uint8)
    far = bpy.context.scene.camera.data.clip_end
    return np.where((index > 0) & (depth_m < far), depth_m, np.nan), labels


def _opaque() -> bpy.types.Material:
    found = bpy.data.materials.get("opaque")
    return found or bpy.data.materials.new("opaque")


def write_passes(scene: bpy.types.Scene, folder: str, outputs: dict[str, str]) -> None:
    """Let the compositor write passes as float images; Python has no direct access to them."""
    scene.use_nodes = True
    tree = scene.node_tree
    tree.nodes.clear()
    layers = tree.nodes.new("CompositorNodeRLayers")
    files = tree.nodes.new("CompositorNodeOutputFile")
    files.base_path = folder
    files.format.file_format = "OPEN_EXR"
    files.format.color_depth = "32"
    files.format.exr_codec = "NONE"
    files.file_slots.clear()
    for name, output in outputs.items():
        files.file_slots.new(name)
        tree.links.new(layers.outputs[output], files.inputs[name])


def read_pass(folder: Path, name: str) -> np.ndarray:
    """A pass, `[H, W, C]` float32, rows from top to bottom (Blender's begin below)."""
    (path,) = folder.glob(f"{name}*.exr")
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.name = "Non-Color"
    width, height = image.size
    values = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(values)
    channels = image.channels
    bpy.data.images.remove(image)
    return values.reshape(height, width, channels)[::-1]
