"""Cleaning of the foreground before objects are made of it: lone pixels out, holes filled."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
from numba import types

from streamkit_differencer.marks import FOREGROUND_CHANGED, FOREGROUND_QUIET, SHADOW
from streamkit_kernels import BYTES, compiled, kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    ByteImage = NDArray[np.uint8]
    ByteLine = NDArray[np.uint8]

SMALLEST_MEDIAN, LARGEST_MEDIAN = 3, 7
# What is left of ground, 0, when a byte is lessened by one.
NOTHING = 255


def cleaned(mask: ByteImage, median: int, fill_holes: bool) -> ByteImage:
    """The foreground without lone pixels, and without holes.

    Args:
        mask: uint8[h, w], values as they are marked; 0 is ground.
        median: width of the median filter, px; even ones are the next odd one, below 2 there is none.
        fill_holes: whether what is enclosed by foreground becomes foreground.

    Returns:
        uint8[h, w], an array of its own.
    """
    result = np.empty(mask.shape, np.uint8)
    if median >= SMALLEST_MEDIAN - 1:
        take_median(np.ascontiguousarray(mask), min(median | 1, LARGEST_MEDIAN) // 2, result)
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
def take_median(marks: ByteImage, reach: int, result: ByteImage) -> None:
    """The median of each square of marks; beyond the picture it goes on as at its border.

    Args:
        marks: uint8[h, w], of foreground: a mark is the median where at least half of the pixels have it or a
            larger one, so that counts do and nothing is sorted.
        reach: half of the side of a square, rounded down.
        result: uint8[h, w].
    """
    height, width = marks.shape
    filled, smallest = np.zeros(height, np.bool_), np.uint8(NOTHING)
    for row in range(height):
        least = _smallest(marks[row])
        filled[row] = least < NOTHING
        smallest = min(smallest, least)
    sums = np.empty(width + 2 * reach, np.uint8)
    most = np.uint8((2 * reach + 1) ** 2 // 2)
    for row in range(height):
        line = result[row]
        _empty(line)
        is_near = False
        for other in range(max(row - reach, 0), min(row + reach + 1, height)):
            is_near |= filled[other]
        if not is_near:
            continue
        for kind in (SHADOW, FOREGROUND_QUIET, FOREGROUND_CHANGED):
            if kind < FOREGROUND_QUIET and smallest >= FOREGROUND_QUIET - 1:
                continue
            inner = sums[reach : reach + width]
            _empty(inner)
            for other in range(row - reach, row + reach + 1):
                _count(marks[min(max(other, 0), height - 1)], np.uint8(kind), inner)
            for end in range(reach):
                sums[end], sums[reach + width + end] = inner[0], inner[width - 1]
            _settle(sums, reach, most, np.uint8(kind), line)


@compiled
def _smallest(marks: ByteLine) -> np.uint8:
    """The smallest mark of foreground in a line, less one; `NOTHING` where there is none."""
    smallest = np.uint8(NOTHING)
    for index in range(marks.size):
        smallest = min(smallest, np.uint8(marks[index] - np.uint8(1)))
    return smallest


@compiled
def _empty(line: ByteLine) -> None:
    for index in range(line.size):
        line[index] = 0


@compiled
def _count(marks: ByteLine, kind: np.uint8, sums: ByteLine) -> None:
    """Adds one where a mark is `kind` or a larger one."""
    for index in range(sums.size):
        sums[index] += np.uint8(marks[index] >= kind)


@compiled
def _settle(sums: ByteLine, reach: int, most: np.uint8, kind: np.uint8, line: ByteLine) -> None:
    """Sets the mark where more than `most` pixels of a square were counted."""
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
