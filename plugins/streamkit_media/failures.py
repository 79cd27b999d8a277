"""How opening, reading and pushing media fail: each error says where, what happened and what to do."""

from __future__ import annotations

import errno
import os
from typing import BinaryIO

from av.error import (
    FFmpegError,
    HTTPForbiddenError,
    HTTPOtherClientError,
    HTTPServerError,
    HTTPUnauthorizedError,
    InvalidDataError,
    ProtocolNotFoundError,
)

from streamkit import ResourceError, StreamError, mask_secrets
from streamkit.errors import did_you_mean
from streamkit.output.names import is_network, local_path

PROTOCOLS = ("rtsp", "rtsps", "udp", "tcp", "rtmp", "http", "https", "file")
FIRST_BOX, INDEX_BOX, MOST_BOXES = b"ftyp", b"moov", 1000
# Every way in which PyAV reports media it cannot use; FFmpegError is no OSError.
MEDIA_ERRORS = (FFmpegError, ValueError, OverflowError, RuntimeError, LookupError)


class AccessRefused(ResourceError):
    """The server wants valid credentials; a retry does not help."""


class UnsupportedTransport(ResourceError):
    """The server does not send over the transport asked for."""


class TimedOut(ResourceError):
    """The server did not answer, or not completely, within the limit."""


class Silence(TimedOut):
    """The server has stopped sending."""


class ConnectionLost(StreamError):
    """The other side has ended the connection amid the stream, or has begun another stream."""


class UnsupportedMedia(ResourceError):
    """What the server sends cannot be received in its form; a retry does not help."""


class InvalidMedia(ResourceError):
    """The server sends something that FFmpeg cannot identify."""


def access_refused(where: str, reason: str) -> AccessRefused:
    """The error for a server that refuses the credentials, with its reason."""
    return AccessRefused(
        f"{where}: the server asks for valid credentials: {reason}; "
        "set user-id= and user-pw=, or write both in the location"
    )


def silence(where: str, timeout_s: float, remedy: str = "check that it plays elsewhere") -> Silence:
    """The error for a server that sends nothing."""
    return Silence(
        f"{mask_secrets(where)}: the server has been silent for {timeout_s:g} s (timeout-s); "
        f"{remedy}, or allow more time"
    )


def open_failure(location: str, error: Exception, limit_s: float | None) -> ResourceError:
    """The error to raise for what PyAV raised on opening: where, what, remedy; never a password.

    `limit_s` is the time limit where it has passed.
    """
    where = mask_secrets(location)
    if isinstance(error, HTTPUnauthorizedError | HTTPForbiddenError):
        return access_refused(where, reason_of(error))
    if getattr(error, "errno", None) == errno.EPROTONOSUPPORT and is_network(location):
        return UnsupportedTransport(f"{where}: the server does not send over the transport asked for")
    if isinstance(error, ProtocolNotFoundError):
        return ResourceError(f"{where}: no such protocol; {protocol_remedy(where.partition('://')[0])}")
    if limit_s is not None:
        return TimedOut(
            f"{where}: no video within {limit_s:g} s: the other side is silent or does not answer in full; "
            "check that it plays elsewhere, or allow more time"
        )
    if is_network(location):
        kind = InvalidMedia if isinstance(error, InvalidDataError) else ResourceError
        check = "address, port and path"
        if isinstance(error, HTTPServerError):
            check = "the log of the server"
        elif isinstance(error, HTTPOtherClientError):
            # The answer to a client that asks for none of the streams.
            check += ", and that it has video, not sound alone"
        return kind(f"{where}: cannot be opened: {reason_of(error)}; check {check}")
    return StreamError(f"{where}: no media that FFmpeg can read: {reason_of(error)}{fault_of_file(location)}")


def protocol_remedy(scheme: str) -> str:
    """What to write in place of a protocol that FFmpeg does not have here."""
    if scheme == "srt":
        return "livesrc receives SRT; write livesrc uri=srt://HOST:PORT"
    return did_you_mean(scheme, PROTOCOLS) or f"write one of {', '.join(PROTOCOLS)}"


def reason_of(error: Exception) -> str:
    """FFmpeg's error text without file names, which may hold passwords."""
    text = getattr(error, "strerror", None)
    return text if isinstance(text, str) and text else mask_secrets(str(error)) or type(error).__name__


def fault_of_file(location: str) -> str:
    """What is wrong with a file, as far as its bytes tell, and what to do; continues a sentence."""
    check = "; check that it is a whole video file"
    try:
        with local_path(location).open("rb") as file:
            head = file.read(256)
            if head[4:8] == FIRST_BOX and INDEX_BOX not in boxes(file):
                return (
                    "; its index (the moov box) is missing, as where a recording was cut off; a program "
                    "such as untrunc can restore it, with a whole file of the same camera"
                )
    except OSError:
        return check
    if not head.strip(b"\0"):
        return f" (it begins with zeros){check}"
    if all(byte >= 32 or byte in b"\t\r\n\f" for byte in head):
        return f" (it begins with text: {head[:24].decode('latin-1')!r}){check}"
    return check


def boxes(file: BinaryIO) -> list[bytes]:
    """The types of the first boxes of an MP4 or MOV file, in their order.

    Source: ISO/IEC 14496-12, 4.2 (size and type of a box; size 1: 64 bits follow; size 0: up to the end).
    """
    found, at, end = list[bytes](), 0, file.seek(0, os.SEEK_END)
    while at < end and len(found) < MOST_BOXES:
        file.seek(at)
        header = file.read(16)
        found.append(header[4:8])
        size = int.from_bytes(header[:4], "big")
        size = int.from_bytes(header[8:], "big") if size == 1 else size
        if size < 8:
            break
        at += size
    return found
