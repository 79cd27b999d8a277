"""textoverlay, timeoverlay and clockoverlay: write text, times and dates into the video."""

from __future__ import annotations

import re
from datetime import UTC, datetime

import cv2
import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from streamkit import SECOND_NS, Choice, Frame, Property, Transform

ByteArray = NDArray[np.uint8]

DEFAULT_SIZE = 18
MAX_LINES, MAX_CHARACTERS = 20, 400  # of the text that is drawn, and of a line
STROKES = (-1, -1, 0), (-1, 1, 0), (1, -1, 0), (1, 1, 0), (0, 0, 255)  # offsets, grey level; dark edge first
DARKER = 0.4  # the video behind the text, with `shaded-background`


class HorizontalAlignment(Choice):
    """Where a line begins or ends."""

    LEFT = "left", 0, "left"
    CENTER = "center", 1, "center"
    RIGHT = "right", 2, "right"


class VerticalAlignment(Choice):
    """Where the text stands."""

    BASELINE = "baseline", 0, "baseline"
    BOTTOM = "bottom", 1, "bottom"
    TOP = "top", 2, "top"
    CENTER = "center", 4, "center"


class TextOverlay(Transform):
    """Writes a text into the video, white with a dark edge.

    Example:
        videotestsrc num-buffers=5 ! textoverlay text="flight 7" valignment=top ! fakesink
    """

    sink = src = "video/x-raw, format={ BGR, RGB, BGRA, RGBA, GRAY8 }"

    text: str = Property("", live=True, doc="What to write; the other overlays write it before the time.")
    halignment: HorizontalAlignment = Property(
        HorizontalAlignment.CENTER, live=True, doc="Place from the left to the right."
    )
    valignment: VerticalAlignment = Property(
        VerticalAlignment.BASELINE, live=True, doc="Place from the top to the bottom."
    )
    xpad: int = Property(
        25, min=0, max=32767, live=True, unit="px", doc="Distance from the left or right border."
    )
    ypad: int = Property(
        25, min=0, max=32767, live=True, unit="px", doc="Distance from the top or bottom border."
    )
    font_desc: str = Property(
        "",
        live=True,
        doc="Pango's description, as `Sans, 24`; its number is the size in px, the font is one.",
    )
    shaded_background: bool = Property(False, live=True, doc="Darken the video behind the text.")

    @override
    def start(self) -> None:
        self._font = cv2.FontFace("sans")

    def written(self, frame: Frame) -> str:
        """The text for a frame."""
        return self.text

    @override
    def transform(self, frame: Frame) -> Frame:
        lines = self.written(frame).split("\n")[:MAX_LINES]
        if not any(lines):
            return frame
        frame = frame.writable()
        size = font_size(self.font_desc)
        step, height = round(1.3 * size), frame.data.shape[0]
        below = step * (len(lines) - 1)
        first = {
            VerticalAlignment.TOP: self.ypad + size,
            VerticalAlignment.CENTER: (height - below + size) // 2,
            VerticalAlignment.BASELINE: height - self.ypad - below,
            VerticalAlignment.BOTTOM: height - self.ypad - below - round(0.25 * size),
        }[self.valignment]
        for number, line in enumerate(lines):
            self._write(frame.data, line[:MAX_CHARACTERS], first + step * number, size)
        return frame

    def _write(self, image: ByteArray, line: str, baseline: int, size: int) -> None:
        """Writes a line into an image, uint8[h, w] or uint8[h, w, channels]."""
        height, width = image.shape[:2]
        _, _, length, _ = cv2.getTextSize((width, height), line, (0, baseline), self._font, size)
        start = {
            HorizontalAlignment.LEFT: self.xpad,
            HorizontalAlignment.CENTER: (width - length) // 2,
            HorizontalAlignment.RIGHT: width - self.xpad - length,
        }[self.halignment]
        if self.shaded_background:
            top, bottom = max(0, baseline - size), max(0, baseline + round(0.3 * size))
            behind = image[top:bottom, max(0, start - 4) : max(0, start + length + 4)]
            colours = behind[..., :3] if image.ndim == 3 else behind
            colours[:] = colours * DARKER
        for right, down, level in STROKES:
            place = start + right, baseline + down
            cv2.putText(image, line, place, (level, level, level, 255), self._font, size)


class TimeOverlay(TextOverlay):
    """Writes the time of each frame into the video, hours:minutes:seconds.

    Example:
        videotestsrc num-buffers=5 ! timeoverlay ! fakesink
    """

    halignment: HorizontalAlignment = Property(
        HorizontalAlignment.LEFT, live=True, doc="Place from the left to the right."
    )
    valignment: VerticalAlignment = Property(
        VerticalAlignment.TOP, live=True, doc="Place from the top to the bottom."
    )

    def time(self, frame: Frame) -> str:
        """What is written after the text."""
        if frame.pts is None:
            return ""
        milliseconds = frame.pts * 1000 // SECOND_NS
        seconds, milliseconds = divmod(milliseconds, 1000)
        return f"{seconds // 3600}:{seconds // 60 % 60:02}:{seconds % 60:02}.{milliseconds:03}"

    @override
    def written(self, frame: Frame) -> str:
        return f"{self.text} {self.time(frame)}".strip()


class ClockOverlay(TimeOverlay):
    """Writes the time of day at which each frame was captured, in UTC; now, where that is unknown.

    `time-format` adds the date.

    Example:
        videotestsrc num-buffers=5 ! clockoverlay time-format="%Y-%m-%d %H:%M:%S" ! fakesink
    """

    time_format: str = Property("%H:%M:%S", live=True, doc="As of strftime.")

    @override
    def time(self, frame: Frame) -> str:
        now = datetime.now(UTC)
        if frame.capture is not None:
            now = datetime.fromtimestamp(frame.capture.utc_ns / SECOND_NS, UTC)
        return now.strftime(self.time_format)


def font_size(description: str) -> int:
    """The number at the end of one of Pango's descriptions of a font, px, within 4 to 400."""
    found = re.search(r"([0-9]{1,4})(\.[0-9]+)?(px)?\s*$", description)
    return min(400, max(4, int(found[1]))) if found else DEFAULT_SIZE
