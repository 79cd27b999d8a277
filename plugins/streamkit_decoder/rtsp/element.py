"""rtspsrc: live video from a camera, drone or server."""

from __future__ import annotations

import enum
import random
import time
from collections.abc import Iterator
from typing import Any
from urllib.parse import urlsplit

from streamkit import (
    Caps,
    Direction,
    Frame,
    FrameFlags,
    PadTemplate,
    Presence,
    Property,
    ResourceError,
    Source,
    StreamError,
)
from streamkit_decoder.codecs import CODED_CAPS
from streamkit_decoder.container import AccessRefused
from streamkit_decoder.location import redact, with_credentials
from streamkit_decoder.rtsp.backoff import Backoff
from streamkit_decoder.rtsp.connection import Connection, ConnectionSettings
from streamkit_decoder.rtsp.packetreader import DEFAULT_PORTS, HungUp, PacketReader, Silence, port_of
from streamkit_decoder.rtsp.timeline import Timeline
from streamkit_decoder.streams import KLV_CAPS, StreamKind

STOP_LIMIT_S = 1.8
LEAVE_LIMIT_S = 0.5
KINDS = frozenset({StreamKind.VIDEO, StreamKind.KLV})
# Readers that FFmpeg has not let go of yet; each ends at its own time limit, so few are ever there.
ABANDONED_LIMIT = 8
# A live picture is wanted now: FFmpeg would otherwise collect up to five seconds to guess the frame rate.
LIVE_OPTIONS = {"analyzeduration": "1500000", "fpsprobesize": "0"}


class Transport(enum.StrEnum):
    """What carries the video."""

    TCP = "tcp"
    UDP = "udp"


class Reconnect(enum.StrEnum):
    """When to connect again."""

    NEVER = "never"
    ON_ERROR = "on-error"
    ALWAYS = "always"


class RtspSrc(Source):
    """Receives the video of an RTSP server as coded packets; connects again when the server goes away.

    Each connection is an epoch of its own; times ascend over all of them. Live never lags: for a consumer
    that is too slow, older packets are decoded but not shown, or dropped up to a key frame, and counted.
    Every change of the connection is an element message `connection` with `state` (connecting, connected,
    stalled, retrying, gave-up), `attempt`, `delay_s` and `reason`.

    Example:
        rtspsrc location=rtsp://drone/live ! decode ! fakesink
    """

    src = CODED_CAPS
    templates = (PadTemplate("klv", Direction.SRC, Caps(KLV_CAPS), Presence.SOMETIMES),)
    is_live = True

    location: str = Property("", doc="URL, rtsp://user:password@host:port/path; passwords are never shown.")
    user_id: str = Property("", doc="User name, where the URL has none.")
    user_pw: str = Property("", secret=True, doc="Password, where the URL has none; never shown.")
    transport: Transport = Property(
        Transport.TCP, doc="What carries the video: tcp loses nothing, udp waits for nothing."
    )
    latency_ms: int = Property(
        100,
        name="latency",
        min=0,
        max=60_000,
        unit="ms",
        doc="Longest wait for packets out of order (udp), and for slow consumers before newer ones go first.",
    )
    timeout_s: float = Property(
        5.0, min=0.1, max=600.0, unit="s", doc="Silence, also while connecting, that ends a connection."
    )
    reconnect: Reconnect = Property(
        Reconnect.ON_ERROR,
        doc="Connect again never, when a connection fails, or always, that is also after a regular end.",
    )
    max_retries: int = Property(
        -1,
        min=-1,
        doc="Tries in a row before giving up. -1 is no limit for a stream that has played, and none before "
        "(a wrong address ends at once) unless reconnect=always.",
    )
    retry_delay_s: float = Property(
        0.5, min=0.0, max=600.0, unit="s", doc="Before the first retry; doubles with each, with jitter."
    )
    max_retry_delay_s: float = Property(
        10.0, min=0.0, max=3600.0, unit="s", doc="Longest wait before a retry."
    )
    max_packets: int = Property(
        256, min=2, doc="Packets held for a slow consumer before the oldest are dropped."
    )

    def start(self) -> None:
        """Checks the location; the connection is made by the source's thread."""
        self._connection: Connection | None = None
        self._abandoned: list[PacketReader] = []
        self._received = 0
        self._next_seq = 0
        self._epoch = -1
        self._timeline = Timeline()
        self._backoff = Backoff(
            self.retry_delay_s, max(self.max_retry_delay_s, self.retry_delay_s), random.Random()
        )
        parts = urlsplit(self.location)
        try:
            port_of(self.location)
        except ValueError as error:
            raise ResourceError(
                f"location={redact(self.location)}: {error}; write rtsp://host:port/path"
            ) from None
        if parts.scheme not in DEFAULT_PORTS or not parts.hostname:
            raise ResourceError(
                f"location={redact(self.location)!r} must be an RTSP URL; write location=rtsp://host:port/path"
            )

    @property
    def received(self) -> int:
        """Packets received since the start; each is delivered, or counted in `drops` here or behind."""
        connection = self._connection
        return self._received + (connection.ring.received if connection is not None else 0)

    def negotiate(self, allowed: Caps) -> Caps | None:
        """Only the server can tell."""
        return None

    def frames(self) -> Iterator[Frame | tuple[str, Frame]]:
        """The packets as they come, over one connection after another.

        Raises:
            ResourceError: a connection failed and is not, or no longer, to be tried again.
        """
        while not self.stopping.is_set():
            self._tell("connecting", attempt=self._backoff.tries)
            try:
                yield from self._one_connection()
                failure = None
            except ResourceError as error:
                failure = error
            finally:
                self._leave(LEAVE_LIMIT_S)
            if self.stopping.is_set() or not self._tries_again(failure):
                return

    def interrupt(self) -> None:
        """Wakes the source's thread."""
        connection = self._connection
        if connection is not None:
            connection.ring.wake()

    def stop(self) -> None:
        """Ends the connection and the thread that reads it."""
        deadline = time.monotonic() + STOP_LIMIT_S
        self._leave(STOP_LIMIT_S)
        ended = [reader.end(max(0.0, deadline - time.monotonic())) for reader in self._abandoned]
        if not all(ended):
            self.post_warning(
                f"FFmpeg has not let go of {redact(self.location)} within {STOP_LIMIT_S:g} s; "
                f"it will within {self.timeout_s:g} s"
            )

    def settings(self) -> dict[str, Any]:
        """The properties set in the text, the location without passwords."""
        found = super().settings()
        if "location" in found:
            found["location"] = redact(str(found["location"]))
        return found

    # One connection.

    def _one_connection(self) -> Iterator[Frame | tuple[str, Frame]]:
        """Its packets; the first makes it a new epoch."""
        self._timeline.begin_connection()
        connection = self._connection = Connection(
            self._settings(), self._next_seq, self._timeline, self.clock
        )
        is_first = True
        for kind, frame in connection.frames(self.stopping.is_set, self.count_drop):
            if is_first:
                self._epoch += 1
                self._backoff.reset()
                self._add_pads(connection.reader.found)
                self._tell("connected", epoch=self._epoch, caps=str(frame.caps))
            flags = frame.flags | (FrameFlags.DISCONTINUITY if is_first and self._epoch else 0)
            is_first = False
            own = frame.replace(epoch=self._epoch, flags=flags)
            if kind is StreamKind.VIDEO:
                yield own
            elif kind.value in self.pads:
                yield kind.value, own
        if is_first and not self.stopping.is_set():
            raise StreamError(f"{redact(self.location)}: the server ended before the first packet")

    def _add_pads(self, found: frozenset[StreamKind]) -> None:
        """Pads for what the server sends beside the video."""
        for kind in sorted(found - {StreamKind.VIDEO}):
            if kind.value not in self.pads:
                self.add_pad(kind.value)
        if self._epoch == 0:
            if "klv" in self.pads and StreamKind.KLV not in found:
                self.post_warning(f"{redact(self.location)}: it sends no stream for the pad klv")
            self.no_more_pads()

    def _settings(self) -> ConnectionSettings:
        options = {
            **LIVE_OPTIONS,
            "rtsp_transport": self.transport.value,
            "timeout": str(round(self.timeout_s * 1e6)),
            "max_delay": str(self.latency_ms * 1000),
            "allowed_media_types": "video+data",
        }
        return ConnectionSettings(
            with_credentials(self.location, self.user_id, self.user_pw),
            options,
            self.timeout_s,
            self.latency_ms,
            self.max_packets,
            KINDS,
        )

    def _leave(self, limit_s: float) -> None:
        """Ends the connection; a reader that FFmpeg holds is left behind, to end at its own limit."""
        connection, self._connection = self._connection, None
        if connection is None:
            return
        ended = connection.reader.end(limit_s)
        self._received += connection.ring.received
        if left := len(connection.ring):
            self.count_drop("the connection was left", left)
        self._next_seq = connection.next_seq
        self._abandoned = [reader for reader in self._abandoned if not reader.end(0)]
        if not ended:
            self._abandoned.append(connection.reader)
        if len(self._abandoned) > ABANDONED_LIMIT:
            raise ResourceError(
                f"{redact(self.location)}: FFmpeg does not let go of {ABANDONED_LIMIT} connections that have "
                "ended; check the name server and the network"
            )

    # Between two connections.

    def _tries_again(self, failure: ResourceError | None) -> bool:
        """Waits before the next try; False where the stream has ended regularly.

        Raises:
            ResourceError: it is not to be tried again.
        """
        if isinstance(failure, Silence):
            self._tell("stalled", reason=str(failure))
        ends = self.reconnect is Reconnect.NEVER
        if failure is None or (ends and isinstance(failure, HungUp)):
            if ends or self.reconnect is Reconnect.ON_ERROR:
                self.post_warning(f"{redact(self.location)}: the server has ended the stream")
                return False
        elif ends or isinstance(failure, AccessRefused) or self._backoff.tries >= self._most_tries():
            tries = self._backoff.tries
            self._tell("gave-up", attempt=tries, reason=str(failure))
            if tries:
                raise ResourceError(f"{failure}; gave up after {tries} retries")
            raise failure
        reason = str(failure) if failure is not None else f"{redact(self.location)}: the stream has ended"
        delay_s = self._backoff.next_delay_s()
        self._tell("retrying", attempt=self._backoff.tries, delay_s=delay_s, reason=reason)
        self.post_warning(f"{reason}; retrying ({self._backoff.tries}) in {delay_s:.1f} s")
        self.stopping.wait(delay_s)
        return True

    def _most_tries(self) -> float:
        if self.max_retries >= 0:
            return self.max_retries
        has_played = self._epoch >= 0
        return float("inf") if has_played or self.reconnect is Reconnect.ALWAYS else 0

    def _tell(self, state: str, **fields: object) -> None:
        self.post_message("connection", state=state, **fields)
