"""rtspsrc: live video from a camera, drone or server."""

from __future__ import annotations

import enum
import time
from collections.abc import Iterator
from typing import Any

from typing_extensions import override

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
from streamkit_media.codecs import CODED_CAPS
from streamkit_media.container import AccessRefused, TimedOut, UnsupportedTransport
from streamkit_media.rtsp.connection import Connection, Timeline
from streamkit_media.rtsp.endpoint import Reconnect, RtspEndpoint
from streamkit_media.rtsp.packetreader import ClosedByServer, PacketReader, Silence
from streamkit_media.streams import KLV_CAPS, StreamKind

STOP_LIMIT_S = 1.8
LEAVE_LIMIT_S = 0.5
KINDS = frozenset({StreamKind.VIDEO, StreamKind.KLV})
# Most readers that are still in a call of FFmpeg; each ends at its own time limit.
ABANDONED_LIMIT = 8
# FFmpeg would otherwise read up to five seconds to guess the frame rate.
UDP_SHARE = 0.5  # of the time limit, where tcp can follow
WAIT_SHARE = 0.5  # of the time limit: a wait for a packet out of order is not to be taken for silence
LIVE_OPTIONS = {"analyzeduration": "1500000", "fpsprobesize": "0"}


SourceTransport = enum.StrEnum("SourceTransport", "TCP UDP AUTO")


class RtspSrc(RtspEndpoint, Source):
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

    transport: SourceTransport = Property(
        SourceTransport.TCP,
        doc="What carries the video: tcp loses nothing, udp waits for nothing; auto is udp, or tcp where no "
        "video has come within half of timeout-s.",
    )
    latency_ms: int = Property(
        100,
        name="latency",
        min=0,
        max=60_000,
        unit="ms",
        doc="Longest wait for packets out of order (udp), and for slow consumers before newer ones go first.",
    )
    max_packets: int = Property(
        256, min=2, doc="Packets queued for a slow consumer before the oldest are dropped."
    )
    low_latency: bool = Property(
        True, doc="Over TCP, take a frame's end from RTP; off, FFmpeg's parser adds one frame of delay."
    )

    def __init__(self, name: str = "", **properties: Any) -> None:
        self._connection: Connection | None = None
        super().__init__(name, **properties)

    def start(self) -> None:
        """Checks the location; the connection is made by the source's thread."""
        self._abandoned: list[PacketReader] = []
        self._received = 0
        self._next_seq = 0
        self._epoch = -1
        self._timeline = Timeline()
        self._carrier = SourceTransport.UDP if self.transport is SourceTransport.AUTO else self.transport
        super().start()

    @property
    def received(self) -> int:
        """Packets received since the start; each is delivered, or counted in `drops` here or downstream."""
        connection = self._connection
        return self._received + (connection.queue.statistics.received if connection is not None else 0)

    def negotiate(self, allowed: Caps) -> Caps | None:
        """None: the server chooses."""
        return None

    def frames(self) -> Iterator[Frame | tuple[str, Frame]]:
        """The packets as they come, over one connection after another.

        Raises:
            ResourceError: a connection failed and is not, or no longer, to be tried again.
        """
        while not self.over.is_set():
            before = self._received
            self._post_state("connecting", attempt=self._backoff.tries, transport=self._carrier.value)
            try:
                yield from self._one_connection()
                failure = None
            except ResourceError as error:
                failure = error
            finally:
                self._disconnect(LEAVE_LIMIT_S)
            if self.over.is_set():
                return
            if failure is not None and self._received == before:
                if self._falls_back_to_tcp(failure):
                    continue
                failure = self._with_remedy(failure)
            if not self._tries_again(failure):
                return

    @override
    def interrupt(self) -> None:
        connection = self._connection
        if connection is not None:
            connection.queue.wake()

    @override
    def stop(self) -> None:
        deadline = time.monotonic() + STOP_LIMIT_S
        self._disconnect(STOP_LIMIT_S)
        ended = [reader.end(max(0.0, deadline - time.monotonic())) for reader in self._abandoned]
        if not all(ended):
            self.post_warning(
                f"FFmpeg has not closed {self._where} within {STOP_LIMIT_S:g} s; "
                f"it will within {self.timeout_s:g} s"
            )

    # One connection.

    def _one_connection(self) -> Iterator[Frame | tuple[str, Frame]]:
        """Its packets; the first makes it a new epoch."""
        self._timeline.begin_connection()
        connection = self._connection = Connection(
            self._new_reader(), self.max_packets, self.latency_ms, self._next_seq, self._timeline, self.clock
        )
        is_first = True
        for kind, frame in connection.frames(self.over, self.count_drop):
            if is_first:
                self._epoch += 1
                self._backoff.reset()
                self._add_pads(connection.reader.found)
                self._post_state("connected", epoch=self._epoch, caps=str(frame.caps))
            flags = frame.flags | (FrameFlags.DISCONTINUITY if is_first and self._epoch else 0)
            is_first = False
            own = frame.replace(epoch=self._epoch, flags=flags)
            if kind is StreamKind.VIDEO:
                yield own
            elif kind.value in self.pads:
                yield kind.value, own
        if is_first and not self.over.is_set():
            raise StreamError(f"{self._where}: the server ended before the first packet")

    def _add_pads(self, found: frozenset[StreamKind]) -> None:
        """Adds pads for the streams other than the video."""
        for kind in sorted(found - {StreamKind.VIDEO}):
            if kind.value not in self.pads:
                self.add_pad(kind.value)
        if self._epoch == 0:
            if "klv" in self.pads and StreamKind.KLV not in found:
                self.post_warning(f"{self._where}: it sends no stream for the pad klv")
            self.no_more_pads()

    def _new_reader(self) -> PacketReader:
        may_fall_back = self.transport is SourceTransport.AUTO and self._carrier is SourceTransport.UDP
        limit_s = self.timeout_s * UDP_SHARE if may_fall_back else self.timeout_s
        options = {
            **LIVE_OPTIONS,
            **self._tls_options,
            "rtsp_transport": self._carrier.value,
            "timeout": str(round(limit_s * 1e6)),
            "max_delay": str(min(self.latency_ms * 1000, round(limit_s * WAIT_SHARE * 1e6))),
            "allowed_media_types": "video+data",
        }
        return PacketReader(self._url, options, limit_s, KINDS, low_latency=self.low_latency)

    def _disconnect(self, limit_s: float) -> None:
        """Ends the connection; a reader in a call of FFmpeg ends at its own limit."""
        connection, self._connection = self._connection, None
        if connection is None:
            return
        ended = connection.reader.end(limit_s)
        self._received += connection.queue.statistics.received
        if left := len(connection.queue):
            self.count_drop("the connection was left", left)
        self._next_seq = connection.next_seq
        self._abandoned = [reader for reader in self._abandoned if not reader.end(0)]
        if not ended:
            self._abandoned.append(connection.reader)
        if len(self._abandoned) > ABANDONED_LIMIT:
            raise ResourceError(
                f"{self._where}: FFmpeg does not close {ABANDONED_LIMIT} connections that have "
                "ended; check the name server and the network"
            )

    # Between two connections.

    def _falls_back_to_tcp(self, failure: ResourceError) -> bool:
        """Whether `auto`, having received nothing over UDP, continues over TCP at once."""
        if self.transport is not SourceTransport.AUTO:
            return False
        if self._carrier is SourceTransport.TCP:
            if self._epoch < 0:  # neither has worked: the next try begins with UDP again
                self._carrier = SourceTransport.UDP
            return False
        if not isinstance(failure, TimedOut | UnsupportedTransport):
            return False
        self._carrier = SourceTransport.TCP
        self.post_warning(f"{self._where}: nothing came over UDP; going on over TCP")
        return True

    def _with_remedy(self, failure: ResourceError) -> ResourceError:
        """The failure of a connection that brought nothing; over UDP, with what may help."""
        if self._carrier is SourceTransport.UDP and isinstance(failure, TimedOut | UnsupportedTransport):
            return type(failure)(f"{failure}; if it does over TCP, set transport=tcp or transport=auto")
        return failure

    def _tries_again(self, failure: ResourceError | None) -> bool:
        """Waits before the next try; False where the stream has ended regularly.

        Raises:
            ResourceError: it is not to be tried again.
        """
        if isinstance(failure, Silence):
            self._post_state("stalled", reason=str(failure))
        ends = self.reconnect is Reconnect.NEVER
        if failure is None or (ends and isinstance(failure, ClosedByServer)):
            if ends or self.reconnect is Reconnect.ON_ERROR:
                self.post_warning(f"{self._where}: the server has ended the stream")
                return False
        elif (
            ends or isinstance(failure, AccessRefused) or self._has_tried_enough(has_worked=self._epoch >= 0)
        ):
            self._give_up(failure)
        reason = str(failure) if failure is not None else f"{self._where}: the stream has ended"
        self.over.wait(self._delay_before_retry(reason))
        return True
