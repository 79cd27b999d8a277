"""Files of coded packets that play up to the last second, however the process ends."""

from __future__ import annotations

import io
from contextlib import suppress
from fractions import Fraction
from functools import cache
from typing import TypeAlias

import av
from av.container import OutputContainer
from av.error import FFmpegError, InvalidDataError
from av.packet import Packet
from av.stream import Stream

from streamkit import SECOND_NS
from streamkit.output.file import OutputFile
from streamkit_media.nalunits import CODECS, LOOK_BYTES, START_CODES, AnnexBConverter, BadPacket
from streamkit_media.recording.destination import Destination, Playlist
from streamkit_media.recording.parametersets import check_parameter_sets

TIME_BASE = Fraction(1, 90_000)
FRAGMENT_TICKS = TIME_BASE.denominator  # an older file is replaced once so much can be played
MIN_TICKS = -60 * TIME_BASE.denominator  # more than any encoder reorders
MAX_TICKS = 2**31 - 1  # MP4 holds durations in 32 bits; FFmpeg writes longer ones wrong, or crashes
# Without these FFmpeg keeps up to ten seconds back to interleave with a resting stream, and 32 KB to write.
# Times stay, so that records of the stream can be matched; FFmpeg would move the first decoding time to 0.
ALWAYS = {"flush_packets": "1", "max_interleave_delta": "500000", "avoid_negative_ts": "disabled"}
# The last two keep the time of a first frame that is later than 0.
FRAGMENTED = {
    "movflags": "frag_keyframe+empty_moov+default_base_moof+frag_discont",
    "frag_duration": "500000",
    "use_editlist": "0",
}
ContainerFormat: TypeAlias = tuple[str, dict[str, str]]
Output: TypeAlias = OutputFile | Destination
FORMATS: dict[str, ContainerFormat] = {
    ".mp4": ("mp4", FRAGMENTED),
    ".mov": ("mov", FRAGMENTED),
    ".mkv": ("matroska", {"cluster_time_limit": "500"}),
    ".ts": ("mpegts", {}),
    ".mts": ("mpegts", {}),
    ".m2ts": ("mpegts", {"mpegts_m2ts_mode": "1"}),
}
HLS = "hls"
WITH_KLV = WITHOUT_HEADERS = frozenset({"mpegts", HLS})
# FFmpeg writes any other codec to a transport stream as data that nothing plays.
TRANSPORT_CODECS = frozenset(
    {"h264", "hevc", "vvc", "mpeg4", "mpeg2video", "mpeg1video", "vc1", "cavs", "dirac"}
)
NOT_IN_MOV = frozenset({"av1", "vp8", "vp9"})  # FFmpeg refuses them with the first packet
# Codecs whose packets, or FFmpeg's muxers, need no headers beside the packets.
HEADERS_IN_PACKETS = CODECS | {"av1", "vp8", "vp9", "mjpeg"}


class PacketWriter:
    """Writes packets to a container.

    Args:
        file: takes it; FFmpeg would leave one of its own open where the head cannot be written.
        container: FFmpeg's format and its options.
        codec: of the video, FFmpeg's name.
        size: width, height, px.
        extradata: the codec's headers kept outside the packets.
        rate: frames per second, for packets without a duration; None if unknown.
        with_klv: whether there is a stream of KLV telemetry too.

    Attributes:
        file: the file.
        has_begun: whether the container's head is written; a packet may be left out from then on.
        failure: the first error of a packet. No packet may follow: FFmpeg crashes where the container's head
            could not be written.

    Raises:
        ValueError: the container cannot hold this codec.
        BadPacket: the extradata are damaged.
    """

    def __init__(
        self,
        file: Output,
        container: ContainerFormat,
        codec: str,
        size: tuple[int, int],
        extradata: bytes = b"",
        *,
        rate: Fraction | None = None,
        with_klv: bool = False,
    ) -> None:
        self._annexb, self._codec = AnnexBConverter(codec, extradata), codec
        self.file = file
        self.failure: Exception | None = None
        self.has_begun = False
        self._is_closed = self._is_after_pause = False
        self._begin: int | None = None
        self._last_dts: dict[int, int] = {}
        name, options = container
        self._reads_parameter_sets = name not in WITHOUT_HEADERS
        self._is_limited = "movflags" in options
        self._before_first = MIN_TICKS if "negative_cts_offsets" in options.get("movflags", "") else -1
        options = {**ALWAYS, **options}
        if isinstance(file, Playlist):
            self._container: OutputContainer = av.open(
                str(file.path), "w", format=name, container_options=options | file.options, io_open=file.open
            )
        else:
            self._container = av.open(file, "w", format=name, container_options=options)
        try:
            check_codec(codec, name)
            self._headers = extradata if codec not in HEADERS_IN_PACKETS else b""
            if self._headers and not START_CODES.match(extradata):  # PyAV passes none to a muxer
                raise ValueError(f"{codec} has headers outside its packets; put decode ! encode before")
            self._video = self._container.add_mux_stream(codec, rate, width=size[0], height=size[1])
            self._klv: Stream | None = self._container.add_data_stream("klv") if with_klv else None
        except BaseException:
            self.close()
            raise

    def write_video(self, data: bytes, pts: int, dts: int, duration: int | None, is_keyframe: bool) -> int:
        """Writes one packet; the file's bytes are with the operating system when the next is written.

        Args:
            data: the packet as its source has it.
            pts: ns, 0 or more.
            dts: ns, at most `pts`.
            duration: ns; None if unknown.
            is_keyframe: whether playing can begin with it.

        Returns:
            Bytes written.

        Raises:
            OSError: writing failed, this time or before.
            FFmpegError: the container does not take this codec.
            ValueError: the container cannot hold so long a pause before the packet.
            BadPacket: the packet is damaged; nothing can be written after it unless the file `has_begun`.
        """
        data = self._annexb.packet(data, is_keyframe)
        if is_keyframe and not data.startswith(self._headers[:LOOK_BYTES]):
            data = self._headers + data
        if not self.has_begun and self._reads_parameter_sets:
            check_parameter_sets(self._codec, data)
        packet = Packet(data)
        packet.is_keyframe = is_keyframe
        return self._write(packet, self._video, ticks(pts), ticks(dts), ticks(duration or 0))

    def write_klv(self, data: bytes, pts: int) -> int:
        """Writes one KLV packet."""
        assert self._klv is not None
        packet = Packet(data)
        packet.is_keyframe = True
        return self._write(packet, self._klv, ticks(pts), ticks(pts), 0)

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

    def _write(self, packet: Packet[Stream], stream: Stream, pts: int, dts: int, duration: int) -> int:
        try:
            self.check_pause(dts - self._last_dts.get(stream.index, dts))
        except ValueError as error:
            if self._is_after_pause:
                raise
            # One packet after too long a pause is taken for damaged; the second shows the stream's own pause.
            self._is_after_pause = True
            raise BadPacket(str(error)) from None
        self._is_after_pause = False
        packet.stream = stream
        try:
            packet.time_base, packet.dts, packet.pts = TIME_BASE, dts, pts
            packet.duration = min(duration, MAX_TICKS)
        except OverflowError:
            raise BadPacket(f"its time of {pts / TIME_BASE.denominator:.3g} s is none") from None
        try:
            self._mux(packet)
        except FFmpegError as error:
            if not self.has_begun and not isinstance(error, InvalidDataError):
                raise
            refusal = BadPacket(f"it cannot be written: {error.strerror}")
            self.failure = None if self.has_begun else refusal
            raise refusal from None
        self.has_begun = True
        self._begin = pts if self._begin is None else self._begin
        if pts - self._begin >= FRAGMENT_TICKS:
            self.file.publish()
        return packet.size

    def _mux(self, packet: Packet[Stream]) -> None:
        if self.failure is None:
            try:
                self._order(packet)
                self._container.mux_one(packet)
            except Exception as error:
                self.failure = error
            self.failure = self.file.failure or self.failure
        if self.failure is not None:
            raise self.failure

    def _order(self, packet: Packet[Stream]) -> None:
        """Moves the decoding time above the last, and the presentation time not below it, and to 0 or more.

        Reordered frames begin with decoding times below 0, which MP4 with negative offsets holds; moved, they
        would shorten it.
        """
        lowest = self._last_dts.get(packet.stream_index, self._before_first) + 1
        packet.dts = dts = max(packet.dts or 0, lowest)
        packet.pts = max(packet.pts or 0, dts, 0)
        self._last_dts[packet.stream_index] = dts

    def close(self) -> None:
        """Completes the file, or removes it where nothing could be written. Safe to call twice.

        Raises:
            OSError: writing failed.
        """
        is_whole = False
        try:
            self._end()
            is_whole = self.failure is None
        finally:
            if not self.has_begun:
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
            self._end()
        self.file.abandon()

    def _end(self) -> None:
        if not self._is_closed:
            self._is_closed = True
            self._container.close()


def ticks(ns: int) -> int:
    """A time in units of `TIME_BASE`."""
    return round(Fraction(ns, SECOND_NS) / TIME_BASE)


@cache
def holds(name: str, codec: str) -> bool:
    """Whether a container holds a codec; both by FFmpeg's names, each pair asked of FFmpeg once."""
    if name in WITHOUT_HEADERS:
        return codec in TRANSPORT_CODECS
    with av.open(io.BytesIO(), "w", format=name) as container:
        return codec in container.supported_codecs and not (name == "mov" and codec in NOT_IN_MOV)


def check_codec(codec: str, name: str) -> None:
    """Checks that a container holds a codec.

    Raises:
        ValueError: it does not; with what does.
    """
    if not holds(name, codec):
        others = [suffix for suffix, (other, _) in FORMATS.items() if holds(other, codec)]
        remedy = f"write {' or '.join(others)}, or encode" if others else "encode"
        raise ValueError(f"{name} holds no {codec}; {remedy} to h264, h265 or mpeg4")
