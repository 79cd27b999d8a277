"""Gains that equalise the brightness of overlapping frames."""

from collections.abc import Sequence
from typing import Final

import cv2
import numpy as np

from streamkit.geometry.homography import FloatArray
from streamkit_stitcher.mosaic.seams import LAST_RESORT, Footprint

_FEWEST_CELLS: Final = 20
_DEVIATION: Final = 10.0
_GAIN_DEVIATION: Final = 0.1
_RANGE: Final = (0.5, 2.0)


def gains(footprints: Sequence[Footprint]) -> FloatArray:
    """One gain per frame and channel, near 1, float64[n, c], for frames on the planning grid.

    Source: Brown and Lowe, Automatic panoramic image stitching, IJCV 2007, section 6.
    """
    count = len(footprints)
    channels = footprints[0].thumbnail.shape[2]
    prior = 1 / _GAIN_DEVIATION**2
    normal = np.zeros((channels, count, count))
    wanted = np.zeros((channels, count))
    for first in range(count):
        for second in range(first + 1, count):
            shared = _shared(footprints[first], footprints[second])
            if shared is None:
                continue
            cells, one, other = shared
            weight = cells / _DEVIATION**2
            for channel in range(channels):
                a, b = one[channel], other[channel]
                normal[channel, first, first] += weight * a * a + cells * prior
                normal[channel, second, second] += weight * b * b + cells * prior
                normal[channel, first, second] -= weight * a * b
                normal[channel, second, first] -= weight * a * b
                wanted[channel, [first, second]] += cells * prior
    for channel in range(channels):
        alone = np.diag(normal[channel]) == 0
        normal[channel, alone, alone] = wanted[channel, alone] = 1
    found = np.linalg.solve(normal, wanted[:, :, np.newaxis])[:, :, 0].T
    return np.asarray(np.clip(found, *_RANGE), dtype=np.float64)


def _shared(first: Footprint, second: Footprint) -> tuple[int, FloatArray, FloatArray] | None:
    """Number of shared cells, and the mean of each channel there in either frame."""
    top, left = max(first.top, second.top), max(first.left, second.left)
    bottom = min(first.top + first.depth.shape[0], second.top + second.depth.shape[0])
    right = min(first.left + first.depth.shape[1], second.left + second.depth.shape[1])
    if bottom <= top or right <= left:
        return None
    channels = first.thumbnail.shape[2]
    parts = []
    for own in (first, second):
        window = slice(top - own.top, bottom - own.top), slice(left - own.left, right - own.left)
        parts.append((own.thumbnail[window], own.depth[window] > LAST_RESORT))
    both = (parts[0][1] & parts[1][1]).astype(np.uint8)
    cells = int(np.count_nonzero(both))
    if cells < _FEWEST_CELLS:
        return None
    first_mean, second_mean = (np.array(cv2.mean(thumbnail, both))[:channels] for thumbnail, _ in parts)
    return cells, first_mean, second_mean
