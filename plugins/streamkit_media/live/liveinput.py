"""What a live connection reads from, and how it fails."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence

from av.container import InputContainer
from av.packet import Packet
from av.stream import Stream

from streamkit import StreamError, mask_secrets
from streamkit_media.container import TimedOut


class ConnectionLost(StreamError):
    """The other side has ended the connection amid the stream, or has begun another stream."""


class Silence(TimedOut):
    """The server has stopped sending."""


def silence(location: str, timeout_s: float) -> Silence:
    """The error for a server that sends nothing."""
    return Silence(
        f"{mask_secrets(location)}: the server has been silent for {timeout_s:g} s (timeout-s); "
        "check that it plays elsewhere, or allow more time"
    )


class LiveInput:
    """One connection, used once and by one thread; `cut` alone is called from others.

    Args:
        location: URL of the stream.
        timeout_s: limit for opening and for each read.

    Attributes:
        where: the location as it may be shown.
        ended: set by `cut`.
    """

    def __init__(self, location: str, timeout_s: float) -> None:
        self.location, self.timeout_s = location, timeout_s
        self.where = mask_secrets(location)
        self.ended = threading.Event()

    def open(self) -> InputContainer:
        """Connects; raises `ResourceError` where that fails."""
        raise NotImplementedError

    def packets(self, container: InputContainer, streams: Sequence[Stream]) -> Iterator[Packet[Stream]]:
        """The packets of streams, the video first, until the end.

        Raises:
            StreamError: reading failed; a `ConnectionLost` says for itself what to do.
            TimedOut: nothing has come for the time limit.
        """
        raise NotImplementedError

    def cut(self) -> None:
        """Ends calls under way; may be called again and again until `close`."""
        self.ended.set()

    def close(self) -> None:
        """Releases what `open` has acquired apart from the container; called in any case."""
        raise NotImplementedError
