"""videotestsrc: generates test images."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction

import numpy as np
from typing_extensions import override

from streamkit import SECOND_NS, Caps, Frame, Property
from streamkit_video.paced_source import PacedSource
from streamkit_video.patterns import MOVING, Pattern, paint
from streamkit_video.pixel_formats import FORMATS, convert


class VideoTestSrc(PacedSource):
    """Generates test images in any raw format; the same properties and caps give the same frames.

    Example:
        videotestsrc num-buffers=5 pattern=ball ! fakesink
    """

    src = (
        f"video/x-raw, format={{ {', '.join(FORMATS)} }}, width=[ 1, 16384 ], height=[ 1, 16384 ], "
        "framerate=[ 0/1, 1000/1 ]"
    )

    preferred = Caps("video/x-raw, width=320, height=240, framerate=30/1")

    pattern: Pattern = Property(Pattern.SMPTE, doc="Content of the frames.")
    foreground_color: int = Property(
        0xFFFFFFFF, min=0, max=2**32 - 1, unit="ARGB", doc="Colour of ball, blink, bar and solid-color."
    )
    background_color: int = Property(
        0xFF000000, min=0, max=2**32 - 1, unit="ARGB", doc="Colour behind ball and bar, and between blinks."
    )
    horizontal_speed: int = Property(
        0, min=-(2**31), max=2**31 - 1, unit="px/frame", doc="Speed of scrolling to the left."
    )
    timestamp_offset: int = Property(0, min=0, max=2874452364, unit="ns", doc="Added to every timestamp.")
    seed: int = Property(0, min=0, doc="Seed of snow.")

    @override
    def begin_format(self, caps: Caps, pace: Fraction, start_ns: int) -> None:
        self._index = round(start_ns * pace / SECOND_NS)
        is_moving = self.pattern in MOVING or self.horizontal_speed != 0
        self._static = None if is_moving else self._painted(caps)

    @override
    def next_frame(self, caps: Caps) -> Frame:
        frame = self._static or self._painted(caps)
        self._index += 1
        return frame

    @override
    def frames(self) -> Iterator[Frame]:
        for frame in super().frames():
            yield frame.replace(pts=(frame.pts or 0) + self.timestamp_offset)

    def _painted(self, caps: Caps) -> Frame:
        size = caps.integer("width"), caps.integer("height")
        colours = _bgr(self.foreground_color), _bgr(self.background_color)
        image = paint(self.pattern, *size, self._index, self.seed, colours)
        if self.horizontal_speed:
            image = np.roll(image, -self._index * self.horizontal_speed, axis=1)
        return Frame(convert(image, "BGR", str(caps["format"])), caps)


def _bgr(argb: int) -> tuple[int, int, int]:
    return argb & 255, argb >> 8 & 255, argb >> 16 & 255
