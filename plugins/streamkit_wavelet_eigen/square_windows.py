"""Kernel that cuts upright squares out of an image, scaled to one size, in one pass over each.

Shifting by part of a pixel, averaging when shrinking and interpolating when enlarging are weighted sums along
each side: two short separable filters, one down and one across.
"""

import math

import numpy as np
from numba import types
from numpy.typing import NDArray

from streamkit_kernels import TABLE, VIEW, compiled, kernel

IndexArray = NDArray[np.int64]
FloatTable = NDArray[np.float64]
WeightArray = NDArray[np.float32]
PATCHES = types.Array(types.float32, 3, "C")
BOX_ANGLE = 4
# Columns of `squares`.
TARGET_SIDE, CENTRE_X, CENTRE_Y, SIDE, ANGLE, DEVIATION, CLIPPED = range(7)


@kernel(VIEW, TABLE, types.float64, PATCHES, TABLE)
def cut_squares(
    image: NDArray[np.uint8],
    boxes: FloatTable,
    margin: float,
    patches: NDArray[np.float32],
    squares: FloatTable,
) -> None:
    """Cuts a square around each upright target; outside the image edge pixels are replicated.

    Args:
        image: uint8[h, w].
        boxes: float64[n, 5], x y length width in px, and angle.
        margin: side of the square over the target's longer side.
        patches: float32[n, p, p], output in whole grey levels; unchanged where the box is rotated or not
            finite.
        squares: float64[n, 7], output: longer side of the target; x, y, side and angle of its square;
            standard deviation of the patch in grey levels; share of the square outside the image. The side is
            0 where the box is not finite; the last two are 0 and 1 where nothing was cut.
    """
    height, width = image.shape
    size, longest = patches.shape[1], 1
    for index in range(len(boxes)):
        _fit_square(boxes[index], margin, height, width, squares[index])
        longest = max(longest, int(squares[index, SIDE]))
    taps = max(longest // size, 1) + 3
    down, across = np.empty((size, taps), np.float32), np.empty((size, taps), np.float32)
    tops, lefts = np.empty(size, np.int64), np.empty(size, np.int64)
    line, column_sum = np.empty(longest + 1, np.float32), np.empty(size, np.float32)
    columns = np.empty((longest + 1, size), np.float32)
    for index in range(len(boxes)):
        x, y, side = squares[index, CENTRE_X], squares[index, CENTRE_Y], int(squares[index, SIDE])
        if side == 0 or squares[index, ANGLE] != 0.0:
            continue
        top, used_down = _filter_weights(y, side, tops, down)
        left, used_across = _filter_weights(x, side, lefts, across)
        for row in range(size):
            _blend_rows(image, top + tops[row], down[row, :used_down], left, line[: side + 1])
            for column in range(side + 1):
                columns[column, row] = line[column]
        for column in range(size):
            column_sum[:] = np.float32(0.5)
            for tap in range(used_across):
                weight, source = across[column, tap], columns[min(lefts[column] + tap, side)]
                for row in range(size):
                    column_sum[row] += weight * source[row]
            for row in range(size):
                patches[index, row, column] = np.float32(np.int32(column_sum[row]))
        squares[index, DEVIATION] = _deviation(patches[index])
        squares[index, CLIPPED] = 1.0 - _inside_share(x, side, width) * _inside_share(y, side, height)


@compiled
def _fit_square(box: FloatTable, margin: float, height: int, width: int, square: FloatTable) -> None:
    """Sets a row of `squares`; the square is at most as wide as the image and near it."""
    square[:] = 0.0
    square[CLIPPED] = 1.0
    if not np.isfinite(box).all():
        return
    longest = max(height, width)
    square[TARGET_SIDE] = max(box[2], box[3])
    # Limited before the margin is applied: a box may be as large as a float.
    side = min(max(np.rint(min(square[TARGET_SIDE], 4.0 * longest) * margin), 1.0), longest)
    # Farther out every window has the same edge pixels.
    square[CENTRE_X] = min(max(box[0], -side), width + side)
    square[CENTRE_Y] = min(max(box[1], -side), height + side)
    square[SIDE] = side
    square[ANGLE] = box[BOX_ANGLE] % (2 * math.pi)


@compiled
def _filter_weights(middle: float, side: int, starts: IndexArray, weights: WeightArray) -> tuple[int, int]:
    """Weights of the pixels along one side for each sample.

    Args:
        middle: of the square, px.
        side: of the square, px.
        starts: int64[p], output: first pixel of each sample, relative to the first pixel of the square.
        weights: float32[p, taps], output; the sum of each row is 1.

    Returns:
        The first pixel of the square, and the number of taps in use.
    """
    size = len(starts)
    begin = middle - (side - 1) * 0.5
    first = math.floor(begin)
    fraction, scale = begin - first, side / size
    used = 0
    weights[:] = 0
    for sample in range(size):
        if side > size:
            # Shrinking: the mean of the pixels that a sample covers.
            low, high = sample * scale, (sample + 1) * scale
            start = min(int(low), side - 1)
            end = min(math.ceil(high - 1e-9), side)
        else:
            # Enlarging: linear interpolation between two pixels.
            position = min(max((sample + 0.5) * scale - 0.5, 0.0), side - 1.0)
            start = int(position)
            end = min(start + 2, side)
            low, high = position, position
        for pixel in range(start, end):
            if side > size:
                share = (min(high, pixel + 1.0) - max(low, pixel)) / scale
            else:
                share = 1.0 - abs(position - pixel)
            tap = pixel - start
            weights[sample, tap] += np.float32(share * (1.0 - fraction))
            weights[sample, tap + 1] += np.float32(share * fraction)
        starts[sample] = start
        used = max(used, end - start + 1)
    return first, used


@compiled
def _blend_rows(
    image: NDArray[np.uint8], top: int, weights: WeightArray, left: int, line: WeightArray
) -> None:
    """Weighted sum of rows from column `left` on, into `line` float32[n]; edge pixels are replicated."""
    height, width = image.shape
    inner = min(max(left, 0), width - 1)
    outer = max(min(left + len(line), width), inner + 1)
    begin, count = min(max(inner - left, 0), len(line) - 1), outer - inner
    count = min(count, len(line) - begin)
    middle = line[begin : begin + count]
    middle[:] = 0
    for tap in range(len(weights)):
        source = image[min(max(top + tap, 0), height - 1), inner : inner + count]
        for column in range(count):
            middle[column] += weights[tap] * np.float32(source[column])
    line[:begin] = line[begin]
    line[begin + count :] = line[begin + count - 1]


@compiled
def _inside_share(centre: float, side: int, length: int) -> float:
    """Share of [centre - side / 2, centre + side / 2] within the pixels 0 .. length - 1."""
    first, last = max(centre - side / 2, -0.5), min(centre + side / 2, length - 0.5)
    return float(max(last - first, 0.0) / side)


@compiled
def _deviation(patch: WeightArray) -> float:
    """Standard deviation of whole grey levels float32[p, p]."""
    total, power = 0, 0
    for row in range(patch.shape[0]):
        for column in range(patch.shape[1]):
            level = int(patch[row, column])
            total += level
            power += level * level
    mean = total / patch.size
    return float(np.sqrt(max(power / patch.size - mean * mean, 0.0)))
