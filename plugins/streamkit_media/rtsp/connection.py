"""One connection's life: its packets as frames, and the watchdog that notices when none come."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from av.packet import Packet
from av.stream import Stream

from streamkit import Caps, Capture, Frame, FrameFlags
from streamkit_media.decoding.freshness import Freshness
from streamkit_media.packets import DecodeOnly, packet_frame
from streamkit_media.rtsp.packetreader import PacketReader, silence
from streamkit_media.rtsp.packetring import PacketRing
from streamkit_media.rtsp.timeline import Timeline
from streamkit_media.streams import StreamKind

WATCHDOG_MARGIN_S = 0.3
LOOK_S = 0.5
LATE = DecodeOnly("late: a newer frame had come")
OVERRUN = "consumer too slow, older packets dropped"
LONGEST_WAIT_S = 0.5
LONGEST_DARK_NS = 1_000_000_000
PRFT = struct.Struct("=q")


class Moments(Protocol):
    """The pipeline's clock."""

    def monotonic_ns(self) -> int:
        """Nanoseconds of a clock that never goes back."""

    def utc_ns(self) -> int:
        """Nanoseconds since 1970-01-01 UTC."""


@dataclass(frozen=True)
class ConnectionSettings:
    """How to connect, and how long to wait.

    Attributes:
        location: URL of the stream.
        options: FFmpeg options for it.
        timeout_s: silence that ends a connection.
        latency_ms: what waits longer for a slow consumer, or in the decoder, is decoded but not shown.
        max_packets: held at most for a slow consumer.
        kinds: streams to read.
    """

    location: str = field(repr=False)  # it may hold a password
    options: Mapping[str, str]
    timeout_s: float
    latency_ms: int
    max_packets: int
    kinds: frozenset[StreamKind]


class Connection:
    """Reads one connection to its end.

    Args:
        settings: how to connect.
        first_seq: number of its first packet.
        timeline: gives the packets their times.
        clock: of the pipeline.

    Attributes:
        next_seq: number of the packet that comes next.
        ring: what has come and waits.
        reader: the thread that reads.
    """

    def __init__(
        self, settings: ConnectionSettings, first_seq: int, timeline: Timeline, clock: Moments
    ) -> None:
        self._settings = settings
        self._timeline, self._clock = timeline, clock
        self._latency_ns = settings.latency_ms * 1_000_000
        self._freshness = Freshness(self._latency_ns)
        self._catches_up = False
        self._shown_ns = clock.monotonic_ns()
        self.next_seq = first_seq
        longest_wait_s = max(LONGEST_WAIT_S, settings.latency_ms / 1000)
        self.ring = PacketRing[Frame](settings.max_packets, longest_wait_s)
        self.reader = PacketReader(
            settings.location, settings.options, settings.timeout_s, self.ring, self._arrived, settings.kinds
        )

    def frames(
        self, is_over: Callable[[], bool], count_drop: Callable[[str, int], None]
    ) -> Iterator[tuple[StreamKind, Frame]]:
        """The packets as they come, until the stream ends.

        Args:
            is_over: whether nobody wants more.
            count_drop: told of packets lost here.

        Raises:
            ResourceError: the server refuses, is silent for `timeout_s`, or ends in an error.
        """
        ring = self.ring
        self.reader.begin()
        last = time.monotonic()
        flags = FrameFlags.NONE
        while not is_over():
            frame = ring.take(min(LOOK_S, self._settings.timeout_s))
            if dropped := ring.take_dropped():
                count_drop(OVERRUN, dropped)
                flags = FrameFlags.DISCONTINUITY
            if frame is not None:
                kind = frame.get(StreamKind) or StreamKind.VIDEO
                if kind is StreamKind.VIDEO and self._is_late(frame, has_jumped=bool(flags)):
                    frame = frame.attach(LATE)
                if kind is StreamKind.VIDEO and flags:
                    frame, flags = frame.replace(flags=frame.flags | flags), FrameFlags.NONE
                yield kind, frame
                # The consumer's own time is not the server's silence.
                last = time.monotonic()
            elif ring.is_over:
                return
            elif time.monotonic() - last > self._settings.timeout_s + WATCHDOG_MARGIN_S:
                raise silence(self._settings.location, self._settings.timeout_s)

    def _is_late(self, frame: Frame, *, has_jumped: bool) -> bool:
        """Whether newer ones go first: once one has waited too long, all but the newest are.

        Where decoding is slower than the stream there always are newer ones: then what comes first after a
        jump to a key frame is shown, and one in a second in any case.
        """
        now = self._clock.monotonic_ns()
        if not len(self.ring) or has_jumped or now - self._shown_ns > LONGEST_DARK_NS:
            self._catches_up = False
        elif now - frame.arrival_ns > self._latency_ns:
            self._catches_up = True
        if not self._catches_up:
            self._shown_ns = now
        return self._catches_up

    def _arrived(self, packet: Packet[Stream], caps: Caps, kind: StreamKind) -> None:
        """In the reader's thread: notes when a packet came and lines it up."""
        now = self._clock.monotonic_ns()
        frame = packet_frame(packet, caps)
        sent = sender_time_ns(packet)
        capture = Capture(self._clock.utc_ns(), "arrival") if sent is None else Capture(sent, "rtcp")
        frame = frame.replace(
            seq=self.next_seq, arrival_ns=now, capture=capture, pts=self._timeline.place(frame.pts, now)
        )
        frame = frame.attach(self._freshness if kind is StreamKind.VIDEO else kind)
        self.next_seq += 1
        self.ring.put(frame, packet.is_keyframe and kind is StreamKind.VIDEO, now / 1e9)


def sender_time_ns(packet: Packet[Stream]) -> int | None:
    """When the server says it captured a packet, UTC ns; None before its first RTCP sender report.

    FFmpeg works it out for each packet (AVProducerReferenceTime, wall clock in us).
    """
    if not packet.has_sidedata("prft"):
        return None
    wall_us: int = PRFT.unpack_from(bytes(packet.get_sidedata("prft")))[0]
    return wall_us * 1000
