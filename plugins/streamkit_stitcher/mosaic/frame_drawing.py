"""What is common to all ways of drawing a frame into a mosaic: which, how large, and how deep a pixel is."""

from functools import lru_cache
from typing import Final

import cv2
import numpy as np

from streamkit.geometry.homography import FloatArray, normalised, scale_change
from streamkit_stitcher.mosaic.tiles import ImageArray
from streamkit_stitcher.plane.frame_registration import depth_ratio
from streamkit_stitcher.registration.patches import halved

# Largest distance of a point of a mosaic from its origin, px at scale 1.
MAX_DISTANCE: Final = 500_000
_SCALE_RANGE: Final = (0.25, 4.0)
# The frame is stretched by its square.
_MAX_DEPTH_RATIO: Final = 2.0


def is_paintable(to_reference: FloatArray, shape: tuple[int, int]) -> bool:
    """Whether the footprint of a frame of `shape` is neither huge, nor tiny, nor stretched.

    Perspective errors accumulate along a strip: one frame could cover as much of the canvas as all others.
    """
    if not (np.isfinite(to_reference).all() and depth_ratio(to_reference, shape) < _MAX_DEPTH_RATIO):
        return False
    return _SCALE_RANGE[0] < scale_change(to_reference, shape) < _SCALE_RANGE[1]


def reduced_for(frame: ImageArray, matrix: FloatArray) -> tuple[ImageArray, FloatArray]:
    """Halves a frame while `matrix`, float64[3, 3] from its pixels, reduces it anyway."""
    while scale_change(matrix, (frame.shape[0], frame.shape[1])) < 0.6 and min(frame.shape[:2]) > 32:
        frame = halved(frame)
        matrix = normalised(matrix @ np.array([[2, 0, 0.5], [0, 2, 0.5], [0, 0, 1]]))
    return frame, matrix


@lru_cache(maxsize=8)
def depth_inside(shape: tuple[int, int]) -> ImageArray:
    """Depth of each pixel inside a frame, uint8 from 1 at the border to 255 in the middle."""
    across, down = (np.minimum(np.arange(side), np.arange(side)[::-1]) for side in shape[::-1])
    # The geometric mean of both distances: the smaller one alone is equal for two frames of a straight flight
    # over half of their overlap, which would show both.
    inward = np.sqrt(across[np.newaxis, :] * down[:, np.newaxis].astype(np.float64))
    depth = np.asarray(1 + inward * (254 / max(1.0, float(inward.max()))), dtype=np.uint8)
    depth.setflags(write=False)
    return depth


def with_channels(frame: ImageArray, channels: int) -> ImageArray:
    """Converts a frame to grey for one channel and to BGR for three."""
    if (frame.ndim == 2) == (channels == 1):
        return frame
    code = cv2.COLOR_GRAY2BGR if frame.ndim == 2 else cv2.COLOR_BGR2GRAY
    return np.asarray(cv2.cvtColor(frame, code), dtype=np.uint8)
