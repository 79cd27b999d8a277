"""One connection: its packets as frames, and the watchdog that notices when none come."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Iterator
from threading import Event

from av.packet import Packet
from av.stream import Stream

from streamkit import Caps, Capture, Clock, Frame, FrameFlags
from streamkit_media.decoding.marks import Freshness
from streamkit_media.live.packetqueue import packet_queue
from streamkit_media.live.packetreader import PacketReader, silence
from streamkit_media.live.timeline import Timeline
from streamkit_media.packets import DecodeOnly, packet_frame
from streamkit_media.streams import StreamKind

WATCHDOG_MARGIN_S = 0.3
LOOK_S = 0.5
LATE = DecodeOnly("late: a newer frame had come")
OVERRUN = "consumer too slow, older packets dropped"
MAX_WAIT_NS = 500_000_000
MAX_PAUSE_NS = 1_000_000_000
PRFT = struct.Struct("=q")


class LiveConnection:
    """Reads one connection to its end.

    Args:
        reader: not started yet.
        max_packets: most packets queued for a slow consumer.
        latency_ms: packets that wait longer, here or in the decoder, are decoded but not shown.
        first_seq: number of its first packet.
        timeline: sets the packets' times.
        clock: of the pipeline.

    Attributes:
        next_seq: number of the next packet.
        queue: packets between the reader's thread and the source's.
        reader: the thread that reads.
    """

    def __init__(
        self,
        reader: PacketReader,
        max_packets: int,
        latency_ms: int,
        first_seq: int,
        timeline: Timeline,
        clock: Clock,
    ) -> None:
        self.reader = reader
        self._timeline, self._clock = timeline, clock
        self._latency_ns = latency_ms * 1_000_000
        self._freshness = Freshness(self._latency_ns)
        self._catches_up = False
        self._shown_ns = clock.monotonic_ns()
        self.next_seq = first_seq
        self.queue = packet_queue(max_packets, max(MAX_WAIT_NS, self._latency_ns))

    def frames(
        self, is_over: Event, count_drop: Callable[[str, int], None]
    ) -> Iterator[tuple[StreamKind, Frame]]:
        """The packets as they come, until the stream ends.

        Args:
            is_over: set to stop; `queue.wake` then ends a wait at once.
            count_drop: called with the reason and number of dropped packets.

        Raises:
            ResourceError: the server refuses, is silent for the reader's time limit, or ends in an error.
        """
        queue, timeout_s = self.queue, self.reader.timeout_s
        self.reader.begin(queue, self._arrived)
        last = time.monotonic()
        flags = FrameFlags.NONE
        reported = 0
        while not is_over.is_set():
            frame = queue.get(min(LOOK_S, timeout_s), is_over)
            if (dropped := queue.statistics.dropped) > reported:
                count_drop(OVERRUN, dropped - reported)
                reported = dropped
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
            elif queue.is_over:
                return
            elif time.monotonic() - last > timeout_s + WATCHDOG_MARGIN_S:
                raise silence(self.reader.location, timeout_s)

    def _is_late(self, frame: Frame, *, has_jumped: bool) -> bool:
        """Whether newer frames go first: once one has waited too long, all but the newest are late.

        Where decoding is slower than the stream there are always newer ones: then the first frame after a
        jump to a key frame is shown, and in any case one per second.
        """
        now = self._clock.monotonic_ns()
        if not len(self.queue) or has_jumped or now - self._shown_ns > MAX_PAUSE_NS:
            self._catches_up = False
        elif now - frame.arrival_ns > self._latency_ns:
            self._catches_up = True
        if not self._catches_up:
            self._shown_ns = now
        return self._catches_up

    def _arrived(self, packet: Packet[Stream], caps: Caps, kind: StreamKind) -> None:
        """Queues a packet with its time of arrival; runs in the reader's thread."""
        now = self._clock.monotonic_ns()
        frame = packet_frame(packet, caps)
        sent = sender_time_ns(packet)
        capture = Capture(self._clock.utc_ns(), "arrival") if sent is None else Capture(sent, "rtcp")
        frame = frame.replace(
            seq=self.next_seq, arrival_ns=now, capture=capture, pts=self._timeline.place(frame.pts, now)
        )
        frame = frame.attach(self._freshness if kind is StreamKind.VIDEO else kind)
        self.next_seq += 1
        self.queue.put(frame)


def sender_time_ns(packet: Packet[Stream]) -> int | None:
    """UTC time at which the server captured a packet, ns; None before its first RTCP sender report.

    FFmpeg computes it for each packet (AVProducerReferenceTime, wall clock in us).
    """
    if not packet.has_sidedata("prft"):
        return None
    wall_us: int = PRFT.unpack_from(bytes(packet.get_sidedata("prft")))[0]
    return wall_us * 1000
