"""Compiled steps on lines and neighbourhoods of images that several kernels share."""

from __future__ import annotations

import numpy as np

from streamkit_differencer.arrays import ByteImage, ByteLine, Region
from streamkit_kernels import compiled


@compiled
def is_any_set(line: ByteLine) -> bool:
    """Whether any pixel of a line is not 0."""
    united = np.uint8(0)
    for index in range(line.size):
        united |= line[index]
    return bool(united > 0)


@compiled
def clear(line: ByteLine) -> None:
    """Sets a line to 0; assigning to a slice takes ten times as long."""
    for index in range(line.size):
        line[index] = 0


@compiled
def unite(other: ByteLine, line: ByteLine) -> None:
    """Adds the bits of another line to a line."""
    for index in range(line.size):
        line[index] |= other[index]


@compiled
def local_range(image: ByteImage, row: int, column: int, region: Region) -> int:
    """The range of values among a pixel and its neighbours within the region."""
    top, bottom, left, right = region
    flat, width = image.reshape(-1), image.shape[1]
    low, high = np.uint8(255), np.uint8(0)
    for y in range(max(row - 1, top), min(row + 2, bottom)):
        for x in range(max(column - 1, left), min(column + 2, right)):
            value = flat[np.uintp(y * width + x)]
            low, high = min(low, value), max(high, value)
    return int(np.uint8(high - low))


@compiled
def is_known(known: ByteImage, row: int, column: int, border: int, region: Region) -> bool:
    """Whether all pixels within `border` of a pixel, and within the region, are set."""
    top, bottom, left, right = region
    for y in range(max(row - border, top), min(row + border + 1, bottom)):
        for x in range(max(column - border, left), min(column + border + 1, right)):
            if known[y, x] == 0:
                return False
    return True
