"""videocrop: cuts the borders off raw video."""

from __future__ import annotations

from typing import Any

from typing_extensions import override

from streamkit import Caps, Frame, IntRange, NotNegotiated, Property, Structure, ValueList
from streamkit_video.arrangement import crop_image
from streamkit_video.pixel_formats import FORMATS, odd_size_error, supports_size
from streamkit_video.reframing import IDENTITY, ReframingTransform

MAX_SIDE, INT_MAX = 32767, 2**31 - 1


class VideoCrop(ReframingTransform):
    """Cuts pixels off the borders of raw video.

    Registration, detections and tracks move with the pixels; those outside the new frame stay in the lists.
    The field of view and the corners of a pose are left out, because they are those of the whole frame.

    Example:
        videotestsrc num-buffers=5 ! videocrop top=40 bottom=40 ! fakesink
    """

    sink = src = f"video/x-raw, format={{ {', '.join(FORMATS)} }}"
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
        structures = []
        for structure in caps.structures:
            changed = {
                name: _shifted(structure.fields[name], change)
                for name, change in changes.items()
                if change and name in structure.fields
            }
            structures.append(Structure(structure.name, {**structure.fields, **changed}, structure.features))
        return Caps(structures)

    @override
    def configure(self, sink_caps: Caps, src_caps: Caps) -> None:
        self._format = str(sink_caps["format"])
        width, height = sink_caps.integer("width"), sink_caps.integer("height")
        self._size = width - self.left - self.right, height - self.top - self.bottom
        if min(self._size) < 1:
            raise NotNegotiated(
                f"{self.name}: nothing is left of {width}x{height} px without {self.left} + {self.right} "
                f"columns and {self.top} + {self.bottom} rows: crop less"
            )
        if not supports_size(self._format, *self._size):
            raise NotNegotiated(f"{self.name}: {odd_size_error(self._format, *self._size)}")
        self.mapping = IDENTITY.copy()
        self.mapping[:2, 2] = -self.left, -self.top

    @override
    def transform(self, frame: Frame) -> Frame:
        is_whole = not (self.left or self.top or self.right or self.bottom)
        data = None if is_whole else crop_image(frame.data, self._format, self.left, self.top, self._size)
        return self.reframed(frame, data)


def _shifted(value: Any, change: int) -> Any:
    """A side in caps, longer by `change` px; 1 where nothing would be left, which `configure` refuses."""
    if isinstance(value, IntRange):
        low, high = (min(INT_MAX, max(1, end + change)) for end in (value.low, value.high))
        return IntRange(low, high) if low < high else low
    if isinstance(value, ValueList):
        return ValueList(tuple(dict.fromkeys(_shifted(item, change) for item in value.items)))
    return max(1, value + change)
