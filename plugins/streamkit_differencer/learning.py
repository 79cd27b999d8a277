"""What a frame teaches: equation 3, the noise of each pixel, what has stopped and what is new."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import types

from streamkit_differencer.canvas_region import REGION
from streamkit_kernels import BYTES, FLOATS, compiled, kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from streamkit_differencer.canvas_region import Region

    ByteImage = NDArray[np.uint8]
    FloatImage = NDArray[np.float32]
    ByteLine = NDArray[np.uint8]
    FloatLine = NDArray[np.float32]

# How a pixel's background learns: not, by equation 3, or all at once; new ones, the largest, have none yet.
NOTHING, SLOWLY, AT_ONCE, NEW = 0, 1, 2, 3
# New pixels are few; they are searched for by blocks of so many rows and columns.
BLOCK_ROWS, BLOCK_PX = 16, 64


@kernel(BYTES, BYTES, BYTES, FLOATS, BYTES, BYTES, BYTES, REGION, types.float64, types.int64)
def learn(
    image: ByteImage,
    mask: ByteImage,
    quiet: ByteImage,
    background: FloatImage,
    valid: ByteImage,
    standing: ByteImage,
    lessons: ByteImage,
    region: Region,
    coefficient: float,
    absorb_frames: int,
) -> int:
    """Equation 3; foreground that stands still long enough, and what is quiet and new, become background.

    Args:
        image: uint8[h, w], f(t) on the canvas; so are all.
        mask: uint8[h, w], foreground.
        quiet: uint8[h, w], mask of D = 0.
        background: float32[h, w], B(t - 1), becomes B(t).
        valid: uint8[h, w], mask of where that is known; updated in place.
        standing: uint8[h, w], frames that a pixel was foreground and quiet; updated in place.
        lessons: uint8[h, w], becomes how each pixel learnt: `NOTHING`, `SLOWLY`, `AT_ONCE` or `NEW`.
        region: what the frame covers at most; nothing else is read or written.
        coefficient: alpha, 0 to 1.
        absorb_frames: frames after which a thing that stands still becomes background.

    Returns:
        How many pixels are new.
    """
    top, bottom, left, right = region
    least, total = np.uint8(min(max(absorb_frames, 0), 255)), 0
    for row in range(top, bottom):
        stands, lesson = standing[row, left:right], lessons[row, left:right]
        silent, known = quiet[row, left:right], valid[row, left:right]
        _stood(mask[row, left:right], silent, stands)
        _lessons(mask[row, left:right], silent, known, stands, least, lesson)
        _taught(image[row, left:right], lesson, np.float32(coefficient), background[row, left:right])
        _accepted(lesson, known)
        if _has_new(lesson):
            total += _count_new(lesson)
    return total


@compiled
def _stood(mask: ByteLine, quiet: ByteLine, standing: ByteLine) -> None:
    """Counts frames, to 255; what is not foreground stands no longer."""
    for index in range(standing.size):
        count = standing[index] & mask[index]
        still = mask[index] & quiet[index] & np.uint8(1)
        standing[index] = np.uint8(count + min(still, np.uint8(~count)))


@compiled
def _lessons(
    mask: ByteLine, quiet: ByteLine, valid: ByteLine, standing: ByteLine, least: np.uint8, lesson: ByteLine
) -> None:
    for index in range(lesson.size):
        is_long = standing[index] >= least
        on_thing = np.uint8(AT_ONCE) if is_long else np.uint8(NOTHING)
        is_known = valid[index] == np.uint8(255)
        on_ground = np.uint8(SLOWLY) if is_known else np.uint8(NEW)
        kind = on_thing if mask[index] > 0 and is_known else on_ground
        lesson[index] = kind & quiet[index]


@compiled
def _accepted(lesson: ByteLine, valid: ByteLine) -> None:
    """Makes new pixels valid."""
    for index in range(lesson.size):
        is_new = lesson[index] == np.uint8(NEW)
        valid[index] = valid[index] | (np.uint8(255) if is_new else np.uint8(0))


@compiled
def _has_new(lesson: ByteLine) -> bool:
    largest = np.uint8(NOTHING)
    for index in range(lesson.size):
        largest = max(largest, lesson[index])
    return bool(largest == np.uint8(NEW))


@compiled
def _count_new(lesson: ByteLine) -> int:
    count = np.int32(0)
    for index in range(lesson.size):
        count += np.int32(lesson[index] == np.uint8(NEW))
    return int(count)


@compiled
def _taught(line: ByteLine, lesson: ByteLine, coefficient: np.float32, background: FloatLine) -> None:
    one, none = np.float32(1.0), np.float32(0.0)
    for index in range(line.size):
        kind = lesson[index]
        weight = coefficient if kind == np.uint8(SLOWLY) else (one if kind >= np.uint8(AT_ONCE) else none)
        background[index] = background[index] * (one - weight) + np.float32(line[index]) * weight


@kernel(BYTES, BYTES, BYTES, FLOATS, BYTES, REGION, types.float64, types.float64, types.int64, types.int64)
def learn_noise(
    image: ByteImage,
    rounded: ByteImage,
    lessons: ByteImage,
    spread: FloatImage,
    needed: ByteImage,
    region: Region,
    coefficient: float,
    gain: float,
    lowest: int,
    highest: int,
) -> None:
    """Learns the mean absolute deviation of what learns slowly, as a running mean, and its threshold.

    Args:
        image: uint8[h, w], f(t) on the canvas; so are all.
        rounded: uint8[h, w], B(t - 1).
        lessons: uint8[h, w], how each pixel learns, see `learn`.
        spread: float32[h, w], grey levels.
        needed: uint8[h, w], T_F of each pixel: what a difference counts as at most, a mover that was missed
            teaches little; becomes that of the new spread.
        region: what the frame covers at most.
        coefficient: weight of this frame, 0 to 1.
        gain: the threshold over the mean deviation.
        lowest: smallest threshold, grey levels.
        highest: largest threshold.
    """
    top, bottom, left, right = region
    for row in range(top, bottom):
        deviations, limits = spread[row, left:right], needed[row, left:right]
        _deviated(
            image[row, left:right],
            rounded[row, left:right],
            lessons[row, left:right],
            limits,
            np.float32(coefficient),
            deviations,
        )
        _limited(deviations, np.float32(gain), np.float32(lowest), np.float32(highest), limits)


@compiled
def _deviated(
    line: ByteLine,
    ground: ByteLine,
    lesson: ByteLine,
    most: ByteLine,
    coefficient: np.float32,
    spread: FloatLine,
) -> None:
    one, none = np.float32(1.0), np.float32(0.0)
    for index in range(line.size):
        value, other = line[index], ground[index]
        deviation = np.float32(min(np.uint8(max(value, other) - min(value, other)), most[index]))
        weight = coefficient if lesson[index] == np.uint8(SLOWLY) else none
        spread[index] = spread[index] * (one - weight) + deviation * weight


@compiled
def _limited(
    spread: FloatLine, gain: np.float32, lowest: np.float32, highest: np.float32, needed: ByteLine
) -> None:
    for index in range(spread.size):
        value = max(min(np.rint(spread[index] * gain), highest), lowest)
        needed[index] = np.uint8(np.int32(value))


@kernel(FLOATS, BYTES, REGION, types.float64, types.int64, types.int64)
def set_thresholds(
    spread: FloatImage, needed: ByteImage, region: Region, gain: float, lowest: int, highest: int
) -> None:
    """T_F of each pixel from the mean deviation, see `learn_noise`."""
    top, bottom, left, right = region
    for row in range(top, bottom):
        _limited(
            spread[row, left:right],
            np.float32(gain),
            np.float32(lowest),
            np.float32(highest),
            needed[row, left:right],
        )


@kernel(
    BYTES, BYTES, FLOATS, BYTES, REGION, types.float64, types.float64, types.float64, types.int64, types.int64
)
def begin_noise(
    earlier: ByteImage,
    lessons: ByteImage,
    spread: FloatImage,
    needed: ByteImage,
    region: Region,
    first: float,
    edge: float,
    gain: float,
    lowest: int,
    highest: int,
) -> None:
    """Gives pixels that have just got a background the noise that edges may have.

    Args:
        earlier: uint8[h, w], f(t - tau) on the canvas, whose edges count; so are all.
        lessons: uint8[h, w], how each pixel learns, see `learn`.
        spread: float32[h, w], mean absolute deviation, grey levels; set where pixels are new.
        needed: uint8[h, w], T_F; set there, too.
        region: what the frame covers at most.
        first: deviation of a pixel whose background is a single frame.
        edge: what the local range adds to it, per grey level.
        gain: the threshold over the mean deviation.
        lowest: smallest threshold, grey levels.
        highest: largest threshold.
    """
    top, bottom, left, right = region
    largest = np.empty(right - left, np.uint8)
    for start in range(top, bottom, BLOCK_ROWS):
        stop = min(start + BLOCK_ROWS, bottom)
        for index in range(largest.size):
            largest[index] = NOTHING
        for row in range(start, stop):
            _raise(lessons[row, left:right], largest)
        for block in range(left, right, BLOCK_PX):
            end = min(block + BLOCK_PX, right)
            if not _has_new(largest[block - left : end - left]):
                continue
            for row in range(start, stop):
                lesson = lessons[row, block:end]
                for column in range(block, end):
                    if lesson[np.uintp(column - block)] == np.uint8(NEW):
                        rough = np.float32(edge) * _range(earlier, row, column, region) + np.float32(first)
                        spread[row, column] = rough
                        limit = min(np.rint(rough * np.float32(gain)), np.float32(highest))
                        needed[row, column] = np.uint8(np.int32(max(limit, np.float32(lowest))))


@compiled
def _raise(lesson: ByteLine, largest: ByteLine) -> None:
    for index in range(lesson.size):
        largest[index] = max(largest[index], lesson[index])


@compiled
def _range(image: ByteImage, row: int, column: int, region: Region) -> np.float32:
    """The range of values within a pixel."""
    top, bottom, left, right = region
    flat, width = image.reshape(-1), image.shape[1]
    before, after = max(column - 1, left), min(column + 1, right - 1)
    low, high = np.uint8(255), np.uint8(0)
    # Beyond the region a line or a column of it is looked at twice.
    for y in (max(row - 1, top), row, min(row + 1, bottom - 1)):
        for x in (before, column, after):
            value = flat[np.uintp(y * width + x)]
            low, high = min(low, value), max(high, value)
    return np.float32(np.uint8(high - low))
