"""LinkWriter: the half of a process link that takes frames and sends them to the other process."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

import msgspec

from streamkit.crossing.channel import ChannelClosed
from streamkit.crossing.link_counts import LinkConnection
from streamkit.crossing.stream_codec import LinkMessage, StreamEncoder
from streamkit.element.base import POLL_S
from streamkit.flow.events import CapsEvent, EndOfStream, EosEvent, Event, Flushing, SegmentEvent
from streamkit.flow.frame import Frame, FrameFlags

if TYPE_CHECKING:
    from streamkit.graph.processes.process_link import ProcessLink


class LinkWriter:
    """Sends frames and events, in the upstream thread; waits while `capacity` frames are sent and not taken.

    Attributes:
        has_sent_eos: whether EOS is the last that was sent.
    """

    def __init__(self, link: ProcessLink) -> None:
        self._link = link
        self.reset()

    def reset(self) -> None:
        """Resets the state of an earlier run."""
        self.has_sent_eos = False
        self._encoder = StreamEncoder()
        self._is_refused = self._has_gap = False
        self._used: LinkConnection | None = None

    def disconnected(self) -> None:
        """The connection is closed: unmaps its shared memory."""
        self.has_sent_eos = False
        self._encoder = StreamEncoder()

    def put(self, frame: Frame) -> None:
        """Sends a frame; to another reader, if the first one dies meanwhile and is started again.

        Raises:
            FlowStop: the reader wants no more, or the pipeline stops.
        """
        with self._link.waiting():
            while True:
                try:
                    connection = self._connection()
                    self._wait_for_room(connection)
                    if self._has_gap:
                        frame = frame.replace(flags=frame.flags | FrameFlags.DISCONTINUITY)
                    if self._send(frame, connection):
                        self._has_gap = False
                        return
                except ChannelClosed:
                    continue  # `Processes` decides whether there is another

    def put_event(self, event: Event) -> None:
        """Sends an event in order with the frames."""
        with self._link.waiting():
            while not self._is_refused:
                with contextlib.suppress(ChannelClosed):
                    channel = self._connection().channel
                    if channel.send(self._encoder.event(event), (), self._link.stopping.is_set):
                        self.has_sent_eos = isinstance(event, EosEvent)
                        return

    def _connection(self) -> LinkConnection:
        """The open connection; a new reader gets caps and segment first.

        Raises:
            FlowStop: there will be none, or the reader wants no more.
            ChannelClosed: the new reader has ended, too.
        """
        if self._is_refused:
            raise EndOfStream(self._link.name)
        connection = self._link.open_connection()
        if connection is self._used:
            return connection
        if self._used is not None:
            self._used.channel.close()
            self._encoder, self._has_gap = StreamEncoder(), True
            sink = self._link.pads["sink"]
            for event in (CapsEvent(sink.caps), SegmentEvent(sink.segment)) if sink.caps is not None else ():
                connection.channel.send(self._encoder.event(event), (), self._link.stopping.is_set)
        self._used = connection
        return connection

    def _wait_for_room(self, connection: LinkConnection) -> None:
        """Reads what the reader has taken; waits while too much is on the way."""
        link, wait_s = self._link, 0.0
        while True:
            for message in link.receive(connection.channel, wait_s):
                kind, released, is_over = msgspec.msgpack.decode(message)
                if kind != LinkMessage.DONE:
                    raise ValueError("the reading process has sent something unreadable")
                for number in released:
                    self._encoder.slots.release(number)
                if is_over:
                    self._is_refused = True
                    raise EndOfStream(link.name)
            if link.stopping.is_set() or link.is_flushing:
                raise Flushing(link.name)
            if connection.counts.on_the_way < link.capacity:
                return
            wait_s = POLL_S

    def _send(self, frame: Frame, connection: LinkConnection) -> bool:
        """Sends a frame, and counts it; False if that was cancelled."""
        is_sent = False
        connection.counts.count_sent()
        try:
            is_sent = self._encoder.send_frame(frame, connection.channel, self._link.stopping.is_set)
        finally:
            if not is_sent:
                connection.counts.count_sent(-1)
        return is_sent
