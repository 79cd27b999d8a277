"""Numbers and times of a live stream's packets, over all its connections."""

from __future__ import annotations

import struct
from bisect import insort

from av.packet import Packet
from av.stream import Stream
from av.video.stream import VideoStream

from streamkit import Caps, Capture, Clock, Frame
from streamkit_media.streams import packet_frame

LEAP_NS = 10_000_000_000  # the server's clock was set, or its counter restarted
STEP_NS = 1_000_000  # at least, from one connection to the next
REORDERED = 4  # frames at most that come before one and are shown after it
STANDSTILL = 10  # frames of one time in a row; fields of a frame and parts of one are fewer
PRFT = struct.Struct("=q")


class Timeline:
    """Maps the server's times to those of the stream, which ascend over all connections.

    Within a connection frames keep the server's distances; between two connections they are as far apart as
    they arrived. A packet that more than `REORDERED` others of higher times came before shows that the
    server's clock was set back. Decoding times do not: they are estimates, and go back where the first
    B-frame comes.
    """

    def __init__(self) -> None:
        self._first_arrival_ns: int | None = None  # of the stream; its time 0
        self._offset_ns: int | None = None  # added to the server's times; None until a packet has come
        self._highest_ns = -STEP_NS  # time of the stream so far
        self._last_pts = self._last_arrival_ns = 0
        self._was_timed = False  # whether the last packet had a time
        self._latest: list[int] = []  # the highest of the server's times since its clock was set, ascending
        self._reordered_ns = 0  # by how much times step back within an order of coding

    def begin_connection(self) -> None:
        """The server's times restart."""
        self._offset_ns = None

    def timestamp(self, pts: int | None, arrival_ns: int) -> int:
        """The time of a packet in the stream.

        Args:
            pts: the server's time, ns. Where it is None, the packet follows one with a time closely, as what
                is left of a frame does; packets of a stream without times are as far apart as they arrive.
            arrival_ns: monotonic clock, ns.

        Returns:
            ns since the first packet arrived; higher than all of the connections before.
        """
        if self._first_arrival_ns is None:
            self._first_arrival_ns = arrival_ns
        elapsed_ns = arrival_ns - self._last_arrival_ns
        was_timed, self._was_timed = self._was_timed, pts is not None
        if pts is None:
            step_ns = STEP_NS if was_timed else elapsed_ns
            pts = 0 if self._offset_ns is None else self._last_pts + step_ns
        step_ns, arrived_ns = pts - self._last_pts, arrival_ns - self._first_arrival_ns
        leaps = abs(step_ns) > LEAP_NS and abs(step_ns - elapsed_ns) > LEAP_NS
        is_set_back = len(self._latest) > REORDERED and pts < self._latest[0]
        if self._offset_ns is None or leaps or is_set_back:
            self._offset_ns = max(arrived_ns, self._highest_ns + STEP_NS + self._reordered_ns) - pts
            self._latest.clear()
        insort(self._latest, pts)
        del self._latest[: -REORDERED - 1]
        self._reordered_ns = max(self._reordered_ns, self._latest[-1] - pts)
        self._last_pts, self._last_arrival_ns = pts, arrival_ns
        self._highest_ns = max(self._highest_ns, pts + self._offset_ns)
        return pts + self._offset_ns


class PacketStamps:
    """Numbers packets as they arrive, and gives them their times.

    Attributes:
        clock: of the pipeline.
        timeline: of the stream.
        next_seq: number of the next packet.
        repeats: frames of video in a row with the time of the one before.
    """

    def __init__(self, clock: Clock) -> None:
        self.clock, self.timeline, self.next_seq, self.repeats = clock, Timeline(), 0, 0
        self._video_pts: int | None = None

    @property
    def stand_still(self) -> bool:
        """Whether the server gives all frames one time; those of arrival then take its place."""
        return self.repeats >= STANDSTILL

    def stamped(self, packet: Packet[Stream], caps: Caps) -> Frame:
        """A packet that arrives now, as a frame."""
        now_ns, sent_ns = self.clock.monotonic_ns(), sender_time_ns(packet)
        capture = Capture(self.clock.utc_ns(), "arrival") if sent_ns is None else Capture(sent_ns, "rtcp")
        frame = packet_frame(packet, caps)
        if isinstance(packet.stream, VideoStream):
            self.repeats = self.repeats + 1 if frame.pts is not None and frame.pts == self._video_pts else 0
            self._video_pts = frame.pts
        pts = self.timeline.timestamp(None if self.stand_still else frame.pts, now_ns)
        seq = self.next_seq
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
