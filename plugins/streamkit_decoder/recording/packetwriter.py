"""Coded packets to a file that plays up to the last second, however the process ends."""

from __future__ import annotations

from fractions import Fraction

import av
from av.container import OutputContainer
from av.packet import Packet
from av.stream import Stream

from streamkit_decoder.recording.annexb import AnnexBWriter

TIME_BASE = Fraction(1, 90_000)
SECOND_NS = 1_000_000_000
# Without these FFmpeg keeps up to ten seconds back to interleave with a resting stream, and 32 KB to write.
ALWAYS = {"flush_packets": "1", "max_interleave_delta": "500000"}
FORMATS: dict[str, tuple[str, dict[str, str]]] = {
    ".ts": ("mpegts", {}),
    ".mts": ("mpegts", {}),
    ".m2ts": ("mpegts", {"mpegts_m2ts_mode": "1"}),
    ".mp4": ("mp4", {"movflags": "frag_keyframe+empty_moov+default_base_moof", "frag_duration": "1000000"}),
    ".mov": ("mov", {"movflags": "frag_keyframe+empty_moov+default_base_moof", "frag_duration": "1000000"}),
    ".mkv": ("matroska", {"cluster_time_limit": "1000"}),
}
WITH_KLV = frozenset({"mpegts"})


class PacketWriter:
    """One file being written.

    Args:
        target: path with `file:` before it.
        container: FFmpeg's format name and its options.
        codec: of the video, FFmpeg's name.
        size: width, height, px.
        extradata: the codec's headers kept outside the packets.
        with_klv: whether there is a stream of KLV telemetry too.

    Raises:
        FFmpegError: it cannot be written.
        ValueError: the container cannot hold this codec.
        BadPacket: the extradata are damaged.
    """

    def __init__(
        self,
        target: str,
        container: tuple[str, dict[str, str]],
        codec: str,
        size: tuple[int, int],
        extradata: bytes,
        with_klv: bool,
    ) -> None:
        self._annexb = AnnexBWriter(codec, extradata)
        self._failure: Exception | None = None
        name, options = container
        self._container: OutputContainer | None = av.open(
            target, "w", format=name, container_options={**ALWAYS, **options}
        )
        try:
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
            FFmpegError: writing failed, this time or before: a container that could not be written is left
                alone, FFmpeg crashes at the next packet where its head was not.
            BadPacket: the packet is damaged.
        """
        packet = Packet(self._annexb.packet(data, is_keyframe))
        packet.is_keyframe = is_keyframe
        if duration is not None:
            packet.duration = _ticks(duration)
        return self._write(packet, self._video, _ticks(pts), _ticks(dts))

    def write_klv(self, data: bytes, pts: int) -> int:
        """Writes one KLV packet."""
        assert self._klv is not None
        packet = Packet(data)
        packet.is_keyframe = True
        return self._write(packet, self._klv, _ticks(pts), _ticks(pts))

    def _write(self, packet: Packet[Stream], stream: Stream, pts: int, dts: int) -> int:
        assert self._container is not None
        if self._failure is not None:
            raise self._failure
        lowest = self._last_dts.get(stream.index, dts - 1) + 1
        dts = max(dts, lowest)
        self._last_dts[stream.index] = dts
        packet.stream = stream
        packet.time_base, packet.dts, packet.pts = TIME_BASE, dts, max(pts, dts)
        try:
            self._container.mux_one(packet)
        except Exception as error:
            self._failure = error
            raise
        return packet.size

    def close(self) -> None:
        """Completes the file. Safe to call twice."""
        container, self._container = self._container, None
        if container is not None:
            container.close()


def _ticks(ns: int) -> int:
    return round(ns * TIME_BASE.denominator / SECOND_NS)
