"""What kernels take, as numba's types: arrays in memory of their own, [rows, columns], C-contiguous."""

from numba import types

BYTES = types.Array(types.uint8, 2, "C")
PAIRS = types.Array(types.uint16, 2, "C")
BLOCKS = types.Array(types.int32, 2, "C")
FLOATS = types.Array(types.float32, 2, "C")
FLAGS = types.Array(types.boolean, 1, "C")
# Points, boxes, homographies.
TABLE = types.Array(types.float64, 2, "C")
# A picture of somebody else's, which is only read.
INPUT = types.Array(types.uint8, 2, "C", readonly=True)
# The same, of which lines may be parts of longer ones.
VIEW = types.Array(types.uint8, 2, "A", readonly=True)
