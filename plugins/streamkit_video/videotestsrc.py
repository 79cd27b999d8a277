"""videotestsrc: generates test images."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from fractions import Fraction

import numpy as np
from typing_extensions import override

from streamkit import Caps, Frame, Property, Source
from streamkit_video.patterns import MOVING, Pattern, paint
from streamkit_video.pixel_formats import FORMATS, convert
from streamkit_video.videoconvert import choose_format

PREFERRED = Caps("video/x-raw, width=320, height=240, framerate=30/1")
RATE_WITHOUT_FRAMERATE = Fraction(30)


class VideoTestSrc(Source):
    """Generates test images in any raw format; the same properties and caps give the same frames.

    Example:
        videotestsrc num-buffers=5 pattern=ball ! fakesink
    """

    src = (
        f"video/x-raw, format={{ {', '.join(FORMATS)} }}, width=[ 1, 16384 ], height=[ 1, 16384 ], "
        "framerate=[ 0/1, 1000/1 ]"
    )

    num_buffers: int = Property(-1, min=-1, max=2**31 - 1, doc="Frames before EOS; -1 is endless.")
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
    is_live: bool = Property(False, doc="Pace the frames in real time, as a camera does.")

    @override
    def negotiate(self, allowed: Caps) -> Caps:
        """The nearest to 320x240 at 30 frames a second."""
        return choose_format(allowed, PREFERRED, self.name)

    @override
    def duration_ns(self) -> int | None:
        rate = self.src_caps.get("framerate")
        if self.num_buffers < 0 or not isinstance(rate, Fraction) or rate <= 0:
            return None
        return int(self.num_buffers * 1_000_000_000 / rate)

    @override
    def frames(self) -> Iterator[Frame]:
        began_ns, start_ns, left = self.clock_ns(), 0, self.num_buffers
        while left:
            count = 0
            for frame in self._frames_of(self.src_caps, start_ns, began_ns):
                yield frame
                count += 1
                start_ns = (frame.pts or 0) + (frame.duration or 0) - self.timestamp_offset
                if count == left or self.src_caps is not frame.caps:
                    break
            else:
                return
            left -= count if left > 0 else 0

    def _frames_of(self, caps: Caps, start_ns: int, began_ns: int) -> Iterator[Frame]:
        """Endless frames of one format; ends only when the pipeline stops. A static image is painted once."""
        rate = caps["framerate"]
        pace = rate if isinstance(rate, Fraction) and rate > 0 else RATE_WITHOUT_FRAMERATE
        is_moving = self.pattern in MOVING or self.horizontal_speed != 0
        static = None if is_moving else self._paint(caps, 0)
        first = round(start_ns * pace / 1_000_000_000)
        for count in itertools.count():
            pts, end = (start_ns + int(number * 1_000_000_000 / pace) for number in (count, count + 1))
            if self.is_live and not self.clock.wait_until(began_ns + pts, self.over):
                return
            frame = static or self._paint(caps, first + count)
            yield frame.replace(pts=pts + self.timestamp_offset, duration=end - pts)

    def _paint(self, caps: Caps, index: int) -> Frame:
        size = caps.integer("width"), caps.integer("height")
        colours = _bgr(self.foreground_color), _bgr(self.background_color)
        image = paint(self.pattern, *size, index, self.seed, colours)
        if self.horizontal_speed:
            image = np.roll(image, -index * self.horizontal_speed, axis=1)
        return Frame(convert(image, "BGR", str(caps["format"])), caps)


def _bgr(argb: int) -> tuple[int, int, int]:
    return argb & 255, argb >> 8 & 255, argb >> 16 & 255
