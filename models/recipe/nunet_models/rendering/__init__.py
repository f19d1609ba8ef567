"""Rendered rooms: images with exact depth and labels, made by Blender (the package `bpy`)."""
