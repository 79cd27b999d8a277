"""The mosaic: tiled canvas, seams, exposure, blending, image files."""
