"""Cuts upright squares out of a picture, scaled to one size, as one pass over each.

Shifting a window by part of a pixel and averaging it down, or interpolating it up, are weighted sums along
each side; both together are two short sums, one down and one across.
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
ANGLE = 4
EXTENT, MIDDLE_X, MIDDLE_Y, SIDE, TURN, DEVIATION, OUTSIDE = range(7)


@kernel(VIEW, TABLE, types.float64, PATCHES, TABLE)
def cut_squares(
    image: NDArray[np.uint8],
    places: FloatTable,
    margin: float,
    patches: NDArray[np.float32],
    facts: FloatTable,
) -> None:
    """Cuts a square around each upright target; beyond the picture its edge pixels go on.

    Args:
        image: uint8[h, w].
        places: float64[n, 5], x y length width in px, and angle.
        margin: of the square's side over the target's longer one.
        patches: float32[n, p, p], is filled with whole grey levels; left as they are for targets that are
            turned or whose numbers are not finite.
        facts: float64[n, 7], is filled: the target's longer side, x, y, side and angle of its square, the
            standard deviation of the patch in grey levels, and the share of the square outside the picture.
            The side is 0 where a number is not finite; the last two are 0 and 1 where nothing was cut.
    """
    height, width = image.shape
    size, longest = patches.shape[1], 1
    for index in range(len(places)):
        _bound(places[index], margin, height, width, facts[index])
        longest = max(longest, int(facts[index, SIDE]))
    taps = max(longest // size, 1) + 3
    down, across = np.empty((size, taps), np.float32), np.empty((size, taps), np.float32)
    tops, lefts = np.empty(size, np.int64), np.empty(size, np.int64)
    line, column_sum = np.empty(longest + 1, np.float32), np.empty(size, np.float32)
    columns = np.empty((longest + 1, size), np.float32)
    for index in range(len(places)):
        x, y, side = facts[index, MIDDLE_X], facts[index, MIDDLE_Y], int(facts[index, SIDE])
        if side == 0 or facts[index, TURN] != 0.0:
            continue
        top, used_down = _weigh(y, side, tops, down)
        left, used_across = _weigh(x, side, lefts, across)
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
        facts[index, DEVIATION] = _deviation(patches[index])
        facts[index, OUTSIDE] = 1.0 - _share_inside(x, side, width) * _share_inside(y, side, height)


@compiled
def _bound(place: FloatTable, margin: float, height: int, width: int, facts: FloatTable) -> None:
    """Fills in a row of facts, with a square that is no wider than the picture and not far out of it."""
    facts[:] = 0.0
    facts[OUTSIDE] = 1.0
    if not np.isfinite(place).all():
        return
    longest = max(height, width)
    facts[EXTENT] = max(place[2], place[3])
    # a box may be as large as a float: the margin then has to come after the limit
    side = min(max(np.rint(min(facts[EXTENT], 4.0 * longest) * margin), 1.0), longest)
    # farther out every window is the same edge pixels
    facts[MIDDLE_X] = min(max(place[0], -side), width + side)
    facts[MIDDLE_Y] = min(max(place[1], -side), height + side)
    facts[SIDE] = side
    # whole turns are none
    facts[TURN] = place[ANGLE] % (2 * math.pi)


@compiled
def _weigh(middle: float, side: int, starts: IndexArray, weights: WeightArray) -> tuple[int, int]:
    """Weights of the pixels along one side for each sample.

    Args:
        middle: of the square, px.
        side: of the square, px.
        starts: int64[p], is filled: where each sample's pixels begin, from the first pixel of the square on.
        weights: float32[p, taps], is filled; the sum of each row is 1.

    Returns:
        The first pixel of the square, and how many of the taps are used.
    """
    size = len(starts)
    begin = middle - (side - 1) * 0.5
    first = math.floor(begin)
    part, scale = begin - first, side / size
    used = 0
    weights[:] = 0
    for sample in range(size):
        if side > size:
            # what shrinks is the mean of what each sample covers
            low, high = sample * scale, (sample + 1) * scale
            start = min(int(low), side - 1)
            end = min(math.ceil(high - 1e-9), side)
        else:
            # what grows lies between two pixels
            place = min(max((sample + 0.5) * scale - 0.5, 0.0), side - 1.0)
            start = int(place)
            end = min(start + 2, side)
            low, high = place, place
        for pixel in range(start, end):
            if side > size:
                share = (min(high, pixel + 1.0) - max(low, pixel)) / scale
            else:
                share = 1.0 - abs(place - pixel)
            tap = pixel - start
            weights[sample, tap] += np.float32(share * (1.0 - part))
            weights[sample, tap + 1] += np.float32(share * part)
        starts[sample] = start
        used = max(used, end - start + 1)
    return first, used


@compiled
def _blend_rows(
    image: NDArray[np.uint8], top: int, weights: WeightArray, left: int, line: WeightArray
) -> None:
    """Weighted sum of some rows, from a column on: fills in float32[n]; the picture's edges go on."""
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
def _share_inside(centre: float, side: int, length: int) -> float:
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
