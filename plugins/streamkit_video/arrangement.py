"""Crops and flips of raw frames: pixels are moved, never computed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from streamkit import Choice
from streamkit_video.pixel_formats import map_planes

ByteArray = NDArray[np.uint8]
FloatArray = NDArray[np.float64]


class VideoDirection(Choice):
    """How a frame is turned or mirrored, in GStreamer's words: those of `video-direction`, then `method`."""

    IDENTITY = "identity", 0, "none"
    CLOCKWISE = "90r", 1, "clockwise"
    HALF_TURN = "180", 2, "rotate-180"
    COUNTERCLOCKWISE = "90l", 3, "counterclockwise"
    HORIZONTAL = "horiz", 4, "horizontal-flip"
    VERTICAL = "vert", 5, "vertical-flip"
    UPPER_LEFT = "ul-lr", 6, "upper-left-diagonal"
    UPPER_RIGHT = "ur-ll", 7, "upper-right-diagonal"


# The new x and y of the unit vectors' sums: each row is a new axis in terms of the old x and y.
LINEAR = {
    VideoDirection.IDENTITY: ((1, 0), (0, 1)),
    VideoDirection.CLOCKWISE: ((0, -1), (1, 0)),
    VideoDirection.HALF_TURN: ((-1, 0), (0, -1)),
    VideoDirection.COUNTERCLOCKWISE: ((0, 1), (-1, 0)),
    VideoDirection.HORIZONTAL: ((-1, 0), (0, 1)),
    VideoDirection.VERTICAL: ((1, 0), (0, -1)),
    VideoDirection.UPPER_LEFT: ((0, 1), (1, 0)),
    VideoDirection.UPPER_RIGHT: ((0, -1), (-1, 0)),
}


def swaps_sides(direction: VideoDirection) -> bool:
    """Whether width and height change places."""
    return LINEAR[direction][0][0] == 0


def flip_homography(direction: VideoDirection, before: tuple[int, int]) -> FloatArray:
    """Maps pixels of an image of a width and height, px, to pixels of the flipped image: float64[3, 3]."""
    mapping = np.eye(3)
    mapping[:2, :2] = LINEAR[direction]
    # The axis that runs backwards begins at the far border.
    far = mapping[:2, :2] @ (before[0] - 1.0, before[1] - 1.0)
    mapping[:2, 2] = np.maximum(0.0, -far)
    return mapping


def crop_image(data: ByteArray, pixel_format: str, left: int, top: int, size: tuple[int, int]) -> ByteArray:
    """The part of a frame, uint8 laid out as `pixel_format`, that begins at `left` and `top`; a new array.

    The chroma of I420 and NV12 begins at the even pixel before, as in GStreamer.
    """
    width, height = size

    def crop(plane: ByteArray, step: int) -> ByteArray:
        return plane[top // step :, left // step :][: height // step, : width // step]

    return map_planes(data, pixel_format, crop)


def flip_image(data: ByteArray, pixel_format: str, direction: VideoDirection) -> ByteArray:
    """A frame, uint8 laid out as `pixel_format`, turned or mirrored; a new array."""
    backwards_x, backwards_y = (min(row) < 0 for row in LINEAR[direction])

    def flip(plane: ByteArray, _: int) -> ByteArray:
        if swaps_sides(direction):
            plane = plane.swapaxes(0, 1)
        return plane[:: -1 if backwards_y else 1, :: -1 if backwards_x else 1]

    return map_planes(data, pixel_format, flip)
