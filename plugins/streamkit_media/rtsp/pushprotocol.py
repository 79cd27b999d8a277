"""Messages between a push process and the process that started it, over two pipes.

A message is its kind (one byte), the length of its content (four bytes, big-endian) and the content as
MessagePack, or nothing.
"""

from __future__ import annotations

import enum
import struct

import msgspec

HEAD = struct.Struct(">cI")


class Kind(enum.Enum):
    """Kinds of messages; the first three go to the push process, the others come from it."""

    OPEN = b"O"  # what to open, see `pusher.Push`
    PACKET = b"P"  # a `PushPacket`
    END = b"E"
    AWAKE = b"A"  # it runs, and waits for OPEN
    READY = b"R"  # the server records
    WRITTEN = b"W"  # the oldest packet that was not yet so is with the operating system
    DONE = b"D"
    FAILED = b"F"  # `reason` and `is_refused`


class PushPacket(msgspec.Struct, frozen=True, array_like=True):
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


def message(kind: Kind, content: object = None) -> bytes:
    """A message as it goes through the pipe."""
    encoded = b"" if content is None else msgspec.msgpack.encode(content)
    return HEAD.pack(kind.value, len(encoded)) + encoded


def take_messages(received: bytearray) -> list[tuple[Kind, bytes]]:
    """The complete messages, each with its encoded content; they are removed.

    Raises:
        ValueError: the bytes are no message.
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
