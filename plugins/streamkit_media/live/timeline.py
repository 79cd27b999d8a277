"""Numbers and times of a live stream's packets, over all its connections."""

from __future__ import annotations

import struct

from av.packet import Packet
from av.stream import Stream

from streamkit import Caps, Capture, Clock, Frame
from streamkit_media.streams import nanoseconds, packet_frame

LEAP_NS = 10_000_000_000  # the server's clock was set, or its counter restarted
STEP_NS = 1_000_000
PRFT = struct.Struct("=q")


class Timeline:
    """Keeps the server's time steps within a connection, and the arrival times between two."""

    def __init__(self) -> None:
        self._zero: int | None = None
        self._offset: int | None = None
        self._highest = -STEP_NS
        self._before = (0, 0)
        self._decoded: int | None = None

    def begin_connection(self) -> None:
        """The server's times restart."""
        self._offset = self._decoded = None

    def place(self, pts: int | None, arrival_ns: int, dts: int | None = None) -> int:
        """The timestamp of a packet.

        Args:
            pts: the server's time, ns; where it is None, 0 for the first packet, by arrival for others.
            arrival_ns: monotonic clock, ns.
            dts: the server's time of decoding, ns, which goes back only where its clock was set back.

        Returns:
            ns since the first packet arrived; higher than all of the connections before.
        """
        if self._zero is None:
            self._zero = arrival_ns
        before, elapsed_ns = self._before[0], arrival_ns - self._before[1]
        if pts is None:
            pts = 0 if self._offset is None else before + elapsed_ns
        step = pts - before
        leaps = abs(step) > LEAP_NS and abs(step - elapsed_ns) > LEAP_NS
        if self._offset is None or leaps:
            self._offset = max(arrival_ns - self._zero, self._highest + STEP_NS) - pts
        elif dts is not None and self._decoded is not None and dts < self._decoded:  # was set back a little
            self._offset = max(arrival_ns - self._zero, self._decoded + self._offset + STEP_NS) - dts
        self._decoded = dts
        self._before = (pts, arrival_ns)
        self._highest = max(self._highest, pts + self._offset)
        return pts + self._offset


class PacketStamps:
    """Numbers packets as they arrive, and gives them their times.

    Attributes:
        clock: of the pipeline.
        timeline: places the packets.
        next_seq: number of the next packet.
    """

    def __init__(self, clock: Clock) -> None:
        self.clock, self.timeline, self.next_seq = clock, Timeline(), 0

    def stamped(self, packet: Packet[Stream], caps: Caps) -> Frame:
        """A packet that arrives now, as a frame."""
        now_ns, sent_ns = self.clock.monotonic_ns(), sender_time_ns(packet)
        capture = Capture(self.clock.utc_ns(), "arrival") if sent_ns is None else Capture(sent_ns, "rtcp")
        frame = packet_frame(packet, caps)
        dts = None if packet.dts is None else nanoseconds(packet.dts, packet.time_base)
        pts, seq = self.timeline.place(frame.pts, now_ns, dts), self.next_seq
        self.next_seq += 1
        return frame.replace(seq=seq, arrival_ns=now_ns, capture=capture, pts=pts)


def sender_time_ns(packet: Packet[Stream]) -> int | None:
    """UTC time at which the server captured a packet, ns; None before its first RTCP sender report.

    FFmpeg computes it for each packet (AVProducerReferenceTime, wall clock in us).
    """
    if not packet.has_sidedata("prft"):
        return None
    wall_us: int = PRFT.unpack_from(bytes(packet.get_sidedata("prft")))[0]
    return wall_us * 1000
