"""A container in a file that plays up to the last second, however the process ends."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from fractions import Fraction

import av
from av.container import OutputContainer
from av.packet import Packet
from av.stream import Stream

from streamkit import SECOND_NS
from streamkit.output.file import OutputFile

TIME_BASE = Fraction(1, 90_000)
FRAGMENT_TICKS = TIME_BASE.denominator  # an older file is replaced once so much can be played
MAX_TICKS = 2**31 - 1  # MP4 holds durations in 32 bits; FFmpeg writes longer ones wrong, or crashes
# Without these FFmpeg keeps up to ten seconds back to interleave with a resting stream, and 32 KB to write.
ALWAYS = {"flush_packets": "1", "max_interleave_delta": "500000"}
FRAGMENTED = {"movflags": "frag_keyframe+empty_moov+default_base_moof", "frag_duration": "500000"}
FORMATS: dict[str, tuple[str, dict[str, str]]] = {
    ".mp4": ("mp4", FRAGMENTED),
    ".mov": ("mov", FRAGMENTED),
    ".mkv": ("matroska", {"cluster_time_limit": "500"}),
    ".ts": ("mpegts", {}),
    ".mts": ("mpegts", {}),
    ".m2ts": ("mpegts", {"mpegts_m2ts_mode": "1"}),
}


class FileMuxer:
    """Base of what writes packets to a container in a file.

    Args:
        file: of a name in `formats`; FFmpeg would leave one of its own open where the head cannot be written.
        formats: FFmpeg's format and its options for each ending of a name.

    Attributes:
        file: the file.
        container: until it `is_closed`.
        failure: the first error of a packet. No packet may follow: FFmpeg crashes where the container's head
            could not be written.
    """

    def __init__(self, file: OutputFile, formats: Mapping[str, tuple[str, dict[str, str]]] = FORMATS) -> None:
        self.failure: Exception | None = None
        self.file = file
        self.is_closed = False
        name, options = formats[file.path.suffix.lower()]
        self._is_limited = "movflags" in options
        self.container: OutputContainer = av.open(
            file, "w", format=name, container_options={**ALWAYS, **options}
        )

    def mux(self, packet: Packet[Stream], *, can_play: bool) -> None:
        """Writes one packet; the file replaces an older one once it `can_play`.

        Raises:
            FFmpegError: the container does not take the packet, or did not take one before.
            OSError: the file cannot be written.
        """
        if self.failure is None:
            try:
                self.container.mux_one(packet)
            except Exception as error:
                self.failure = error
            self.failure = self.file.failure or self.failure
        if self.failure is not None:
            raise self.failure
        if can_play:
            self.file.publish()

    def check_pause(self, pause: int) -> None:
        """Checks that the container can hold a pause between two frames, in units of `TIME_BASE`.

        Raises:
            ValueError: it is too long.
        """
        if self._is_limited and pause > MAX_TICKS:
            hours = 3600 * TIME_BASE.denominator
            raise ValueError(
                f"{self.file.path.suffix} holds pauses of up to {MAX_TICKS / hours:.1f} h between two "
                f"frames, this is one of {pause / hours:.1f} h; write .mkv or .ts, or segments"
            )

    def finish(self, *, is_kept: bool) -> None:
        """Writes the container's end; removes the file unless it `is_kept`. Safe to call twice.

        Raises:
            OSError: writing failed.
        """
        is_whole = False
        try:
            self._close()
            is_whole = self.failure is None
        finally:
            if not is_kept:
                self.file.discard()
            elif is_whole:
                self.file.finish()
            else:
                self.file.abandon()
        if is_whole and self.file.failure is not None:
            self.failure = self.file.failure
            raise self.failure

    def abandon(self) -> None:
        """Leaves the file as it is after an error; never fails."""
        with suppress(Exception):
            self._close()
        self.file.abandon()

    def _close(self) -> None:
        if not self.is_closed:
            self.is_closed = True
            self.container.close()


def ticks(ns: int) -> int:
    """A time in units of `TIME_BASE`."""
    return round(Fraction(ns, SECOND_NS) / TIME_BASE)
