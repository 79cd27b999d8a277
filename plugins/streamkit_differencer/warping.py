"""Warping of frames onto the canvas and of masks back, by homographies."""

from __future__ import annotations

import numpy as np
from numba import types
from numpy.typing import NDArray

from streamkit_differencer.arrays import REGION, ByteImage, FloatArray, Region
from streamkit_kernels import FLOAT64, UINT8, UINT8_READONLY, compiled, kernel

ByteLine = NDArray[np.uint8]
FloatLine = NDArray[np.float32]
WholeNumbers = NDArray[np.uint32]

# Coordinates are rounded to this part of a pixel; 32 bits hold a grey level times its square.
STEPS = 2048
# The frame is replicated this far beyond its border: the largest tolerance.
BEYOND_PX = 8
# Rows of the canvas that are searched together, and empty columns that end a run within them.
BAND, GAP = 16, 8


@kernel(UINT8_READONLY, FLOAT64, UINT8, REGION)
def warp_frame(image: ByteImage, to_image: FloatArray, canvas: ByteImage, region: Region) -> None:
    """Draws an image on a canvas by bilinear interpolation, its border replicated for `BEYOND_PX`.

    Args:
        image: uint8[h, w], at least 2 by 2.
        to_image: float64[3, 3], canvas pixels to image pixels, without a horizon in the region.
        canvas: uint8[rows, columns], output.
        region: of the canvas.
    """
    height, width = image.shape
    # Two neighbours are read at once.
    values, both = image.reshape(-1), np.empty(image.size, np.uint16)
    for index in range(values.size - 1):
        both[index] = np.uint16(values[index]) | np.uint16(np.uint16(values[index + 1]) << np.uint16(8))
    top, bottom, left, right = region
    count = right - left
    columns = np.empty(count, np.float32)
    for index in range(count):
        columns[index] = left + index
    offsets, squares = np.empty(count, np.uint32), np.empty(count, np.uint32)
    across, down = np.empty(count, np.uint32), np.empty(count, np.uint32)
    below = np.uintp(width)
    for row in range(top, bottom):
        # A rotated frame leaves a quarter of its bounds empty.
        first, last = _span(to_image, row, (width, height), left, right)
        count = last - first
        inside = columns[first - left :]
        _coordinates(to_image, row, inside, (width, height), offsets[:count], across[:count], down[:count])
        for index in range(count):
            offset = np.uintp(offsets[index])
            squares[index] = np.uint32(both[offset]) | np.uint32(
                np.uint32(both[np.uintp(offset + below)]) << np.uint32(16)
            )
        _interpolated(squares[:count], across, down, canvas[row, first:last])


@kernel(UINT8, FLOAT64, FLOAT64, types.int64, types.int64)
def warp_mask_back(
    canvas: ByteImage, to_canvas: FloatArray, to_image: FloatArray, height: int, width: int
) -> ByteImage:
    """Warps a mask on a part of the canvas to an image by nearest neighbours; 0 beyond it.

    Args:
        canvas: uint8[rows, columns], the mask.
        to_canvas: float64[3, 3], image pixels to canvas pixels.
        to_image: float64[3, 3], its inverse.
        height: of the image, px.
        width: of the image, px.

    Returns:
        uint8[height, width].
    """
    rows, columns = canvas.shape
    image = np.zeros((height, width), np.uint8)
    # Only parts of the canvas with foreground are warped.
    united = np.empty(columns, np.uint8)
    for band in range(0, rows, BAND):
        end = min(band + BAND, rows)
        united[:] = 0
        for row in range(band, end):
            for column in range(columns):
                united[column] |= canvas[row, column]
        start, stop = _next_run(united, 0)
        while start < stop:
            outline = _outline(to_image, band - 1, end, start - 1, stop)
            _copy_nearest(canvas, to_canvas, outline, image)
            start, stop = _next_run(united, stop)
    return image


@compiled
def _next_run(united: ByteLine, start: int) -> tuple[int, int]:
    """The next run of set columns from `start` on, gaps below `GAP` included: first, and after the last."""
    while start < united.size and united[start] == 0:
        start += 1
    stop = last = start
    while last < united.size and last - stop < GAP:
        if united[last] > 0:
            stop = last + 1
        last += 1
    return start, stop


@compiled
def _copy_nearest(canvas: ByteImage, to_canvas: FloatArray, outline: Region, image: ByteImage) -> None:
    """Warps the mask to the part `outline` of the image."""
    first, last, low, high = outline
    for row in range(max(first, 0), min(last, image.shape[0])):
        for column in range(max(low, 0), min(high, image.shape[1])):
            scale = 1.0 / (to_canvas[2, 0] * column + to_canvas[2, 1] * row + to_canvas[2, 2])
            across = to_canvas[0, 0] * column + to_canvas[0, 1] * row + to_canvas[0, 2]
            down = to_canvas[1, 0] * column + to_canvas[1, 1] * row + to_canvas[1, 2]
            x, y = int(np.rint(across * scale)), int(np.rint(down * scale))
            if 0 <= y < canvas.shape[0] and 0 <= x < canvas.shape[1]:
                image[row, column] = canvas[y, x]


@compiled
def _outline(matrix: FloatArray, top: int, bottom: int, left: int, right: int) -> Region:
    """The bounds, in whole pixels, of a region's corners under a homography."""
    first, last, low, high = 1 << 30, -(1 << 30), 1 << 30, -(1 << 30)
    for row in (top, bottom):
        for column in (left, right):
            depth = matrix[2, 0] * column + matrix[2, 1] * row + matrix[2, 2]
            x = (matrix[0, 0] * column + matrix[0, 1] * row + matrix[0, 2]) / depth
            y = (matrix[1, 0] * column + matrix[1, 1] * row + matrix[1, 2]) / depth
            first, last = min(first, int(np.floor(y))), max(last, int(np.ceil(y)) + 1)
            low, high = min(low, int(np.floor(x))), max(high, int(np.ceil(x)) + 1)
    return first, last, low, high


@compiled
def _span(to_image: FloatArray, row: int, size: tuple[int, int], left: int, right: int) -> tuple[int, int]:
    """The columns from `left` to `right` of a canvas row that lie within `BEYOND_PX` of the image."""
    low, high = float(left), float(right)
    depth, depth_0 = to_image[2, 0], to_image[2, 1] * row + to_image[2, 2]
    sign = 1.0 if depth * (left + right) / 2 + depth_0 > 0.0 else -1.0
    for axis in range(2):
        place, place_0 = to_image[axis, 0], to_image[axis, 1] * row + to_image[axis, 2]
        for side, limit in ((1.0, -1.0 * BEYOND_PX), (-1.0, 1.0 * (size[axis] - 1 + BEYOND_PX))):
            # Where slope * column + start is not below zero.
            slope, start = sign * side * (place - limit * depth), sign * side * (place_0 - limit * depth_0)
            if slope > 0.0:
                low = max(low, -start / slope)
            elif slope < 0.0:
                high = min(high, -start / slope)
            elif start < 0.0:
                return left, left
    if high < low:
        return left, left
    return int(np.floor(low)), min(int(np.ceil(high)) + 1, right)


@compiled
def _coordinates(
    to_image: FloatArray,
    row: int,
    columns: FloatLine,
    size: tuple[int, int],
    offsets: WholeNumbers,
    across: WholeNumbers,
    down: WholeNumbers,
) -> None:
    """Of a canvas row: offsets of the image pixels, and the fractions beyond them in `STEPS` per pixel."""
    one, none, steps, stride = np.float32(1.0), np.float32(0.0), np.float32(STEPS), np.int32(size[0])
    across_x, down_x = np.float32(to_image[0, 0]), np.float32(to_image[1, 0])
    depth_x = np.float32(to_image[2, 0])
    across_0 = np.float32(to_image[0, 1] * row + to_image[0, 2])
    down_0 = np.float32(to_image[1, 1] * row + to_image[1, 2])
    depth_0 = np.float32(to_image[2, 1] * row + to_image[2, 2])
    last_x, last_y = np.float32(size[0] - 1 - 1.0 / STEPS), np.float32(size[1] - 1 - 1.0 / STEPS)
    for index in range(offsets.size):
        column = columns[index]
        scale = one / (depth_x * column + depth_0)
        x, y = (across_x * column + across_0) * scale, (down_x * column + down_0) * scale
        # This comparison order maps NaN to 0.
        x, y = x if x > none else none, y if y > none else none
        x, y = x if x < last_x else last_x, y if y < last_y else last_y
        whole_x, whole_y = np.int32(x), np.int32(y)
        across[index] = np.uint32((x - np.float32(whole_x)) * steps)
        down[index] = np.uint32((y - np.float32(whole_y)) * steps)
        offsets[index] = np.uint32(np.int32(np.int32(whole_y * stride) + whole_x))


@compiled
def _interpolated(squares: WholeNumbers, across: WholeNumbers, down: WholeNumbers, line: ByteLine) -> None:
    """Bilinear interpolation of four bytes each, rounded."""
    byte, half, shift = np.uint32(255), np.uint32(STEPS * STEPS // 2), np.uint32(11)
    for index in range(squares.size):
        square, right, low = squares[index], across[index], down[index]
        first, second = np.uint32(square & byte), np.uint32(np.uint32(square >> np.uint32(8)) & byte)
        third = np.uint32(np.uint32(square >> np.uint32(16)) & byte)
        fourth = np.uint32(square >> np.uint32(24))
        upper = np.uint32(np.uint32(first << shift) + np.uint32(np.uint32(second - first) * right))
        lower = np.uint32(np.uint32(third << shift) + np.uint32(np.uint32(fourth - third) * right))
        sum_ = np.uint32(np.uint32(upper << shift) + np.uint32(np.uint32(lower - upper) * low))
        line[index] = np.uint8(np.uint32(sum_ + half) >> np.uint32(22))
