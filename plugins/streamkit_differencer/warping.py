"""Frames drawn onto the canvas, and masks fetched back from it.

Line by line: where each pixel comes from, then what is there. This takes half of the time of OpenCV's
resampling, which was the most of a frame's, and gives the same values within a grey level.
"""

from __future__ import annotations

import numpy as np
from numba import types
from numpy.typing import NDArray

from streamkit_differencer.arrays import BOUNDS, Bounds, ByteImage, ByteLine, CountLine, FloatArray, FloatLine
from streamkit_differencer.ground import BLACK, UNSEEN
from streamkit_kernels import FLOAT64, UINT8, UINT8_STRIDED, compiled, kernel

# Places are rounded to this part of a pixel; 32 bits hold a value times its square.
STEP_BITS = 11
STEPS = 2**STEP_BITS
# Of the outermost pixels of a frame some would mix with the border.
BORDER_PX = 2
WholeLine = NDArray[np.int32]


@kernel(UINT8_STRIDED, FLOAT64, UINT8, BOUNDS)
def draw(image: ByteImage, to_image: FloatArray, canvas: ByteImage, bounds: Bounds) -> None:
    """Draws an image on a canvas by bilinear interpolation, without a border of `BORDER_PX`.

    Args:
        image: uint8[h, w].
        to_image: float64[3, 3], pixels of the canvas to those of the image.
        canvas: uint8[rows, columns]; what is within the bounds and not of the image becomes `UNSEEN`.
        bounds: the part of the canvas that is drawn.
    """
    (height, width), (top, bottom, left, right) = image.shape, bounds
    # Two neighbours are fetched at once; the last line once more, below itself.
    pairs = np.empty((height + 1, width), np.uint16)
    for row in range(height + 1):
        _pair(image[min(row, height - 1)], pairs[row])
    values, columns = pairs.reshape(-1), np.arange(left, right).astype(np.float32)
    places = np.empty(right - left, np.int32)
    across, down = np.empty_like(places), np.empty_like(places)
    upper, lower = np.empty(right - left, np.uint16), np.empty(right - left, np.uint16)
    for row in range(top, bottom):
        _find_places(to_image, np.float64(row), columns, (height, width), STEPS, across, down)
        _number(across, down, width, STEP_BITS, places)
        _fetch_pairs(values, places, width, upper, lower)
        _mix(upper, lower, across, down, canvas[row, left:right])
        _clear_outside(across, down, (height, width), canvas[row, left:right])


@kernel(UINT8, FLOAT64, types.int64, types.int64)
def fetch(mask: ByteImage, to_mask: FloatArray, height: int, width: int) -> ByteImage:
    """The nearest pixels of a mask, uint8[height, width]; its border is replicated.

    Args:
        mask: uint8[rows, columns].
        to_mask: float64[3, 3], pixels of the result to those of the mask.
        height: of the result.
        width: of the result.
    """
    result, values = np.empty((height, width), np.uint8), mask.reshape(-1)
    columns = np.arange(width).astype(np.float32)
    places = np.empty(width, np.int32)
    across, down = np.empty_like(places), np.empty_like(places)
    for row in range(height):
        _find_places(to_mask, np.float64(row), columns, mask.shape, 1, across, down)
        _number(across, down, mask.shape[1], 0, places)
        _fetch(values, places, result[row])
    return result


@compiled
def _find_places(
    matrix: FloatArray,
    row: float,
    columns: FloatLine,
    shape: tuple[int, int],
    steps: int,
    across: WholeLine,
    down: WholeLine,
) -> None:
    """Where the pixels of a line are in an image, in parts of a pixel, within its borders."""
    a, b, c = np.float32(matrix[0, 0]), np.float32(matrix[1, 0]), np.float32(matrix[2, 0])
    x_first = np.float32(matrix[0, 1] * row + matrix[0, 2])
    y_first = np.float32(matrix[1, 1] * row + matrix[1, 2])
    depth_first = np.float32(matrix[2, 1] * row + matrix[2, 2])
    right, bottom = np.float32((shape[1] - 1) * steps), np.float32((shape[0] - 1) * steps)
    none, scale = np.float32(0.0), np.float32(steps)
    for index in range(columns.size):
        column = columns[index]
        nearness = scale / (depth_first + c * column)
        x, y = (x_first + a * column) * nearness, (y_first + b * column) * nearness
        # This comparison order maps NaN to 0.
        x, y = x if x > none else none, y if y > none else none
        x, y = x if x < right else right, y if y < bottom else bottom
        across[index], down[index] = np.int32(np.rint(x)), np.int32(np.rint(y))


@compiled
def _pair(line: ByteLine, pairs: CountLine) -> None:
    """Each pixel with the one to its right."""
    last = line.size - 1
    for index in range(last):
        pairs[index] = np.uint16(line[index]) | np.uint16(np.uint16(line[index + 1]) << np.uint16(8))
    pairs[last] = np.uint16(line[last]) | np.uint16(np.uint16(line[last]) << np.uint16(8))


@compiled
def _number(across: WholeLine, down: WholeLine, width: int, bits: int, places: WholeLine) -> None:
    """The pixels to the upper left of places, numbered line by line."""
    line, shift = np.int32(width), np.int32(bits)
    for index in range(places.size):
        row, column = np.int32(down[index] >> shift), np.int32(across[index] >> shift)
        places[index] = np.int32(np.int32(row * line) + column)


@compiled
def _fetch(values: ByteLine, places: WholeLine, line: ByteLine) -> None:
    for index in range(places.size):
        line[index] = values[np.uintp(places[index])]


@compiled
def _fetch_pairs(
    values: CountLine, places: WholeLine, width: int, upper: CountLine, lower: CountLine
) -> None:
    below = np.uintp(width)
    for index in range(places.size):
        place = np.uintp(places[index])
        upper[index], lower[index] = values[place], values[np.uintp(place + below)]


@compiled
def _mix(upper: CountLine, lower: CountLine, across: WholeLine, down: WholeLine, line: ByteLine) -> None:
    """Bilinear interpolation."""
    part, byte, bits, one = np.int32(STEPS - 1), np.int32(255), np.int32(8), np.int32(STEPS)
    half, shift = np.int32(STEPS * STEPS // 2), np.int32(2 * STEP_BITS)
    for index in range(line.size):
        above, below = np.int32(upper[index]), np.int32(lower[index])
        x, y = np.int32(across[index] & part), np.int32(down[index] & part)
        rest = np.int32(one - x)
        first = np.int32(np.int32((above & byte) * rest) + np.int32((above >> bits) * x))
        second = np.int32(np.int32((below & byte) * rest) + np.int32((below >> bits) * x))
        total = np.int32(np.int32(first * np.int32(one - y)) + np.int32(second * y))
        line[index] = np.uint8(np.int32(total + half) >> shift)


@compiled
def _clear_outside(across: WholeLine, down: WholeLine, shape: tuple[int, int], line: ByteLine) -> None:
    """What is not within an image, without its border, becomes `UNSEEN`."""
    first = np.int32(BORDER_PX * STEPS)
    right, bottom = np.int32((shape[1] - 1) * STEPS) - first, np.int32((shape[0] - 1) * STEPS) - first
    for index in range(line.size):
        x, y = across[index], down[index]
        is_inside = (x >= first) & (x <= right) & (y >= first) & (y <= bottom)
        line[index] = max(line[index], BLACK) if is_inside else np.uint8(UNSEEN)
