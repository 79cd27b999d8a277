"""videocrop: cuts the borders off raw video."""

from __future__ import annotations

from typing import Any

import numpy as np
from typing_extensions import override

from streamkit import Caps, IntRange, NotNegotiated, Property, ValueList
from streamkit.geometry.homography import translation
from streamkit_video.pixel_formats import ByteArray, map_planes
from streamkit_video.reframing import FloatArray, ReframingTransform, Size

MAX_SIDE, INT_MAX = 32767, 2**31 - 1


class VideoCrop(ReframingTransform):
    """Cuts pixels off the borders of raw video.

    Registration, detections and tracks move with the pixels; those outside the new frame stay in the lists.
    The field of view and the corners of a pose are left out, because they are those of the whole frame.

    Example:
        videotestsrc num-buffers=5 ! videocrop top=40 bottom=40 ! fakesink
    """

    keeps_view = False

    top: int = Property(0, min=0, max=MAX_SIDE, unit="px", doc="Rows cut off at the top.")
    bottom: int = Property(0, min=0, max=MAX_SIDE, unit="px", doc="Rows cut off at the bottom.")
    left: int = Property(0, min=0, max=MAX_SIDE, unit="px", doc="Columns cut off at the left.")
    right: int = Property(0, min=0, max=MAX_SIDE, unit="px", doc="Columns cut off at the right.")

    @override
    def transform_caps(self, caps: Caps, direction: str) -> Caps:
        if caps.is_any:
            return caps
        sign = -1 if direction == "sink" else 1
        changes = {"width": sign * (self.left + self.right), "height": sign * (self.top + self.bottom)}
        return caps.map_fields(
            lambda fields: {
                name: _shifted(value, change) if (change := changes.get(name)) else value
                for name, value in fields.items()
            }
        )

    @override
    def mapping(self, before: Size, after: Size) -> FloatArray:
        if after != (before[0] - self.left - self.right, before[1] - self.top - self.bottom):
            raise NotNegotiated(
                f"{self.name}: nothing is left of {before[0]}x{before[1]} px without {self.left} + "
                f"{self.right} columns and {self.top} + {self.bottom} rows: crop less"
            )
        return translation(-np.array([self.left, self.top]))

    @override
    def reframed(self, data: ByteArray, pixel_format: str, after: Size) -> ByteArray:
        width, height = after

        def crop(plane: ByteArray, step: int) -> ByteArray:
            # Chroma begins at the even pixel before, as in GStreamer.
            return plane[self.top // step :, self.left // step :][: height // step, : width // step]

        return map_planes(data, pixel_format, crop)


def _shifted(value: Any, change: int) -> Any:
    """A side in caps, longer by `change` px; 1 where nothing would be left, which `configure` refuses."""
    if isinstance(value, IntRange):
        low, high = (min(INT_MAX, max(1, end + change)) for end in (value.low, value.high))
        return IntRange(low, high) if low < high else low
    if isinstance(value, ValueList):
        return ValueList(tuple(dict.fromkeys(_shifted(item, change) for item in value.items)))
    return max(1, value + change)
