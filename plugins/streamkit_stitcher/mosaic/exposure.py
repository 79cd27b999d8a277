"""Gains that equalise the brightness of overlapping frames."""

from collections.abc import Sequence
from itertools import combinations
from typing import Final

import cv2
import numpy as np

from streamkit.geometry.homography import FloatArray
from streamkit_stitcher.mosaic.seams import LAST_RESORT, Footprint

_MIN_CELLS: Final = 20
_DEVIATION: Final = 10.0
_GAIN_DEVIATION: Final = 0.1
_RANGE: Final = (0.5, 2.0)


def exposure_gains(footprints: Sequence[Footprint]) -> FloatArray:
    """One gain per frame and channel, near 1, float64[n, 3], for frames on the planning grid.

    Source: Brown and Lowe, Automatic panoramic image stitching, IJCV 2007, section 6. That of cv2.detail
    holds the gains to 1 by the frames' whole area, and leaves a third more of a difference.
    """
    normal = np.zeros((3, len(footprints), len(footprints)))
    wanted = np.zeros(len(footprints))
    for first, second in combinations(range(len(footprints)), 2):
        pair = [first, second]
        cells, means = _shared(footprints[first], footprints[second])
        if cells < _MIN_CELLS:
            continue
        difference = means * [[1], [-1]] / _DEVIATION
        prior = np.eye(2) / _GAIN_DEVIATION**2
        for channel in range(3):
            block = np.outer(difference[:, channel], difference[:, channel]) + prior
            normal[channel][np.ix_(pair, pair)] += cells * block
        wanted[pair] += cells / _GAIN_DEVIATION**2
    alone = wanted == 0
    normal[:, alone, alone] = wanted[alone] = 1
    return np.clip(np.linalg.solve(normal, wanted[:, np.newaxis])[:, :, 0].T, *_RANGE)


def _shared(first: Footprint, second: Footprint) -> tuple[int, FloatArray]:
    """Number of shared cells, and the mean of each channel there in either frame, float64[2, 3]."""
    top, left = max(first.top, second.top), max(first.left, second.left)
    bottom, right = (
        min(one.stop, other.stop) for one, other in zip(first.window, second.window, strict=True)
    )
    if bottom <= top or right <= left:
        return 0, np.zeros((2, 3))
    parts = []
    for own in (first, second):
        window = slice(top - own.top, bottom - own.top), slice(left - own.left, right - own.left)
        parts.append((own.thumbnail[window], own.depth[window] > LAST_RESORT))
    both = (parts[0][1] & parts[1][1]).astype(np.uint8)
    return int(np.count_nonzero(both)), np.array([cv2.mean(thumbnail, both)[:3] for thumbnail, _ in parts])
