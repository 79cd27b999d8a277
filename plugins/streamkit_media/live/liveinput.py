"""What a live connection reads from, and how it fails."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

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


class LiveInput(Protocol):
    """One connection, used once and by one thread; `cut` alone is called from others.

    Attributes:
        location: URL of the stream, for errors.
        timeout_s: limit for opening and for each read.
    """

    location: str
    timeout_s: float

    def open(self) -> InputContainer:
        """Connects; raises `ResourceError` where that fails."""

    def packets(
        self, container: InputContainer, streams: Sequence[Stream], left_s: Callable[[], float]
    ) -> Iterator[Packet[Stream]]:
        """The packets of streams, the video first, with `left_s` to wait for the next, until the end.

        Raises:
            StreamError: reading failed; a `ConnectionLost` says for itself what to do.
            TimedOut: nothing has come for the time limit.
        """

    def cut(self) -> None:
        """Ends calls under way; may be called again and again until `close`."""

    def close(self) -> None:
        """Releases what `open` has acquired apart from the container; called in any case."""
