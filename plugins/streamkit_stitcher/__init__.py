"""Registration of drone video to a ground plane, and the mosaic.

Pixel coordinates are x right, y down, (0, 0) the centre of the top-left pixel. Matrices map column vectors
(x, y, 1) and are scaled so that the last element is 1.
"""
