"""Reads a network stream in a thread of its own, which can be ended at any moment."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

from av.container import InputContainer
from av.packet import Packet
from av.stream import Stream

from streamkit import Caps, Frame, ResourceError, StreamError, StreamkitError, mask_secrets
from streamkit.handoff.bounded_queue import BoundedQueue
from streamkit_media.container import TimedOut, video_stream
from streamkit_media.streams import StreamKind, stream_caps, streams_of

CUT_EVERY_S = 0.05


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


class PacketReader:
    """Opens an input and passes on each packet as it arrives, until `end` or the end of the stream.

    Args:
        source: what is read; its limits are FFmpeg's, so the caller watches the queue as well.
        kinds: streams to read; the video must be there.

    Attributes:
        found: the kinds that are there, known before the first packet is passed on.
    """

    def __init__(
        self, source: LiveInput, kinds: frozenset[StreamKind] = frozenset({StreamKind.VIDEO})
    ) -> None:
        self.location, self.timeout_s = source.location, source.timeout_s
        self.found: frozenset[StreamKind] = frozenset()
        self._source = source
        self._kinds = kinds
        self._ending = threading.Event()
        self._asked = 0.0
        # Not a daemon: it is always joined, and FFmpeg's limits bound it.
        self._thread = threading.Thread(
            target=self._run, name=f"reader {mask_secrets(source.location)}", daemon=False
        )

    def begin(
        self, queue: BoundedQueue[Frame], arrived: Callable[[Packet[Stream], Caps, StreamKind], None]
    ) -> None:
        """Starts reading.

        Args:
            queue: ended when the stream is over.
            arrived: called with each packet, its caps and its stream's kind, in the reader's thread.
        """
        self._queue, self._arrived = queue, arrived
        self._thread.start()

    def end(self, limit_s: float) -> bool:
        """Ends reading and waits; whether the thread has ended, else it does within FFmpeg's own limit."""
        self._ending.set()
        deadline = time.monotonic() + limit_s
        while self._thread.is_alive():
            self._source.cut()
            self._thread.join(min(CUT_EVERY_S, max(0.0, deadline - time.monotonic())))
            if time.monotonic() >= deadline:
                break
        return not self._thread.is_alive()

    def _run(self) -> None:
        error: Exception | None = None
        try:
            with self._source.open() as container:
                if not self._ending.is_set():
                    self._read_from(container)
        except StreamkitError as cause:
            error = cause
        except Exception as cause:  # raised by the queue in the consumer's thread
            error = ResourceError(f"{mask_secrets(self.location)}: {mask_secrets(str(cause))}")
        finally:
            self._source.close()
            self._queue.end(None if self._ending.is_set() else error)

    def _read_from(self, container: InputContainer) -> None:
        video_stream(container, self.location)
        streams = streams_of(container, self._kinds)
        carried = {stream.index: (stream_caps(stream, kind), kind) for stream, kind in streams}
        self.found = frozenset(kind for _, kind in streams)
        self._asked = time.monotonic()
        try:
            for packet in self._source.packets(container, [stream for stream, _ in streams], self._left_s):
                if self._ending.is_set():
                    return
                # At its time limit FFmpeg gives out the piece of a frame it holds, then waits as long again.
                if self._left_s() <= 0:
                    raise silence(self.location, self.timeout_s)
                self._arrived(packet, *carried[packet.stream_index])
                self._asked = time.monotonic()
        except ConnectionLost:
            raise
        except StreamError as error:
            if self._left_s() <= 0:
                raise silence(self.location, self.timeout_s) from None
            where = mask_secrets(self.location)
            raise StreamError(f"{where}: {error}; check that the server still runs") from None

    def _left_s(self) -> float:
        return self.timeout_s - (time.monotonic() - self._asked)
