"""The part of the canvas that a frame covers, as compiled loops take it."""

from numba import types

# First row, row after the last, first column, column after the last.
REGION = types.UniTuple(types.int64, 4)  # type: ignore[no-untyped-call]
Region = tuple[int, int, int, int]
