"""Median filter and hole filling of the foreground."""

from __future__ import annotations

import cv2
import numpy as np
from numba import types

from streamkit_differencer.arrays import ByteImage, ByteLine
from streamkit_differencer.lines import clear
from streamkit_differencer.mask_values import MOVING, SHADOW, STOPPED
from streamkit_kernels import BYTES, compiled, kernel

SMALLEST_MEDIAN, LARGEST_MEDIAN = 3, 7
# Background, 0, less one, as a byte.
BACKGROUND = 255


def cleaned(mask: ByteImage, median: int, fill_holes: bool) -> ByteImage:
    """The foreground after a median filter, with holes filled.

    Args:
        mask: uint8[h, w], see `mask_values`.
        median: width of the median filter, px; raised to an odd number; none below 2.
        fill_holes: whether pixels enclosed by foreground become foreground.

    Returns:
        uint8[h, w], a new array.
    """
    result = np.empty(mask.shape, np.uint8)
    if median >= SMALLEST_MEDIAN - 1:
        median_filter(np.ascontiguousarray(mask), min(median | 1, LARGEST_MEDIAN) // 2, result)
    else:
        result[:] = mask
    if fill_holes:
        outlines, _ = cv2.findContours(result, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        whole = np.zeros_like(result)
        cv2.drawContours(whole, outlines, -1, 255, cv2.FILLED)
        cv2.copyTo(result, result, whole)
        result = whole
    return result


@kernel(BYTES, types.int64, BYTES)
def median_filter(mask: ByteImage, reach: int, result: ByteImage) -> None:
    """The median of each square, with the border replicated.

    Of four values the median is the largest that more than half of the pixels reach: counting needs no sort.

    Args:
        mask: uint8[h, w], see `mask_values`.
        reach: half of the side of a square, rounded down.
        result: uint8[h, w], output.
    """
    height, width = mask.shape
    filled, smallest = np.zeros(height, np.bool_), np.uint8(BACKGROUND)
    for row in range(height):
        least = _smallest(mask[row])
        filled[row] = least < BACKGROUND
        smallest = min(smallest, least)
    sums = np.empty(width + 2 * reach, np.uint8)
    most = np.uint8((2 * reach + 1) ** 2 // 2)
    for row in range(height):
        line = result[row]
        clear(line)
        is_near = False
        for other in range(max(row - reach, 0), min(row + reach + 1, height)):
            is_near |= filled[other]
        if not is_near:
            continue
        for kind in (SHADOW, STOPPED, MOVING):
            if kind < STOPPED and smallest >= STOPPED - 1:
                continue
            inner = sums[reach : reach + width]
            clear(inner)
            for other in range(row - reach, row + reach + 1):
                _count(mask[min(max(other, 0), height - 1)], np.uint8(kind), inner)
            for end in range(reach):
                sums[end], sums[reach + width + end] = inner[0], inner[width - 1]
            _settle(sums, reach, most, np.uint8(kind), line)


@compiled
def _smallest(mask: ByteLine) -> np.uint8:
    """The smallest value of foreground in a line, less one; `BACKGROUND` without foreground."""
    smallest = np.uint8(BACKGROUND)
    for index in range(mask.size):
        smallest = min(smallest, np.uint8(mask[index] - np.uint8(1)))
    return smallest


@compiled
def _count(mask: ByteLine, kind: np.uint8, sums: ByteLine) -> None:
    """Counts pixels whose value is at least `kind`."""
    for index in range(sums.size):
        sums[index] += np.uint8(mask[index] >= kind)


@compiled
def _settle(sums: ByteLine, reach: int, most: np.uint8, kind: np.uint8, line: ByteLine) -> None:
    """Sets the value where more than `most` pixels of a square were counted."""
    width = line.size
    votes = np.zeros(width, np.uint8)
    for step in range(2 * reach + 1):
        _add(sums[step : step + width], votes)
    for index in range(width):
        line[index] = kind if votes[index] > most else line[index]


@compiled
def _add(line: ByteLine, votes: ByteLine) -> None:
    for index in range(votes.size):
        votes[index] += line[index]
