"""Messages between a push process and the process that started it, over two pipes.

A message is its kind (one byte), the length of its content (four bytes, big-endian) and the content.
"""

from __future__ import annotations

import enum
import struct
from dataclasses import dataclass

HEAD = struct.Struct(">cI")
TIMES = struct.Struct(">qqq?")


class Kind(enum.Enum):
    """Kinds of messages; the first three go to the push process, the others come from it."""

    OPEN = b"O"  # JSON of what to open
    PACKET = b"P"
    END = b"E"
    AWAKE = b"A"  # it runs, and waits for OPEN
    READY = b"R"  # the server records
    WRITTEN = b"W"  # the oldest packet that was not yet so is with the operating system
    DONE = b"D"
    FAILED = b"F"  # JSON of the reason


@dataclass(frozen=True)
class PushPacket:
    """One coded packet.

    Attributes:
        pts: ns from the connection's beginning.
        dts: ns, at most `pts`; ascends.
        duration: ns; 0 if unknown.
        is_keyframe: whether decoding can begin with it.
        data: in Annex B where the codec is H.264 or H.265.
    """

    pts: int
    dts: int
    duration: int
    is_keyframe: bool
    data: bytes


def message(kind: Kind, content: bytes = b"") -> bytes:
    """A message as it goes through the pipe."""
    return HEAD.pack(kind.value, len(content)) + content


def packet_content(packet: PushPacket) -> bytes:
    """The content of a PACKET message."""
    return TIMES.pack(packet.pts, packet.dts, packet.duration, packet.is_keyframe) + packet.data


def read_packet(content: bytes) -> PushPacket:
    """The packet of a PACKET message's content."""
    pts, dts, duration, is_keyframe = TIMES.unpack_from(content)
    return PushPacket(pts, dts, duration, is_keyframe, content[TIMES.size :])


def take_messages(received: bytearray) -> list[tuple[Kind, bytes]]:
    """The messages that are there as a whole; they are removed.

    Raises:
        ValueError: what came is no message.
    """
    found, at = [], 0
    while at + HEAD.size <= len(received):
        kind, length = HEAD.unpack_from(received, at)
        end = at + HEAD.size + length
        if end > len(received):
            break
        found.append((Kind(kind), bytes(received[at + HEAD.size : end])))
        at = end
    del received[:at]
    return found
