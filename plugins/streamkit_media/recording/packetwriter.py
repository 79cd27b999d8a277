"""Files of coded packets that play up to the last second, however the process ends."""

from __future__ import annotations

from contextlib import suppress
from fractions import Fraction
from typing import TypeAlias

import av
from av.container import OutputContainer
from av.error import FFmpegError, InvalidDataError
from av.packet import Packet
from av.stream import Stream

from streamkit import Caps
from streamkit.output.file import OutputFile
from streamkit_media.codecs import codec_of, extradata_of, size_of
from streamkit_media.nalunits import CODECS, LOOK_BYTES, START_CODES, AnnexBConverter, BadPacket
from streamkit_media.recording.destination import Destination, Playlist
from streamkit_media.recording.formats import ContainerFormat, check_codec
from streamkit_media.recording.parametersets import check_parameter_sets
from streamkit_media.streams import ticks

TIME_BASE = Fraction(1, 90_000)
FRAGMENT_TICKS = TIME_BASE.denominator  # an older file is replaced once so much can be played
MIN_TICKS = -60 * TIME_BASE.denominator  # more than any encoder reorders
MAX_TICKS = 2**31 - 1  # MP4 holds durations in 32 bits; FFmpeg writes longer ones wrong, or crashes
# Without these FFmpeg keeps up to ten seconds back to interleave with a resting stream, and 32 KB to write.
# Times stay, so that records of the stream can be matched; FFmpeg would move the first decoding time to 0.
ALWAYS = {"flush_packets": "1", "max_interleave_delta": "500000", "avoid_negative_ts": "disabled"}
# Codecs whose packets, or FFmpeg's muxers, need no headers beside the packets.
HEADERS_IN_PACKETS = CODECS | {"av1", "vp8", "vp9", "mjpeg"}
Output: TypeAlias = OutputFile | Destination


class PacketWriter:
    """Writes packets to a container.

    Args:
        file: gets the container. FFmpeg would leave a file of its own open where the head cannot be written.
        container: FFmpeg's format and its options.
        caps: of the packets.
        rate: frames per second, for packets without a duration; None if unknown.
        with_klv: whether there is a stream of KLV telemetry too.

    Attributes:
        file: the file.
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
        caps: Caps,
        *,
        rate: Fraction | None = None,
        with_klv: bool = False,
    ) -> None:
        codec, extradata = codec_of(caps), extradata_of(caps)
        self._annexb, self._codec = AnnexBConverter(codec, extradata), codec
        self.file = file
        self.failure: Exception | None = None
        self._is_closed = self._is_after_pause = False
        self._begin: int | None = None  # of the first packet, ticks
        self._last_dts: dict[int, int] = {}
        self._format = container
        options = {**ALWAYS, **container.options}
        if isinstance(file, Playlist):
            options |= file.options
            self._container: OutputContainer = av.open(
                str(file.path), "w", format=container.name, container_options=options, io_open=file.open
            )
        else:
            self._container = av.open(file, "w", format=container.name, container_options=options)
        try:
            check_codec(codec, container)
            self._headers = extradata if codec not in HEADERS_IN_PACKETS else b""
            if self._headers and not START_CODES.match(extradata):  # PyAV passes none to a muxer
                raise ValueError(f"{codec} has headers outside its packets; put decode ! encode before")
            width, height = size_of(caps)
            self._video = self._container.add_mux_stream(codec, rate, width=width, height=height)
            self._klv: Stream | None = self._container.add_data_stream("klv") if with_klv else None
        except BaseException:
            self.close()
            raise

    @property
    def has_begun(self) -> bool:
        """Whether the container's head is written; a packet may be left out from then on."""
        return self._begin is not None

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
        if not self.has_begun and not self._format.is_transport_stream:
            check_parameter_sets(self._codec, data)
        packet = Packet(data)
        packet.is_keyframe = is_keyframe
        return self._write(packet, self._video, pts, dts, duration or 0)

    def write_klv(self, data: bytes, pts: int) -> int:
        """Writes one KLV packet."""
        assert self._klv is not None
        packet = Packet(data)
        packet.is_keyframe = True
        return self._write(packet, self._klv, pts, pts, 0)

    def check_pause(self, pause: int) -> None:
        """Checks that the container can hold a pause between two frames, in units of `TIME_BASE`.

        Raises:
            ValueError: it is too long.
        """
        if self._format.is_mp4 and pause > MAX_TICKS:
            hours = 3600 * TIME_BASE.denominator
            raise ValueError(
                f"{self.file.path.suffix} holds pauses of up to {MAX_TICKS / hours:.1f} h between two "
                f"frames, this is one of {pause / hours:.1f} h; write .mkv or .ts, or segments"
            )

    def _write(
        self, packet: Packet[Stream], stream: Stream, pts_ns: int, dts_ns: int, duration_ns: int
    ) -> int:
        pts, dts, duration = (ticks(time_ns, TIME_BASE) for time_ns in (pts_ns, dts_ns, duration_ns))
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
            raise BadPacket(f"its time of {pts / TIME_BASE.denominator:.3g} s is out of range") from None
        self._mux(packet)
        self._begin = pts if self._begin is None else self._begin
        if pts - self._begin >= FRAGMENT_TICKS:
            self.file.publish()
        return packet.size

    def _mux(self, packet: Packet[Stream]) -> None:
        """Gives FFmpeg a packet; one that it refuses is left out, once the head is written."""
        if self.failure is not None:
            raise self.failure
        failure: Exception | None = None
        try:
            self._order(packet)
            self._container.mux_one(packet)
        except FFmpegError as error:
            is_refused = self.has_begun or isinstance(error, InvalidDataError)
            failure = BadPacket(f"it cannot be written: {error.strerror}") if is_refused else error
        except Exception as error:
            failure = error
        failure = self.file.failure or failure
        if failure is None:
            return
        if not (self.has_begun and isinstance(failure, BadPacket)):
            self.failure = failure
        raise failure

    def _order(self, packet: Packet[Stream]) -> None:
        """Moves the decoding time above the last, and the presentation time not below it, and to 0 or more.

        Reordered frames begin with decoding times below 0, which MP4 with negative offsets holds; moved, they
        would shorten it.
        """
        before_first = MIN_TICKS if self._format.takes_negative_times else -1
        lowest = self._last_dts.get(packet.stream_index, before_first) + 1
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
