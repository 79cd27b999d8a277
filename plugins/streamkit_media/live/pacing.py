"""Passes on in real time what arrives in bursts, as the segments of a playlist do."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from threading import Event

from av.packet import Packet
from av.stream import Stream

MAX_WAIT_S = 1.0  # a longer step of the decoding times is a jump


def paced(
    packets: Iterator[Packet[Stream]], ended: Event, now_s: Callable[[], float] = time.monotonic
) -> Iterator[Packet[Stream]]:
    """The packets, each when its decoding time has come.

    A packet that comes too late moves the times of all after it, so that they do not follow in a burst.

    Args:
        packets: of all streams, in the order of the container.
        ended: set to end a wait, and the packets.
        now_s: monotonic clock, s.
    """
    offset_s: float | None = None
    for packet in packets:
        if packet.dts is not None and packet.time_base:
            decoding_s, now = float(packet.dts * packet.time_base), now_s()
            if offset_s is None or not 0 <= decoding_s + offset_s - now <= MAX_WAIT_S:
                offset_s = now - decoding_s
            elif ended.wait(decoding_s + offset_s - now):
                return
        yield packet
