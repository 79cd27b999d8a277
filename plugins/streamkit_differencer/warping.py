"""Frames drawn onto the canvas, and masks fetched back from it.

Line by line: where each pixel comes from, then what is there. This takes half of the time of OpenCV's
resampling, which was the most of a frame's, and gives the same values within a grey level.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numba import types
from numpy.typing import NDArray

from streamkit_differencer.arrays import (
    SPANS,
    Bounds,
    ByteImage,
    ByteLine,
    FloatArray,
    FloatLine,
    Spans,
    has_set,
)
from streamkit_differencer.ground import BLACK
from streamkit_kernels import FLOAT64, UINT8, UINT8_STRIDED, compiled, kernel

# Positions are rounded to this part of a pixel; 32 bits hold a value times its square.
STEP_BITS = 11
STEPS = 2**STEP_BITS
# Masks are fetched by squares of so many pixels.
TILE = 32
WholeLine = NDArray[np.int32]
Value = TypeVar("Value", np.uint8, np.uint32)


@kernel(UINT8_STRIDED, FLOAT64, SPANS, UINT8)
def draw(image: ByteImage, to_image: FloatArray, spans: Spans, canvas: ByteImage) -> None:
    """Draws an image on a canvas by bilinear interpolation; black is drawn as `BLACK`.

    Args:
        image: uint8[h, w].
        to_image: float64[3, 3], pixels of the canvas to those of the image.
        spans: int64[rows, 2], the part of each row of the canvas that is drawn.
        canvas: uint8[rows, columns].
    """
    height, width = image.shape
    # The four neighbours of a position are fetched at once; beyond the border it is repeated.
    squares = np.empty((height, width), np.uint32)
    for row in range(height):
        _unite_squares(image[row], image[min(row + 1, height - 1)], squares[row])
    values, columns = squares.reshape(-1), np.arange(canvas.shape[1]).astype(np.float32)
    indices, fetched = np.empty(columns.size, np.int32), np.empty(columns.size, np.uint32)
    across, down = np.empty_like(indices), np.empty_like(indices)
    for row in range(canvas.shape[0]):
        left, right = spans[row]
        part, found = slice(left, right), slice(0, right - left)
        x, y = across[found], down[found]
        _find_positions(to_image, np.float64(row), columns[part], (height, width), x, y)
        _number(x, y, width, indices[found])
        _fetch(values, indices[found], fetched[found])
        _mix(fetched[found], x, y, canvas[row, part])


@kernel(FLOAT64, types.int64, types.int64)
def spans_within(outline: FloatArray, height: int, width: int) -> Spans:
    """The columns of each row of a canvas that lie within a convex outline, float64[4, 2] px."""
    spans = np.zeros((height, 2), np.int64)
    for row in range(height):
        left, right = float(width), -1.0
        for index in range(len(outline)):
            (x, y), (other_x, other_y) = outline[index - 1], outline[index]
            if min(y, other_y) <= row <= max(y, other_y) and y != other_y:
                crossing = x + (row - y) * (other_x - x) / (other_y - y)
                left, right = min(left, crossing), max(right, crossing)
        first, last = int(np.ceil(max(left, 0.0))), int(np.floor(min(right, width - 1.0)))
        if first <= last:
            spans[row, 0], spans[row, 1] = first, last + 1
    return spans


@kernel(UINT8, FLOAT64, types.int64, types.int64)
def fetch(mask: ByteImage, to_mask: FloatArray, height: int, width: int) -> ByteImage:
    """The nearest pixels of a mask, uint8[height, width]; its border is replicated.

    Args:
        mask: uint8[rows, columns].
        to_mask: float64[3, 3], pixels of the result to those of the mask.
        height: of the result.
        width: of the result.
    """
    result, values = np.zeros((height, width), np.uint8), mask.reshape(-1)
    columns, indices = np.arange(width).astype(np.float32), np.empty(TILE, np.int32)
    across, down = np.empty_like(indices), np.empty_like(indices)
    # The nearest pixel is the one to the upper left of a position half a pixel on.
    to_nearest, filled = to_mask.copy(), _filled_tiles(mask)
    to_nearest[:2] += np.float64(0.5) * to_mask[2]
    for top in range(0, height, TILE):
        for left in range(0, width, TILE):
            bottom, right = min(top + TILE, height), min(left + TILE, width)
            if not _shows_filled(filled, to_mask, (top, bottom, left, right), mask.shape):
                continue
            x, y, pixels = across[: right - left], down[: right - left], indices[: right - left]
            for row in range(top, bottom):
                _find_positions(to_nearest, np.float64(row), columns[left:right], mask.shape, x, y)
                _number(x, y, mask.shape[1], pixels)
                _fetch(values, pixels, result[row, left:right])
    return result


@compiled
def _filled_tiles(mask: ByteImage) -> ByteImage:
    """The tiles of a mask in which a pixel is set: most are empty."""
    filled = np.zeros((mask.shape[0] // TILE + 1, mask.shape[1] // TILE + 1), np.uint8)
    for row in range(mask.shape[0]):
        if has_set(mask[row]):
            for tile in range(filled.shape[1]):
                filled[row // TILE, tile] |= np.uint8(has_set(mask[row, tile * TILE : (tile + 1) * TILE]))
    return filled


@compiled
def _shows_filled(filled: ByteImage, to_mask: FloatArray, bounds: Bounds, shape: tuple[int, int]) -> bool:
    """Whether a part of an image shows one of these tiles of a mask of this height and width."""
    top, bottom, left, right = bounds
    low_x, low_y, high_x, high_y = np.inf, np.inf, 0.0, 0.0
    for row in (top, bottom - 1):
        for column in (left, right - 1):
            x, y = mapped_into(to_mask, column, row, shape)
            low_x, low_y, high_x, high_y = min(low_x, x), min(low_y, y), max(high_x, x), max(high_y, y)
    # A pixel more: the nearest one may lie in the next tile.
    rows = slice(max(int(low_y) - 1, 0) // TILE, (int(high_y) + 1) // TILE + 1)
    return bool(filled[rows, max(int(low_x) - 1, 0) // TILE : (int(high_x) + 1) // TILE + 1].any())


@compiled
def mapped_point(matrix: FloatArray, x: float, y: float) -> tuple[float, float]:
    """Where a homography, float64[3, 3], maps a point."""
    depth = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2]
    return (
        (matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2]) / depth,
        (matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2]) / depth,
    )


@compiled
def mapped_into(matrix: FloatArray, x: float, y: float, shape: tuple[int, int]) -> tuple[float, float]:
    """Where a homography maps a point, held within an image of this height and width."""
    across, down = mapped_point(matrix, x, y)
    # This comparison order maps NaN to 0.
    across, down = across if across > 0.0 else 0.0, down if down > 0.0 else 0.0
    return min(across, shape[1] - 1.0), min(down, shape[0] - 1.0)


@compiled
def _find_positions(
    matrix: FloatArray,
    row: float,
    columns: FloatLine,
    shape: tuple[int, int],
    across: WholeLine,
    down: WholeLine,
) -> None:
    """Where the pixels of a line are in an image, in parts of a pixel, within its borders."""
    a, b, c = np.float32(matrix[0, 0]), np.float32(matrix[1, 0]), np.float32(matrix[2, 0])
    x_first = np.float32(matrix[0, 1] * row + matrix[0, 2])
    y_first = np.float32(matrix[1, 1] * row + matrix[1, 2])
    depth_first = np.float32(matrix[2, 1] * row + matrix[2, 2])
    right, bottom = np.float32((shape[1] - 1) * STEPS), np.float32((shape[0] - 1) * STEPS)
    none, scale = np.float32(0.0), np.float32(STEPS)
    for index in range(columns.size):
        column = columns[index]
        nearness = scale / (depth_first + c * column)
        x, y = (x_first + a * column) * nearness, (y_first + b * column) * nearness
        # This comparison order maps NaN to 0.
        x, y = x if x > none else none, y if y > none else none
        x, y = x if x < right else right, y if y < bottom else bottom
        across[index], down[index] = np.int32(np.rint(x)), np.int32(np.rint(y))


@compiled
def _unite_squares(upper: ByteLine, lower: ByteLine, squares: NDArray[np.uint32]) -> None:
    """Each pixel of a line with the one to its right and the two below them, from the lowest byte up."""
    last = upper.size - 1
    for index in range(last):
        above = np.uint32(upper[index]) | np.uint32(np.uint32(upper[index + 1]) << np.uint32(8))
        below = np.uint32(lower[index]) | np.uint32(np.uint32(lower[index + 1]) << np.uint32(8))
        squares[index] = above | np.uint32(below << np.uint32(16))
    squares[last] = np.uint32(upper[last]) * np.uint32(0x101) + np.uint32(lower[last]) * np.uint32(0x1010000)


@compiled
def _number(across: WholeLine, down: WholeLine, width: int, indices: WholeLine) -> None:
    """The pixels to the upper left of positions, numbered line by line."""
    line = np.int32(width)
    for index in range(indices.size):
        # A shift that the compiler does not know takes twice as long.
        row, column = np.int32(down[index] >> STEP_BITS), np.int32(across[index] >> STEP_BITS)
        indices[index] = np.int32(np.int32(row * line) + column)


@compiled
def _fetch(values: NDArray[Value], indices: WholeLine, line: NDArray[Value]) -> None:
    for index in range(indices.size):
        line[index] = values[np.uintp(indices[index])]


@compiled
def _mix(squares: NDArray[np.uint32], across: WholeLine, down: WholeLine, line: ByteLine) -> None:
    """Bilinear interpolation within squares of pixels."""
    part, byte, one = np.int32(STEPS - 1), np.uint32(255), np.int32(STEPS)
    half, shift, black = np.int32(STEPS * STEPS // 2), np.int32(2 * STEP_BITS), np.int32(BLACK)
    for index in range(line.size):
        square = squares[index]
        left, right = np.int32(square & byte), np.int32(np.uint32(square >> np.uint32(8)) & byte)
        lower = np.uint32(square >> np.uint32(16))
        lower_left, lower_right = np.int32(lower & byte), np.int32(lower >> np.uint32(8))
        x, y = np.int32(across[index] & part), np.int32(down[index] & part)
        rest = np.int32(one - x)
        first = np.int32(np.int32(left * rest) + np.int32(right * x))
        second = np.int32(np.int32(lower_left * rest) + np.int32(lower_right * x))
        total = np.int32(np.int32(first * np.int32(one - y)) + np.int32(second * y))
        line[index] = np.uint8(max(np.int32(np.int32(total + half) >> shift), black))
