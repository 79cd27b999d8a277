"""Registration of drone video to a ground plane, and the mosaic.

Conventions of all modules: pixel coordinates are x right, y down, (0, 0) the centre of the top-left pixel.
Points are float64[n, 2], x y. Homographies are float64[3, 3], last element 1, and map column vectors
(x, y, 1); their names say from where to where. Images are uint8[h, w], colour ones uint8[h, w, 3] BGR;
`images` are a frame and its halvings. Shapes are (height, width). Lengths are px unless said otherwise.
"""
