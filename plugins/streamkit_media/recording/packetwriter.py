"""Coded packets to a file, without encoding."""

from __future__ import annotations

from av.error import FFmpegError, InvalidDataError
from av.packet import Packet
from av.stream import Stream

from streamkit.output.file import OutputFile
from streamkit_media.nalunits import AnnexBConverter, BadPacket
from streamkit_media.recording.filemuxer import (
    FORMATS,
    FRAGMENT_TICKS,
    MAX_TICKS,
    TIME_BASE,
    FileMuxer,
    ticks,
)
from streamkit_media.recording.parametersets import check_parameter_sets

WITH_KLV = WITHOUT_HEADERS = frozenset({"mpegts"})


class PacketWriter(FileMuxer):
    """One file being written.

    Args:
        file: of a name in `FORMATS`; is closed by `close`.
        codec: of the video, FFmpeg's name.
        size: width, height, px.
        extradata: the codec's headers kept outside the packets.
        with_klv: whether there is a stream of KLV telemetry too.

    Attributes:
        has_begun: whether the file's head is written; a packet may be left out from then on.

    Raises:
        ValueError: the container cannot hold this codec.
        BadPacket: the extradata are damaged.
    """

    def __init__(
        self, file: OutputFile, codec: str, size: tuple[int, int], extradata: bytes, *, with_klv: bool = False
    ) -> None:
        self._annexb = AnnexBConverter(codec, extradata)
        self._codec = codec
        self.has_begun = False
        self._reads_parameter_sets = FORMATS[file.path.suffix.lower()][0] not in WITHOUT_HEADERS
        self._last_dts: dict[int, int] = {}
        self._is_after_pause = False
        super().__init__(file)
        try:
            self._video = self.container.add_mux_stream(codec, width=size[0], height=size[1])
            self._klv: Stream | None = self.container.add_data_stream("klv") if with_klv else None
        except BaseException:
            self.close()
            raise

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
            ValueError: the container cannot hold so long a pause before the packet.
            BadPacket: the packet is damaged; nothing can be written after it unless the file `has_begun`.
        """
        data = self._annexb.packet(data, is_keyframe)
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

    def _write(self, packet: Packet[Stream], stream: Stream, pts: int, dts: int, duration: int) -> int:
        lowest = self._last_dts.get(stream.index, dts - 1) + 1
        dts = max(dts, lowest)
        try:
            self.check_pause(dts - lowest)
        except ValueError as error:
            if self._is_after_pause:
                raise
            # One packet after too long a pause is taken for damaged; the second shows the stream's own pause.
            self._is_after_pause = True
            raise BadPacket(str(error)) from None
        self._is_after_pause = False
        packet.stream = stream
        try:
            packet.time_base, packet.dts, packet.pts = TIME_BASE, dts, max(pts, dts)
            packet.duration = min(duration, MAX_TICKS)
        except OverflowError:
            raise BadPacket(f"its time of {max(pts, dts) / TIME_BASE.denominator:.3g} s is none") from None
        self._last_dts[stream.index] = dts
        try:
            self.mux(packet, can_play=pts >= FRAGMENT_TICKS)
        except FFmpegError as error:
            if not self.has_begun and not isinstance(error, InvalidDataError):
                raise
            refusal = BadPacket(f"it cannot be written: {error.strerror}")
            self.failure = None if self.has_begun else refusal
            raise refusal from None
        self.has_begun = True
        return packet.size

    def close(self) -> None:
        """Completes the file, or removes it where nothing could be written. Safe to call twice.

        Raises:
            OSError: writing failed.
        """
        self.finish(is_kept=self.has_begun)
