"""Coded packets to a file that plays up to the last second, however the process ends."""

from __future__ import annotations

from fractions import Fraction
from typing import NoReturn

import av
from av.container import OutputContainer
from av.error import FFmpegError, InvalidDataError
from av.packet import Packet
from av.stream import Stream

from streamkit.output.file import OutputFile
from streamkit_media.nalunits import AnnexBWriter, BadPacket
from streamkit_media.recording.parametersets import check_parameter_sets

TIME_BASE = Fraction(1, 90_000)
SECOND_NS = 1_000_000_000
FRAGMENT_TICKS = TIME_BASE.denominator  # an older file is replaced once so much can be played
# Without these FFmpeg keeps up to ten seconds back to interleave with a resting stream, and 32 KB to write.
ALWAYS = {"flush_packets": "1", "max_interleave_delta": "500000"}
# FFmpeg's hybrid, which gets one index in the end, crashes on some damaged streams: for frames encoded here.
FRAGMENTED = {"movflags": "frag_keyframe+empty_moov+default_base_moof", "frag_duration": "500000"}
HYBRID = {"movflags": "hybrid_fragmented+frag_keyframe+negative_cts_offsets", "frag_duration": "500000"}
FORMATS: dict[str, tuple[str, dict[str, str]]] = {
    ".mp4": ("mp4", FRAGMENTED),
    ".mov": ("mov", FRAGMENTED),
    ".mkv": ("matroska", {"cluster_time_limit": "500"}),
    ".ts": ("mpegts", {}),
    ".mts": ("mpegts", {}),
    ".m2ts": ("mpegts", {"mpegts_m2ts_mode": "1"}),
}
WITH_KLV = WITHOUT_HEADERS = frozenset({"mpegts"})


class PacketWriter:
    """One file being written.

    Args:
        file: of a name in `FORMATS`; is closed by `close`.
        codec: of the video, FFmpeg's name.
        size: width, height, px.
        extradata: the codec's headers kept outside the packets.
        with_klv: whether there is a stream of KLV telemetry too.

    Attributes:
        path: of the file.
        has_begun: whether the file's head is written; a packet may be left out from then on.

    Raises:
        ValueError: the container cannot hold this codec.
        BadPacket: the extradata are damaged.
    """

    def __init__(
        self,
        file: OutputFile,
        codec: str,
        size: tuple[int, int],
        extradata: bytes,
        with_klv: bool,
    ) -> None:
        self._annexb = AnnexBWriter(codec, extradata)
        self._codec = codec
        self.path = file.path
        self.has_begun = False
        self._failure: Exception | None = None
        self._reads_parameter_sets = FORMATS[self.path.suffix.lower()][0] not in WITHOUT_HEADERS
        # A file of ours: FFmpeg leaves its own open where the head could not be written.
        self._file = file
        self._container: OutputContainer | None = None
        try:
            self._container = open_muxer(file)
            self._video = self._container.add_mux_stream(codec, width=size[0], height=size[1])
            self._klv: Stream | None = self._container.add_data_stream("klv") if with_klv else None
        except BaseException:
            self.close()
            raise
        self._last_dts: dict[int, int] = {}

    def write_video(self, data: bytes, pts: int, dts: int, duration: int | None, is_keyframe: bool) -> int:
        """Writes one packet; the file's bytes are with the operating system when the next is written.

        Args:
            data: the packet as its source has it.
            pts: ns from the file's beginning.
            dts: ns, at most `pts`; does not fall.
            duration: ns; None if unknown.
            is_keyframe: whether playing can begin with it.

        Returns:
            Bytes written.

        Raises:
            OSError: writing failed, this time or before.
            FFmpegError: the container does not take this codec.
            BadPacket: the packet is damaged; nothing can be written after it unless the file `has_begun`.
        """
        data = self._annexb.packet(data, is_keyframe)
        if not self.has_begun and self._reads_parameter_sets:
            check_parameter_sets(self._codec, data)
        packet = Packet(data)
        packet.is_keyframe = is_keyframe
        return self._write(packet, self._video, _ticks(pts), _ticks(dts), _ticks(duration or 0))

    def write_klv(self, data: bytes, pts: int) -> int:
        """Writes one KLV packet."""
        assert self._klv is not None
        packet = Packet(data)
        packet.is_keyframe = True
        return self._write(packet, self._klv, _ticks(pts), _ticks(pts), 0)

    def _write(self, packet: Packet[Stream], stream: Stream, pts: int, dts: int, duration: int) -> int:
        assert self._container is not None
        if self._failure is not None:
            raise self._failure
        lowest = self._last_dts.get(stream.index, dts - 1) + 1
        dts = max(dts, lowest)
        packet.stream = stream
        try:
            packet.time_base, packet.dts, packet.pts = TIME_BASE, dts, max(pts, dts)
            packet.duration = duration
        except OverflowError:
            raise BadPacket(f"its time of {max(pts, dts) / TIME_BASE.denominator:.3g} s is none") from None
        self._last_dts[stream.index] = dts
        try:
            self._container.mux_one(packet)
        except Exception as error:
            self._refuse(error)
        if self._file.failure is not None:
            self._refuse(self._file.failure)
        self.has_begun = True
        if pts >= FRAGMENT_TICKS:
            self._file.publish()
        return packet.size

    def _refuse(self, error: Exception) -> NoReturn:
        """Raises BadPacket for a damaged packet, and the error itself where the file fails."""
        reason = self._file.failure or error
        if isinstance(reason, FFmpegError) and (self.has_begun or isinstance(reason, InvalidDataError)):
            refusal = BadPacket(f"it cannot be written: {reason.strerror}")
            # FFmpeg crashes at the next packet where the head was not written.
            self._failure = None if self.has_begun else refusal
            raise refusal from None
        self._failure = reason
        raise reason

    def close(self) -> None:
        """Completes the file, or removes it where nothing could be written. Safe to call twice.

        Raises:
            OSError: writing failed.
        """
        container, self._container = self._container, None
        try:
            if container is not None:
                container.close()
        finally:
            if not self.has_begun:
                self._file.discard()
            elif self._failure is not None:
                self._file.abandon()
            else:
                self._file.finish()
        if self._failure is None and self._file.failure is not None:
            self._failure = self._file.failure
            raise self._failure


def open_muxer(file: OutputFile, *, encoded_here: bool = False) -> OutputContainer:
    """A container of the format that the ending of the file's name asks for."""
    name, options = FORMATS[file.path.suffix.lower()]
    if encoded_here and options is FRAGMENTED:
        options = HYBRID
    return av.open(file, "w", format=name, container_options={**ALWAYS, **options})


def _ticks(ns: int) -> int:
    return round(ns * TIME_BASE.denominator / SECOND_NS)
