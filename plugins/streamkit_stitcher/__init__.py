"""Registration of drone video to a ground plane, and the mosaic of what was seen.

Pixel coordinates are x right, y down, (0, 0) the centre of the top-left pixel. Every matrix maps column
vectors (x, y, 1) and is scaled so that its last element is 1.
"""
