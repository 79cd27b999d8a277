"""What the loops over patches take, as numba's types, C-contiguous."""

from numba import types

# What patches are multiplied with, [patches, products, pixels].
PATCHES = types.Array(types.float32, 3, "C")
# A matrix for each patch.
SHAPES = types.Array(types.float64, 3, "C")
VALUES = types.Array(types.float64, 1, "C")
COUNT = types.int64
NUMBER = types.float64
