"""LinkWriter: the half of a process link in the upstream process; the connection between the two halves."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, NamedTuple

from streamkit.crossing.channel import Channel, ChannelClosed
from streamkit.crossing.shared_memory import NumberRing
from streamkit.crossing.stream_codec import StreamEncoder
from streamkit.flow.events import (
    EOS,
    CapsEvent,
    EndOfStream,
    EosEvent,
    Event,
    FlowStop,
    FlushEvent,
    Flushing,
    SegmentEvent,
)
from streamkit.flow.frame import Frame, FrameFlags

if TYPE_CHECKING:
    from streamkit.graph.processes.process_link import ProcessLink

SENT, TAKEN, FLUSHED, REFUSED, WAITING = range(5)
COUNTS = 64  # the rest is for the numbers of slots that the reader no longer uses


class Connection(NamedTuple):
    """A connection to one run of the other process.

    Attributes:
        channel: between the two processes.
        counts: of frames `SENT` by the writer, `TAKEN` by the elements behind the reader, and `FLUSHED`: of
            those sent, how many a flush drops. `REFUSED` is 1 once these elements want no more, `WAITING`
            while the writer waits for a message that a frame was taken. The memory outlives both processes.
        released: numbers of the slots that the reader no longer uses.
    """

    channel: Channel
    counts: memoryview
    released: NumberRing


class LinkWriter:
    """Sends the frames and events of one run to the reading process, in the thread of the elements upstream.

    If that process is started again, the frames on the way are lost, and the next one is a discontinuity.
    """

    def __init__(self, link: ProcessLink) -> None:
        self._link = link
        self._pad = link.pads["sink"]
        self._used: Connection | None = None
        self._has_sent_eos = self._is_refused = self._has_gap = False

    def send_event(self, event: Event) -> None:
        """Sends an event in order with the frames, but no flush: each process begins its own."""
        if isinstance(event, FlushEvent):
            return
        # Set before: a reader that connects between the sending and this would never get it.
        self._has_sent_eos = isinstance(event, EosEvent)
        link = self._link
        with link.waiting():
            while link.writes and not (self._is_refused or link.is_given_up):
                with contextlib.suppress(ChannelClosed, EndOfStream):
                    channel = self._connection().channel
                    message = self._encoder.event(event, link.query_begin_ns())
                    channel.send(message, (), link.stopping.is_set)
                    return  # it is sent, or the pipeline stops

    def reconnected(self) -> None:
        """Sends EOS to a new reader, if EOS was sent before: no thread may be left to do it."""
        if self._has_sent_eos:
            with contextlib.suppress(FlowStop):
                self.send_event(EOS)

    def put(self, frame: Frame) -> None:
        """Sends a frame; to another reader, if the first one dies meanwhile and is started again.

        Raises:
            FlowStop: the reader wants no more, or the pipeline stops.
        """
        link = self._link
        flushes = link.flushes
        with link.waiting():
            try:
                while not self._has_put(frame, flushes):
                    continue
            except Flushing:
                if link.stopping.is_set():  # a flush is counted where the frame comes from
                    link.count_drop("pipeline stopped")
                raise

    def _has_put(self, frame: Frame, flushes: int) -> bool:
        """Sends a frame to the present reader; False if that has ended meanwhile.

        `flushes` is the number of those before the frame came: a later one drops it.
        """
        with contextlib.suppress(ChannelClosed):  # `Processes` decides whether there is another
            connection = self._connection()
            self._wait_for_room(connection, flushes)
            if self._has_gap:
                frame = frame.replace(flags=frame.flags | FrameFlags.DISCONTINUITY)
            if self._send(frame, connection, flushes):
                self._has_gap = False
                return True
        return False

    def _connection(self) -> Connection:
        """The open connection; a new reader gets caps and segment first.

        Raises:
            FlowStop: there will be none, or the reader wants no more.
            ChannelClosed: the new reader has ended, too.
        """
        link, pad = self._link, self._pad
        if self._is_refused:
            raise EndOfStream(link.name)
        connection = link.connection()
        if self._used is not connection:
            self._encoder, self._has_gap = StreamEncoder(connection.released), self._used is not None
            if self._has_gap and pad.caps is not None:
                for event in (CapsEvent(pad.caps), SegmentEvent(pad.segment)):
                    message = self._encoder.event(event, link.query_begin_ns())
                    connection.channel.send(message, (), link.stopping.is_set)
        self._used = connection
        return connection

    def _wait_for_room(self, connection: Connection, flushes: int) -> None:
        """Waits while `capacity` frames are on the way.

        Raises:
            FlowStop: the reader wants no more, or the pipeline stops or flushes.
        """
        link, counts = self._link, connection.counts
        while True:
            if counts[REFUSED]:
                self._is_refused = True
                raise EndOfStream(link.name)
            if link.must_give_up(flushes):
                raise Flushing(link.name)
            if counts[SENT] - counts[TAKEN] < link.capacity:
                counts[WAITING] = 0
                return
            if counts[WAITING]:
                link.receive(connection.channel)
            counts[WAITING] = 1  # then look again: the reader may have taken a frame before it sees this

    def _send(self, frame: Frame, connection: Connection, flushes: int) -> bool:
        """Sends a frame, and counts it; False if that was cancelled."""
        is_sent = False
        with self._link.lock:  # a flush that begins now drops what is counted
            if self._link.must_give_up(flushes):
                raise Flushing(self._link.name)
            connection.counts[SENT] += 1
        try:
            is_sent = self._encoder.send_frame(frame, connection.channel, self._link.stopping.is_set)
        finally:
            if not is_sent:
                connection.counts[SENT] -= 1
        return is_sent
