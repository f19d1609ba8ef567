"""Emptying the open scene between rooms."""

from __future__ import annotations

import bpy

from nunet_models.rendering import images, materials


def clear(*, keep_materials: bool = False) -> None:
    """Remove all objects, and the materials that rooms share unless they are kept."""
    for collection in (bpy.data.objects, bpy.data.meshes, bpy.data.lights, bpy.data.cameras):
        bpy.data.batch_remove(list(collection))
    if keep_materials:
        return
    for made in [*vars(materials).values(), *vars(images).values()]:
        if hasattr(made, "cache_clear"):
            made.cache_clear()
    for collection in (bpy.data.materials, bpy.data.images):
        bpy.data.batch_remove(list(collection))
