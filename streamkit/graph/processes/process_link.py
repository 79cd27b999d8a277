"""ProcessLink: a link whose two ends are in different processes; a queue with one half in each."""

from __future__ import annotations

import contextlib
import dataclasses
import socket
import time
from collections.abc import Callable
from typing import Any

import msgspec
from typing_extensions import override

from streamkit.crossing.channel import Channel, ChannelClosed
from streamkit.crossing.stream_codec import LinkMessage, StreamDecoder, StreamEncoder
from streamkit.element.base import Element
from streamkit.element.pad import Pad
from streamkit.errors import StreamkitError
from streamkit.flow.caps import Caps
from streamkit.flow.events import (
    EOS,
    CapsEvent,
    DiscontinuityEvent,
    EndOfStream,
    EosEvent,
    Event,
    FlowStop,
    Flushing,
    FlushStart,
    FlushStop,
    SegmentEvent,
)
from streamkit.flow.frame import Frame, FrameFlags
from streamkit.graph.processes.connection import FLUSHED, SENT, TAKEN, Connection
from streamkit.handoff.bounded_queue import POLL_S


class ProcessLink(Element):
    """Takes frames and events in one process and sends them on in another.

    Each process has the whole graph and this element in it; only the half that is needed works. If the other
    process is started again, the frames on the way are counted as lost, and those that follow belong to a new
    epoch.

    Attributes:
        capacity: maximum number of frames on the way.
        writes, reads: which half works here.
        renumbers: whether the numbers of frames start again with a new writing process, because a source in
            it counts them; set on the reading side.
        packages: top-level packages whose metadata may arrive.
        before_end: called before EOS is sent on; waits until the messages from before it have arrived.
        last_frame: the number of the newest frame received, -1 before one; a child has it in memory that
            outlives it.
        is_given_up: whether the other process has died and is not started again.
        link_wait_ns: time that the half here waited for frames or for room, ns.
    """

    sink = src = "ANY"

    def __init__(self, name: str = "", **properties: Any) -> None:
        self.capacity = 8
        self.writes = self.reads = self.renumbers = False
        self.packages: set[str] = set()
        self.before_end: Callable[[], None] = lambda: None
        self.last_frame = memoryview(bytearray(8)).cast("q")
        self._newest: Connection | None = None  # guarded by `changed`
        self._channels: list[Channel] = []  # the newest one last; those before are shut down
        super().__init__(name, **properties)
        self.is_given_up = False
        self.begin_run()

    @override
    def query_caps(self, pad: Pad) -> Caps:
        return self.pads["sink" if pad.is_src else "src"].peer_caps()

    def latency(self) -> tuple[int, int | None]:
        """None of its own; it holds frames for an unlimited time."""
        return 0, None

    def begin_run(self) -> None:
        """Resets the state of an earlier run; the connection stays."""
        self.last_frame[0] = -1
        self.link_wait_ns = 0
        self._used: Connection | None = None
        # Of the writing half.
        self._encoder = StreamEncoder()
        self._has_sent_eos = self._is_refused = self._has_gap = False
        # Of the reading half.
        self._is_first_of_epoch = False
        self._epoch_offset = self._number_offset = self._highest_epoch = 0
        self._highest_number = -1

    # The connection.

    def connect(self, end: socket.socket, counts: memoryview) -> None:
        """Uses a new connection, the first one or one to a process that was started again."""
        with self.changed:
            for unused in self._channels[:-1]:  # shut down at the connection before this one
                unused.close()
            del self._channels[:-1]
            for old in self._channels:
                old.shut_down()
            self._newest = Connection(Channel(end), counts)
            self._channels.append(self._newest.channel)
            self.changed.notify_all()
        if self._has_sent_eos:  # no thread may be left to do it
            with contextlib.suppress(FlowStop):
                self.receive_event(self.pads["sink"], EOS)

    def give_up(self) -> None:
        """The other process has died and is not started again: ends the stream on both sides."""
        with self.changed:
            self.is_given_up = True
            self.changed.notify_all()

    def disconnect(self) -> None:
        """Closes the connection and unmaps its memory; only once no thread uses it."""
        with self.changed:
            channels, self._channels, self._newest = self._channels, [], None
        self._has_sent_eos = self.is_given_up = False
        self._encoder = StreamEncoder()
        for channel in channels:
            channel.close()

    def _connection(self) -> Connection:
        """Waits for a connection that is open.

        Raises:
            FlowStop: there will be none.
        """
        with self.changed:
            self.wait_for(
                lambda: self.is_given_up or not (self._newest is None or self._newest.channel.is_closed)
            )
            if self.is_given_up:
                raise EndOfStream(self.name)
            assert self._newest is not None
            return self._newest

    def _receive(self, channel: Channel, wait_s: float) -> list[bytes]:
        """Receives messages; the wait for them is counted."""
        began_ns = time.perf_counter_ns()
        try:
            return channel.receive(wait_s)
        finally:
            self.link_wait_ns += time.perf_counter_ns() - began_ns

    # The writing half, in the upstream thread.

    @override
    def receiver(self, pad: Pad) -> Callable[[Frame], None]:
        return self._put

    def receive_event(self, pad: Pad, event: Event) -> None:
        """Sends an event in order with the frames, but no flush: each process begins its own."""
        # Set before: a reader that connects between the sending and this would never get it.
        self._has_sent_eos = isinstance(event, EosEvent)
        if isinstance(event, FlushStart | FlushStop):
            return
        with self.waiting():
            while self.writes and not (self._is_refused or self.is_given_up):
                with contextlib.suppress(ChannelClosed, EndOfStream):
                    channel = self._reader_connection().channel
                    channel.send(self._encoder.event(event), (), self.stopping.is_set)
                    return  # it is sent, or the pipeline stops

    def _put(self, frame: Frame) -> None:
        """Sends a frame; to another reader, if the first one dies meanwhile and is started again.

        Raises:
            FlowStop: the reader wants no more, or the pipeline stops.
        """
        with self.waiting():
            while True:
                with contextlib.suppress(ChannelClosed):  # `Processes` decides whether there is another
                    connection = self._reader_connection()
                    self._wait_for_room(connection)
                    if self._has_gap:
                        frame = frame.replace(flags=frame.flags | FrameFlags.DISCONTINUITY)
                    if self._send(frame, connection):
                        self._has_gap = False
                        return

    def _reader_connection(self) -> Connection:
        """The open connection; a new reader gets caps and segment first.

        Raises:
            FlowStop: there will be none, or the reader wants no more.
            ChannelClosed: the new reader has ended, too.
        """
        if self._is_refused:
            raise EndOfStream(self.name)
        connection = self._connection()
        if self._used is not None and self._used is not connection:
            self._encoder, self._has_gap = StreamEncoder(), True
            sink = self.pads["sink"]
            for event in (CapsEvent(sink.caps), SegmentEvent(sink.segment)) if sink.caps is not None else ():
                connection.channel.send(self._encoder.event(event), (), self.stopping.is_set)
        self._used = connection
        return connection

    def _wait_for_room(self, connection: Connection) -> None:
        """Reads what the reader has taken; waits while `capacity` frames are on the way."""
        wait_s = 0.0
        while True:
            for message in self._receive(connection.channel, wait_s):
                kind, released, is_over = msgspec.msgpack.decode(message)
                if kind != LinkMessage.DONE:
                    raise ValueError("the reading process has sent something unreadable")
                for number in released:
                    self._encoder.slots.release(number)
                if is_over:
                    self._is_refused = True
                    raise EndOfStream(self.name)
            if self.stopping.is_set() or self.is_flushing:
                raise Flushing(self.name)
            if connection.counts[SENT] - connection.counts[TAKEN] < self.capacity:
                return
            wait_s = POLL_S

    def _send(self, frame: Frame, connection: Connection) -> bool:
        """Sends a frame, and counts it; False if that was cancelled."""
        is_sent = False
        connection.counts[SENT] += 1
        try:
            is_sent = self._encoder.send_frame(frame, connection.channel, self.stopping.is_set)
        finally:
            if not is_sent:
                connection.counts[SENT] -= 1
        return is_sent

    # The reading half, in a thread of its own.

    def stream(self) -> None:
        """Body of the reading thread: sends frames and events on, in order, until EOS."""
        while self.reads:
            try:
                self.wait_while_flushing()
                connection = self._connection()
                if self._used is not None:
                    self._begin_epoch()
                self._used = connection
                self._forward(connection)
                break
            except EndOfStream:
                break
            except ChannelClosed:
                pass  # `Processes` decides whether there is another
            except Flushing:
                if self.stopping.is_set():
                    raise
        if self.reads:
            self.send_eos()

    def flush(self, *, begins: bool) -> None:
        """Begins or ends a flush, which drops what is on the way."""
        with self.lock:
            super().flush(begins=begins)
            if self.writes and self._newest is not None:
                self._newest.counts[FLUSHED] = self._newest.counts[SENT]

    def _begin_epoch(self) -> None:
        """Those of a new writer belong to a new epoch."""
        self._epoch_offset = self._highest_epoch + 1
        self._number_offset = self._highest_number + 1 if self.renumbers else 0
        self._is_first_of_epoch = True
        event = DiscontinuityEvent(self._epoch_offset, "the process upstream was started again")
        self.pads["src"].send_event(event)

    def _forward(self, connection: Connection) -> None:
        """Sends on what comes through a connection, until EOS."""
        decoder = StreamDecoder(self.packages)
        while True:
            if self.stopping.is_set():
                raise Flushing(self.name)
            for message in self._receive(connection.channel, POLL_S):
                item = decoder.decode(message, connection.channel)
                if isinstance(item, EosEvent):
                    self.before_end()
                    return
                try:
                    if isinstance(item, Frame):
                        self._push(item, decoder, connection)
                    elif item is not None:
                        self._send_on(item)
                except Flushing:
                    if self.stopping.is_set():
                        raise
                    if isinstance(item, Frame):
                        self.count_drop("flushed")
                item = None  # else its slot would be in use until the next one

    def _send_on(self, event: Event) -> None:
        if isinstance(event, DiscontinuityEvent):
            event = dataclasses.replace(event, epoch=event.epoch + self._epoch_offset)
        self.pads["src"].send_event(event)

    def _push(self, frame: Frame, decoder: StreamDecoder, connection: Connection) -> None:
        src = self.pads["src"]
        frame = src.announce_caps(self._continued(frame))
        is_over = False
        try:
            self.wait_while_flushing()
            if connection.counts[TAKEN] < connection.counts[FLUSHED]:
                raise Flushing(self.name)
            src.push(frame)
        except Flushing:
            raise
        except (FlowStop, StreamkitError):
            is_over = True
            raise
        finally:
            del frame  # its slot may be free now
            connection.counts[TAKEN] += 1
            with contextlib.suppress(ChannelClosed):
                connection.channel.send(decoder.done(is_over=is_over), (), self.stopping.is_set)

    def _continued(self, frame: Frame) -> Frame:
        """The frame with the epoch and number that follow those from before a restart."""
        self.last_frame[0] = frame.seq
        epoch, seq = frame.epoch + self._epoch_offset, frame.seq + self._number_offset
        self._highest_epoch = max(self._highest_epoch, epoch)
        self._highest_number = max(self._highest_number, seq)
        if self._epoch_offset:
            flags = frame.flags | FrameFlags.DISCONTINUITY if self._is_first_of_epoch else frame.flags
            self._is_first_of_epoch = False
            frame = frame.replace(epoch=epoch, seq=seq, flags=flags)
        return frame
