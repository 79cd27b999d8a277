"""videoflip: turns and mirrors raw video."""

from __future__ import annotations

import numpy as np
from typing_extensions import override

from streamkit import Caps, Choice, Property
from streamkit_video.pixel_formats import ByteArray, map_planes
from streamkit_video.reframing import FloatArray, ReframingTransform, Size


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


class VideoFlip(ReframingTransform):
    """Turns raw video by quarter turns, or mirrors it.

    Registration, detections and tracks turn with the pixels. The field of view and the corners of a pose are
    left out, because they are those of the frame as it was taken. `decode` turns video by its rotation mark.

    Example:
        videotestsrc num-buffers=5 ! videoflip video-direction=180 ! fakesink
    """

    keeps_view = False

    video_direction: VideoDirection = Property(
        VideoDirection.IDENTITY,
        aliases=("method",),
        doc="Quarter turn (90r is clockwise) or mirror image; or the words of GStreamer's older `method`.",
    )

    @override
    def transform_caps(self, caps: Caps, direction: str) -> Caps:
        if caps.is_any or not swaps_sides(self.video_direction):
            return caps
        other = {"width": "height", "height": "width"}
        return caps.map_fields(
            lambda fields: {other.get(name, name): value for name, value in fields.items()}
        )

    @override
    def mapping(self, before: Size, after: Size) -> FloatArray:
        return flip_homography(self.video_direction, before)

    @override
    def reframed(self, data: ByteArray, pixel_format: str, after: Size) -> ByteArray:
        backwards_x, backwards_y = (min(row) < 0 for row in LINEAR[self.video_direction])

        def flip(plane: ByteArray, _: int) -> ByteArray:
            if swaps_sides(self.video_direction):
                plane = plane.swapaxes(0, 1)
            return plane[:: -1 if backwards_y else 1, :: -1 if backwards_x else 1]

        return map_planes(data, pixel_format, flip)


def swaps_sides(direction: VideoDirection) -> bool:
    """Whether width and height change places."""
    return LINEAR[direction][0][0] == 0


def flip_homography(direction: VideoDirection, before: Size) -> FloatArray:
    """Maps pixels of an image of a width and height, px, to pixels of the flipped image: float64[3, 3]."""
    mapping = np.eye(3)
    mapping[:2, :2] = LINEAR[direction]
    # The axis that runs backwards begins at the far border.
    far = mapping[:2, :2] @ (before[0] - 1.0, before[1] - 1.0)
    mapping[:2, 2] = np.maximum(0.0, -far)
    return mapping
