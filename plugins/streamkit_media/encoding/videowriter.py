"""Frames to an H.264 file that plays everywhere, each frame at its own time."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from fractions import Fraction

from streamkit.output.file import OutputFile
from streamkit_media.decoding.frame_arrays import Pixels
from streamkit_media.encoding.encoder import Encoder, EncoderSettings
from streamkit_media.recording.filemuxer import (
    FORMATS,
    FRAGMENT_TICKS,
    FRAGMENTED,
    TIME_BASE,
    FileMuxer,
    ticks,
)

# Hybrid fragmented MP4: indexed when closed. FFmpeg's muxer crashes on some damaged streams, so it is used
# for frames encoded here only.
HYBRID = {"movflags": "hybrid_fragmented+frag_keyframe+negative_cts_offsets", "frag_duration": "500000"}
OWN_FORMATS = {
    suffix: (name, HYBRID if options is FRAGMENTED else options)
    for suffix, (name, options) in FORMATS.items()
}
# The encoder holds back a dozen frames; at lower rates that is more than a second.
LOWEST_RATE = 12
SLOWEST_RATE = Fraction(1, 3600)  # for the encoder; MP4 cannot hold a frame of 7 hours


class VideoWriter(FileMuxer):
    """Writes H.264 video in yuv420p, in the container that the file's name asks for.

    Args:
        file: is closed by `close`.
        pixel_format: of the arrays: GRAY8, I420, NV12, BGR or RGB.
        width: px.
        height: px.
        framerate: frames per second; paces frames without a time, and the encoder's rate control.
        settings: of the encoder.

    Raises:
        FFmpegError: the encoder does not take the settings.
    """

    def __init__(
        self,
        file: OutputFile,
        pixel_format: str,
        width: int,
        height: int,
        framerate: Fraction,
        settings: EncoderSettings,
    ) -> None:
        self.pixel_format, self.width, self.height = pixel_format, width, height
        framerate = max(framerate, SLOWEST_RATE)
        self._frame_ticks = max(1, round(1 / framerate / TIME_BASE))
        self._offset: int | None = None
        self._last = -self._frame_ticks
        super().__init__(file, OWN_FORMATS)
        settings = replace(settings, live=framerate < LOWEST_RATE)
        self._encoder = Encoder(settings, pixel_format, (width, height), framerate, self.container, TIME_BASE)

    def write(self, pixels: Pixels, pts: int | None) -> None:
        """Encodes one frame.

        Args:
            pixels: uint8 array in the writer's format and size.
            pts: its time, ns; the first one becomes 0. None, or one that does not ascend, follows the last at
                the frame rate.

        Raises:
            ValueError: the array is of another shape or type, or the container cannot hold so long a pause.
            FFmpegError: encoding or writing failed, this time or before.
        """
        for packet in self._encoder.encode(pixels, self._place(pts)):
            self.mux(packet, can_play=self._last >= 2 * FRAGMENT_TICKS)

    def close(self, limit_s: float | None = None) -> bool:
        """Writes what the encoder holds and the file's index. Safe to call twice.

        Args:
            limit_s: time for the frames still in the encoder; later ones are left out. None waits for all.

        Returns:
            Whether every frame is in the file, but for those that `write` has refused.

        Raises:
            FFmpegError: writing failed.
        """
        deadline = time.monotonic() + (math.inf if limit_s is None else limit_s)
        has_content = self._last >= 0
        try:
            for packet in self._encoder.finish() if has_content and not self.is_closed else ():
                self.mux(packet, can_play=False)
                if time.monotonic() > deadline:
                    return False
        finally:
            self.finish(is_kept=has_content)
        return True

    def _place(self, pts: int | None) -> int:
        place = following = self._last + self._frame_ticks
        if pts is not None:
            own = ticks(pts)
            if self._offset is None or own + self._offset <= self._last:
                self._offset = following - own
            place = own + self._offset
            self.check_pause(place - self._last)
        self._last = place
        return place
