"""Packets of a container as frames, with times in exact nanoseconds."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

from av.container import InputContainer
from av.packet import Packet
from av.stream import Stream

from streamkit import SECOND_NS, Caps, Frame, FrameFlags, StreamError
from streamkit_media.container import MEDIA_ERRORS, reason_of

KEYFRAME, CORRUPT = int(FrameFlags.KEYFRAME), int(FrameFlags.CORRUPT)


@dataclass(frozen=True)
class DecodeOnly:
    """Metadata of a packet whose frame is decoded for others and not shown.

    Attributes:
        reason: for which its frame counts as dropped; "" where it is not counted.
    """

    reason: str = ""


DECODE_ONLY = DecodeOnly()


def nanoseconds(ticks: int, time_base: Fraction) -> int:
    """Ticks of a time base in ns, rounded once: the error is below half a nanosecond at any time."""
    numerator, denominator = ticks * time_base.numerator * SECOND_NS, time_base.denominator
    return (2 * numerator + denominator) // (2 * denominator)


def packet_frame(packet: Packet[Stream], caps: Caps) -> Frame:
    """A packet as a frame; its bytes are shared, not copied."""
    base = packet.time_base
    flags = KEYFRAME if packet.is_keyframe else 0
    if packet.is_corrupt:
        flags |= CORRUPT
    frame = Frame(
        packet,
        caps,
        pts=None if packet.pts is None else nanoseconds(packet.pts, base),
        duration=nanoseconds(packet.duration, base) if packet.duration else None,
        flags=flags,
    )
    return frame.attach(DECODE_ONLY) if packet.is_discard else frame


def read_packets(container: InputContainer, *streams: Stream) -> Iterator[Packet[Stream]]:
    """The streams' packets that hold data, in the order of the file.

    Raises:
        StreamError: reading failed; packets before were good.
    """
    try:
        for packet in container.demux(*streams):
            if packet.size:
                yield packet
    except MEDIA_ERRORS as error:
        raise StreamError(f"reading failed: {reason_of(error)}") from None
