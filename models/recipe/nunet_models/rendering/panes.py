"""What the folder of flat images holds beside a dataset's; needs no Blender."""

POSTER, MURAL, SCREEN, MIRROR = "poster", "mural", "screen", "mirror"
PANE_KINDS = (POSTER, MURAL, SCREEN, MIRROR)

PLAIN = "plain"
"""Folder of the same images with a gray pane."""
PANES = "panes"
"""Folder of masks, 255 on the pane."""
