"""The push process: sends packets from its standard input to an RTSP server with FFmpeg.

PyAV holds the interpreter's lock while FFmpeg speaks to the server, and a server that is silent then stops
every thread of the process; so this is a process of its own, which can be killed at any moment.
"""

from __future__ import annotations

import enum
import os
import signal
import struct
import sys
from fractions import Fraction
from typing import Any, BinaryIO

import av
import msgspec
from av.container import OutputContainer
from av.error import FFmpegError, HTTPForbiddenError, HTTPUnauthorizedError
from av.packet import Packet
from av.stream import Stream

TIME_BASE = Fraction(1, 90_000)
SECOND_NS = 1_000_000_000
FAILURES = (FFmpegError, OSError, ValueError, RuntimeError, LookupError)
HEAD = struct.Struct(">cI")


class PushMessage(enum.Enum):
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


def message(kind: PushMessage, content: object = None) -> bytes:
    """A message as it goes through the pipe."""
    encoded = b"" if content is None else msgspec.msgpack.encode(content)
    return HEAD.pack(kind.value, len(encoded)) + encoded


def take_messages(received: bytearray) -> list[tuple[PushMessage, bytes]]:
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
        found.append((PushMessage(kind), bytes(received[at + HEAD.size : end])))
        at = end
    del received[:at]
    return found


class Push:
    """One connection to a server that records.

    Args:
        order: `url`, `options` of FFmpeg, `codec` (FFmpeg's name), `width`, `height` (px).

    Raises:
        FFmpegError: the server cannot be reached, or does not want it.
    """

    def __init__(self, order: dict[str, Any]) -> None:
        self._container: OutputContainer = av.open(
            order["url"], "w", format="rtsp", container_options=order["options"]
        )
        self._stream: Stream = self._container.add_mux_stream(
            order["codec"], width=order["width"], height=order["height"], time_base=TIME_BASE
        )
        self._container.start_encoding()

    def write(self, sent: PushPacket) -> None:
        """Sends one packet.

        Raises:
            FFmpegError: the connection has ended.
        """
        packet = Packet(sent.data)
        packet.stream = self._stream
        packet.time_base = TIME_BASE
        packet.pts, packet.dts = _ticks(sent.pts), _ticks(sent.dts)
        if sent.duration:
            packet.duration = _ticks(sent.duration)
        packet.is_keyframe = sent.is_keyframe
        self._container.mux_one(packet)

    def close(self) -> None:
        """Ends the recording."""
        self._container.close()


def run(commands: BinaryIO, answers: BinaryIO) -> None:
    """Executes commands until END or the end of the input."""
    push: Push | None = None
    limit_s = 0.0
    decoder = msgspec.msgpack.Decoder(PushPacket)

    def answer(kind: PushMessage) -> None:
        answers.write(message(kind))
        answers.flush()

    answer(PushMessage.AWAKE)
    while head := commands.read(HEAD.size):
        name, length = HEAD.unpack(head)
        content = commands.read(length)
        kind = PushMessage(name)
        if kind is PushMessage.OPEN:
            order = msgspec.msgpack.decode(content)
            limit_s = order["timeout_s"]
        # A server that is silent for longer ends this process, whether FFmpeg returns or not.
        signal.setitimer(signal.ITIMER_REAL, limit_s)
        if kind is PushMessage.OPEN:
            push = Push(order)
            answer(PushMessage.READY)
        elif kind is PushMessage.PACKET and push is not None:
            push.write(decoder.decode(content))
            answer(PushMessage.WRITTEN)
        elif kind is PushMessage.END:
            break
        signal.setitimer(signal.ITIMER_REAL, 0)
    signal.setitimer(signal.ITIMER_REAL, limit_s)
    if push is not None:
        push.close()
    answer(PushMessage.DONE)


def main() -> None:
    """Runs on the standard streams; a failure is the last answer."""
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    try:
        run(sys.stdin.buffer, sys.stdout.buffer)
    except BrokenPipeError:
        pass
    except FAILURES as error:
        report = {
            "reason": getattr(error, "strerror", None) or type(error).__name__,
            "is_refused": isinstance(error, HTTPUnauthorizedError | HTTPForbiddenError),
        }
        os.write(sys.stdout.fileno(), message(PushMessage.FAILED, report))
    # Closing a connection that has failed would wait for the server again.
    os._exit(0)


def _ticks(ns: int) -> int:
    return round(ns * TIME_BASE.denominator / SECOND_NS)


if __name__ == "__main__":
    main()
