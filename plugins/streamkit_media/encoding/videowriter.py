"""Frames to an H.264 file that plays everywhere, each frame at its own time."""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction

from av.container import OutputContainer

from streamkit.output.file import OutputFile
from streamkit_media.encoding.encoder import SECOND_NS, Encoder, EncoderSettings
from streamkit_media.encoding.pixel_layout import Pixels
from streamkit_media.recording.packetwriter import FRAGMENT_TICKS, TIME_BASE, open_muxer

# The encoder holds back a dozen frames; at lower rates that is more than a second.
LOWEST_RATE = 12


class VideoWriter:
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
        self._frame_ticks = max(1, round(1 / framerate / TIME_BASE))
        self._offset: int | None = None
        self._last = -self._frame_ticks
        self._failure: Exception | None = None
        self._file = file
        self._container: OutputContainer | None = open_muxer(file, encoded_here=True)
        settings = replace(settings, live=framerate < LOWEST_RATE)
        self._encoder = Encoder(
            settings, pixel_format, (width, height), framerate, self._container, TIME_BASE
        )

    def write(self, pixels: Pixels, pts: int | None) -> None:
        """Encodes one frame.

        Args:
            pixels: uint8 array in the writer's format and size.
            pts: its time, ns; the first one becomes 0. None, or one that does not ascend, follows the last at
                the frame rate.

        Raises:
            ValueError: the array is of another shape or type.
            FFmpegError: encoding or writing failed, this time or before: FFmpeg crashes at the next packet
                where the container's head could not be written.
        """
        assert self._container is not None
        if self._failure is not None:
            raise self._failure
        try:
            packets = self._encoder.encode(pixels, self._ticks(pts))
            self._container.mux(packets)
            if self._file.failure is not None:
                raise self._file.failure
        except Exception as error:
            self._failure = error
            raise
        if packets and self._last >= 2 * FRAGMENT_TICKS:
            self._file.publish()

    def close(self, limit_s: float | None = None) -> bool:
        """Writes what the encoder holds and the file's index. Safe to call twice.

        Args:
            limit_s: time for the frames still in the encoder; later ones are left out. None waits for all.

        Returns:
            Whether every frame is in the file, but for those that `write` has refused.

        Raises:
            FFmpegError: writing failed.
        """
        container, self._container = self._container, None
        if container is None:
            return True
        try:
            is_complete = self._last < 0 or self._failure is not None or self._flush(container, limit_s)
            container.close()
        except BaseException:
            self._file.discard()
            raise
        if self._last < 0:
            self._file.discard()
        else:
            self._file.finish()
        if self._file.failure is not None:
            raise self._file.failure
        return is_complete

    def abandon(self) -> None:
        """Leaves the file as it is after an error; never fails."""
        container, self._container = self._container, None
        with suppress(Exception):
            if container is not None:
                container.close()
        self._file.abandon()

    def _flush(self, container: OutputContainer, limit_s: float | None) -> bool:
        deadline = None if limit_s is None else time.monotonic() + limit_s
        for packet in self._encoder.finish():
            container.mux(packet)
            if deadline is not None and time.monotonic() > deadline:
                return False
        return True

    def _ticks(self, pts: int | None) -> int:
        following = self._last + self._frame_ticks
        ticks = following
        if pts is not None:
            own = round(Fraction(pts, SECOND_NS) / TIME_BASE)
            if self._offset is None or own + self._offset <= self._last:
                self._offset = following - own
            ticks = own + self._offset
        self._last = ticks
        return ticks
