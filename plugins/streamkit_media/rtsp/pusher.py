"""The push process: sends packets from its standard input to an RTSP server with FFmpeg.

PyAV holds the interpreter's lock while FFmpeg speaks to the server, and a server that is silent then stops
every thread of the process; so this is a process of its own, which can be killed at any moment.
"""

from __future__ import annotations

import os
import signal
import struct
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from typing import BinaryIO, TypeVar

import av
import msgspec
from av.error import FFmpegError, HTTPForbiddenError, HTTPUnauthorizedError
from av.packet import Packet

TIME_BASE = Fraction(1, 90_000)
SECOND_NS = 1_000_000_000
FAILURES = (FFmpegError, OSError, ValueError, RuntimeError, LookupError)
LENGTH = struct.Struct(">I")
Message = TypeVar("Message")


class PushOrder(msgspec.Struct, frozen=True):
    """The first message: where and what to push."""

    url: str  # of the recording
    options: dict[str, str]  # of FFmpeg
    codec: str  # FFmpeg's name
    width: int  # px
    height: int  # px
    timeout_s: float  # longest silence of the server


class PushPacket(msgspec.Struct, frozen=True):
    """One coded packet; all further messages."""

    pts: int  # ns from the connection's beginning
    dts: int  # ns, at most `pts`; ascends
    duration: int  # ns; 0 if unknown
    is_keyframe: bool  # whether decoding can begin with it
    data: bytes  # in Annex B where the codec is H.264 or H.265


class PushAnswer(msgspec.Struct, frozen=True):
    """What the push process says once it runs, after each message, and when the recording has ended."""

    failure: str = ""  # in FFmpeg's words; the process ends then. "" where all is well
    is_refused: bool = False  # whether the server wants valid credentials


def write_message(pipe: BinaryIO, content: msgspec.Struct) -> None:
    """Writes a message; raises `OSError` once the reader has gone."""
    data = msgspec.msgpack.encode(content)
    pipe.write(LENGTH.pack(len(data)) + data)
    pipe.flush()


def read_message(pipe: BinaryIO, kind: type[Message]) -> Message | None:
    """The next message; None at the end."""
    head = pipe.read(LENGTH.size)
    if len(head) < LENGTH.size:
        return None
    return msgspec.msgpack.decode(pipe.read(*LENGTH.unpack(head)), type=kind)


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Ends this process, whether FFmpeg returns or not, where the server is silent for longer."""
    signal.setitimer(signal.ITIMER_REAL, seconds)
    yield
    signal.setitimer(signal.ITIMER_REAL, 0)


def run(commands: BinaryIO, answers: BinaryIO) -> None:
    """Connects, sends packets until the end of the input, and ends the recording."""
    write_message(answers, PushAnswer())
    order = read_message(commands, PushOrder)
    if order is None:
        return
    with time_limit(order.timeout_s):
        container = av.open(order.url, "w", format="rtsp", container_options=order.options)
        stream = container.add_mux_stream(
            order.codec, width=order.width, height=order.height, time_base=TIME_BASE
        )
        container.start_encoding()
        write_message(answers, PushAnswer())
    while (sent := read_message(commands, PushPacket)) is not None:
        packet = Packet(sent.data)
        packet.stream, packet.time_base, packet.is_keyframe = stream, TIME_BASE, sent.is_keyframe
        packet.pts, packet.dts, packet.duration = (
            round(ns * TIME_BASE.denominator / SECOND_NS) for ns in (sent.pts, sent.dts, sent.duration)
        )
        with time_limit(order.timeout_s):
            container.mux_one(packet)
            write_message(answers, PushAnswer())
    with time_limit(order.timeout_s):
        container.close()
        write_message(answers, PushAnswer())


def main() -> None:
    """Runs on the standard streams; a failure is the last answer."""
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    try:
        run(sys.stdin.buffer, sys.stdout.buffer)
    except BrokenPipeError:
        pass
    except FAILURES as error:
        reason = getattr(error, "strerror", None) or type(error).__name__
        is_refused = isinstance(error, HTTPUnauthorizedError | HTTPForbiddenError)
        write_message(sys.stdout.buffer, PushAnswer(reason, is_refused))
    # Closing a connection that has failed would wait for the server again.
    os._exit(0)


if __name__ == "__main__":
    main()
