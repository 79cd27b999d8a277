"""Reads a network stream in a thread of its own, which can be ended at any moment."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from urllib.parse import urlsplit

from av.container import InputContainer
from av.packet import Packet
from av.stream import Stream
from av.video.stream import VideoStream

from streamkit import Caps, Frame, ResourceError, StreamError, StreamkitError, mask_secrets
from streamkit.handoff.bounded_queue import BoundedQueue
from streamkit_media.codecs import stream_rate
from streamkit_media.container import (
    AccessRefused,
    InvalidMedia,
    TimedOut,
    open_container,
    video_stream,
)
from streamkit_media.packets import read_packets
from streamkit_media.rtsp.low_latency.completeframes import UNPARSED, can_be_joined, complete_frames
from streamkit_media.rtsp.reachability import port_of, unreachable
from streamkit_media.rtsp.sockets import CLAIMS, cut_connections, is_closed_by_peer, open_sockets
from streamkit_media.streams import StreamKind, stream_caps, streams_of

CUT_EVERY_S = 0.05
PLAIN = "rtsp"
NO_OPTIONS: Mapping[str, str] = {}


class PacketReader:
    """Opens a URL and passes on each packet as it arrives, until `end` or the end of the stream.

    Args:
        location: URL of the stream.
        options: FFmpeg options for it.
        timeout_s: limit for opening and for each read; FFmpeg's, so the caller watches the queue as well.
        kinds: streams to read; the video must be there.
        low_latency: read the ends of frames from RTP where possible, see `rtsp.low_latency`.

    Attributes:
        found: the kinds that are there, known before the first packet is passed on.
    """

    def __init__(
        self,
        location: str,
        options: Mapping[str, str],
        timeout_s: float,
        kinds: frozenset[StreamKind] = frozenset({StreamKind.VIDEO}),
        *,
        low_latency: bool = True,
    ) -> None:
        self.location = location
        self.timeout_s = timeout_s
        self.found: frozenset[StreamKind] = frozenset()
        self._options = options
        self._kinds = kinds
        self._low_latency = low_latency
        self._ending = threading.Event()
        self._asked = 0.0
        self._known = frozenset(open_sockets())
        # Not a daemon: it is always joined, and FFmpeg's limits bound it.
        self._thread = threading.Thread(
            target=self._run, name=f"reader {mask_secrets(location)}", daemon=False
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
            cut_connections(port_of(self.location), self._known | CLAIMS.of_others(self))
            self._thread.join(min(CUT_EVERY_S, max(0.0, deadline - time.monotonic())))
            if time.monotonic() >= deadline:
                break
        return not self._thread.is_alive()

    def _run(self) -> None:
        error: Exception | None = None
        try:
            self._read()
        except StreamkitError as cause:
            error = cause
        except Exception as cause:  # raised by the queue in the consumer's thread
            error = ResourceError(f"{mask_secrets(self.location)}: {mask_secrets(str(cause))}")
        finally:
            CLAIMS.release(self)
            self._queue.end(None if self._ending.is_set() else error)

    def _read(self) -> None:
        # RTP packets can be peeked at on a TCP connection without TLS only.
        is_plain = urlsplit(self.location).scheme == PLAIN and self._options.get("rtsp_transport") == "tcp"
        if self._low_latency and is_plain:
            # Only FFmpeg's parsers find parameter sets that the server does not send in advance.
            with suppress(InvalidMedia), self._opened(UNPARSED) as container:
                if self._ending.is_set():
                    return
                if can_be_joined(video_stream(container, self.location)):
                    self._read_from(container, in_pieces=True)
                    return
        with self._opened() as container:
            if not self._ending.is_set():
                self._read_from(container)

    def _read_from(self, container: InputContainer, *, in_pieces: bool = False) -> None:
        sockets = CLAIMS.claim(self, port_of(self.location), self._known)
        video = video_stream(container, self.location)
        streams = streams_of(container, self._kinds)
        carried = {stream.index: (stream_caps(stream, kind), kind) for stream, kind in streams}
        self.found = frozenset(kind for _, kind in streams)
        self._asked = time.monotonic()
        packets = read_packets(container, *(stream for stream, _ in streams))
        if in_pieces:
            packets = complete_frames(packets, video, frame_duration(video), sockets, self._left_s)
        where = mask_secrets(self.location)
        try:
            for packet in packets:
                if self._ending.is_set():
                    return
                # At its time limit FFmpeg gives out the piece of a frame it holds, then waits as long again.
                if self._left_s() <= 0:
                    raise silence(self.location, self.timeout_s)
                self._arrived(packet, *carried[packet.stream_index])
                self._asked = time.monotonic()
        except StreamError as error:
            if self._left_s() <= 0:
                raise silence(self.location, self.timeout_s) from None
            raise StreamError(f"{where}: {error}; check that the server still runs") from None
        if is_closed_by_peer(sockets):
            raise ClosedByServer(f"{where}: the server has closed the connection; check that it still runs")

    def _left_s(self) -> float:
        return self.timeout_s - (time.monotonic() - self._asked)

    def _opened(self, more: Mapping[str, str] = NO_OPTIONS) -> InputContainer:
        began = time.monotonic()
        try:
            options = {**self._options, **more}
            return open_container(self.location, options, (self.timeout_s, self.timeout_s))
        except AccessRefused:
            raise
        except ResourceError as error:
            if more and isinstance(error, InvalidMedia):
                raise
            left_s = self.timeout_s - (time.monotonic() - began)
            if left_s <= 0 or self._ending.is_set():
                raise
            # FFmpeg often does not say why.
            reason = unreachable(self.location, self._options.get("ca_file"), left_s, "check the address")
            raise ResourceError(f"{mask_secrets(self.location)}: {reason}") if reason else error from None


def frame_duration(video: VideoStream) -> int:
    """Duration of a frame in the stream's time base; 0 if unknown."""
    rate, base = stream_rate(video), video.time_base
    return round(1 / (rate * base)) if rate and base else 0


class ClosedByServer(StreamError):
    """The server has closed the connection amid the stream."""


class Silence(TimedOut):
    """The server has stopped sending."""


def silence(location: str, timeout_s: float) -> Silence:
    """The error for a server that sends nothing."""
    return Silence(
        f"{mask_secrets(location)}: the server has been silent for {timeout_s:g} s (timeout-s); "
        "check that it plays elsewhere, or allow more time"
    )
