"""Base of sources that receive live video: one connection after another, each an epoch of its own."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator

from typing_extensions import override

from streamkit import (
    Caps,
    Direction,
    Frame,
    PadTemplate,
    Presence,
    Property,
    ResourceError,
    Source,
    StreamError,
)
from streamkit_media.codecs import CODED_CAPS
from streamkit_media.container import unread_remedy
from streamkit_media.failures import ConnectionLost
from streamkit_media.live.connection import LiveConnection
from streamkit_media.live.endpoint import Endpoint, Reconnect
from streamkit_media.live.liveinput import LiveInput
from streamkit_media.live.timeline import PacketStamps
from streamkit_media.streams import StreamKind

VIDEO_PAD = PadTemplate("video", Direction.SRC, Caps(CODED_CAPS), Presence.SOMETIMES)
STANDSTILL = "the server gives all frames one time; from here on theirs is that of arrival: speeds are rough"
STOP_LIMIT_S = 1.8
LEAVE_LIMIT_S = 0.5
# Most connections that are still in a call of FFmpeg; each ends at its own time limit.
ABANDONED_LIMIT = 8


class LiveSource(Endpoint, Source):
    """Base of live sources: override `make_input`; `templates` are the pads besides `src`.

    The pad `src` carries the video, and so does `video`, its name in `filesrc`.

    Attributes:
        unread_videos: streams of the videos that are not read, unless one is chosen.
    """

    src = CODED_CAPS
    is_live = True

    latency_ms: int = Property(
        100,
        name="latency",
        min=0,
        max=60_000,
        unit="ms",
        doc="Longest wait for packets out of order (RTSP over UDP), and for slow consumers before newer ones "
        "go first.",
    )
    max_packets: int = Property(
        256, min=2, doc="Packets queued for a slow consumer before the oldest are dropped."
    )

    video_stream: int | None = Property(
        None, min=0, doc="Number of the stream whose video is read, from 0; none is FFmpeg's best."
    )

    low_latency: bool = Property(
        True,
        doc="Take a frame's end from RTP (RTSP over TCP) or MPEG-TS (over UDP or SRT); off, FFmpeg's "
        "parser adds one frame of delay.",
    )

    _connection: LiveConnection | None = None

    def start(self) -> None:
        """Checks the location; the connection is made by the source's thread."""
        self._abandoned: list[LiveConnection] = []
        self._epoch = -1
        self.unread_videos: list[int] = []
        self._stamps = PacketStamps(self.clock)
        self._kinds = frozenset(map(StreamKind, (pad.name for pad in self.templates)))
        super().start()

    # Overridden by the kinds of live sources.

    @property
    def carrier(self) -> str:
        """The transport of the next connection, for the message `connecting`."""
        raise NotImplementedError

    def make_input(self) -> LiveInput:
        """The input of the next connection, which is not made yet."""
        raise NotImplementedError

    def explain_silence(self, failure: ResourceError) -> ResourceError | None:
        """The failure of a connection over which no packet came, with a remedy where there is one.

        None makes the source connect again at once, over another transport.
        """
        return failure

    # Called by the engine.

    @property
    def received(self) -> int:
        """Packets received since the start; each is delivered, or counted in `drops` here or downstream."""
        return self._stamps.next_seq

    def negotiate(self, allowed: Caps) -> Caps | None:
        """None: the server chooses."""
        return None

    def frames(self) -> Iterator[Frame | tuple[str, Frame]]:
        """The packets as they come, over one connection after another.

        Raises:
            ResourceError: a connection failed and is not, or no longer, to be tried again.
        """
        while not self.over.is_set():
            before, failure = self._stamps.next_seq, None
            self._post_state("connecting", attempt=self._delay.tries, transport=self.carrier)
            try:
                yield from self._one_connection()
            except ResourceError as error:
                failure = error
            finally:
                self._disconnect(LEAVE_LIMIT_S)
            if self.over.is_set():
                return
            if failure is not None and self._stamps.next_seq == before:
                failure = self.explain_silence(failure)
                if failure is None:
                    continue
            has_ended = failure is None or (
                self.reconnect is Reconnect.NEVER and isinstance(failure, ConnectionLost)
            )
            if has_ended and self.reconnect is not Reconnect.ALWAYS:
                self.post_warning(f"{self._where}: the server has ended the stream")
                return
            self.over.wait(self._retry(failure, has_worked=self._epoch >= 0))

    @override
    def interrupt(self) -> None:
        connection = self._connection
        if connection is not None:
            connection.queue.wake()

    @override
    def stop(self) -> None:
        deadline = time.monotonic() + STOP_LIMIT_S
        self._disconnect(STOP_LIMIT_S)
        ended = [left.end(max(0.0, deadline - time.monotonic())) for left in self._abandoned]
        if not all(ended):
            self.post_warning(
                f"FFmpeg has not closed {self._where} within {STOP_LIMIT_S:g} s; "
                f"it will within {self.timeout_s:g} s"
            )

    # One connection.

    def _one_connection(self) -> Iterator[Frame | tuple[str, Frame]]:
        """The packets of one connection; the first of them begins a new epoch."""
        self._stamps.timeline.begin_connection()
        source = self.make_input()
        source.video_index = self.video_stream
        connection = self._connection = LiveConnection(
            source, self._kinds, self.max_packets, self.latency_ms, self._stamps, self.count_drop
        )
        is_connected = False
        for kind, frame in connection.frames(self.over):
            if not is_connected:
                is_connected = True
                self._epoch += 1
                self._delay.reset()
                self._add_pads(connection.found)
                self.unread_videos = connection.unread_videos
                if self.unread_videos and self._epoch == 0:
                    self.post_warning(
                        f"{self._where}: one video is read, {unread_remedy(self.unread_videos)}"
                    )
                caps = connection.found[StreamKind.VIDEO]
                self._post_state("connected", epoch=self._epoch, caps=str(caps))
            if self._stamps.stand_still:
                self.warn_once(f"{self._where}: {STANDSTILL}")
            own = frame.replace(epoch=self._epoch)
            is_named = self.is_linked(kind.value)
            if is_named:
                yield kind.value, own
            if kind is StreamKind.VIDEO and (self.is_linked("src") or not is_named):
                yield own
        if not is_connected and not self.over.is_set():
            raise StreamError(f"{self._where}: the server ended before the first packet")

    def _add_pads(self, found: Collection[StreamKind]) -> None:
        """Adds pads for the streams."""
        for kind in sorted(found):
            if kind.value not in self.pads:
                self.add_pad(kind.value)
        if self._epoch == 0:
            for name in sorted(self.pads.keys() & self._kinds.difference(found)):
                self.post_warning(f"{self._where}: it sends no stream for the pad {name}")
            self.no_more_pads()

    def _disconnect(self, limit_s: float) -> None:
        """Ends the connection; one whose thread is in a call of FFmpeg ends at FFmpeg's time limit."""
        connection, self._connection = self._connection, None
        if connection is None:
            return
        ended = connection.end(limit_s)
        if left := len(connection.queue):
            self.count_drop("the connection was left", left)
        self._abandoned = [left for left in self._abandoned if not left.end(0)]
        if not ended:
            self._abandoned.append(connection)
        if len(self._abandoned) > ABANDONED_LIMIT:
            raise ResourceError(
                f"{self._where}: FFmpeg does not close {ABANDONED_LIMIT} connections that have "
                "ended; check the name server and the network"
            )
