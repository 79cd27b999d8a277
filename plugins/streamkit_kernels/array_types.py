"""Argument types of kernels: arrays [rows, columns], C-contiguous, in their own memory."""

from numba import types

BYTES = types.Array(types.uint8, 2, "C")
PAIRS = types.Array(types.uint16, 2, "C")
BLOCKS = types.Array(types.int32, 2, "C")
FLOATS = types.Array(types.float32, 2, "C")
FLAGS = types.Array(types.boolean, 1, "C")
# Points, boxes, homographies.
TABLE = types.Array(types.float64, 2, "C")
# A read-only image.
INPUT = types.Array(types.uint8, 2, "C", readonly=True)
# A read-only image of any strides.
VIEW = types.Array(types.uint8, 2, "A", readonly=True)
