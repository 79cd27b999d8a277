"""ProcessLink: a link whose two ends are in different processes; a queue with one half in each."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from typing import Any

from typing_extensions import override

from streamkit.crossing.channel import Channel
from streamkit.crossing.shared_memory import NumberRing
from streamkit.element.base import Element
from streamkit.element.pad import Pad
from streamkit.flow.caps import Caps
from streamkit.flow.events import EndOfStream, Event
from streamkit.flow.frame import Frame
from streamkit.graph.processes.link_reader import LinkReader
from streamkit.graph.processes.link_writer import FLUSHED, SENT, TAKEN, WAITING, Connection, LinkWriter

LOST = "lost with the process that had them"


class ProcessLink(Element):
    """Takes frames and events in one process and sends them on in another.

    Each process has the whole graph and this element in it, with a `LinkWriter` and a `LinkReader`, of which
    one works at most. If the other process is started again, there is a new connection to it.

    Attributes:
        capacity: maximum number of frames on the way.
        writes, reads: which half works here.
        renumbers: whether the numbers of frames start again with a new writing process, because a source in
            it counts them; set on the reading side.
        packages: top-level packages whose metadata may arrive.
        before_end: called before EOS is sent on; waits until the messages from before it have arrived.
        last_frame: the number of the newest frame received, -1 before one; a child has it in memory that
            outlives it.
        begin_ns: what `query_begin_ns` returns in the writing process, as it came with the caps, ns.
        is_given_up: whether the other process has died and is not started again.
        link_wait_ns: time that the half here waited for frames or for room, ns.
        counts: in the main process, of each connection of this run, the newest last; see `Connection`.
    """

    sink = src = "ANY"

    def __init__(self, name: str = "", **properties: Any) -> None:
        self.capacity = 8
        self.writes = self.reads = self.renumbers = self.is_given_up = False
        self.packages: set[str] = set()
        self.before_end: Callable[[], None] = lambda: None
        self.last_frame = memoryview(bytearray(8)).cast("q")
        self.counts: list[memoryview] = []
        self._newest: Connection | None = None  # guarded by `changed`
        self._channels: list[Channel] = []  # the newest one last; those before are shut down
        super().__init__(name, **properties)

    def begin_run(self) -> None:
        """Resets the state of an earlier run; the connection stays."""
        super().begin_run()
        self.last_frame[0] = -1
        self.link_wait_ns = self.begin_ns = 0
        self._writer, self._reader = LinkWriter(self), LinkReader(self)

    @override
    def query_caps(self, pad: Pad) -> Caps:
        return self.pads["sink" if pad.is_src else "src"].peer_caps()

    def query_begin_ns(self) -> int:
        """The begin of the source, as its process has sent it."""
        return self.begin_ns if self.reads else super().query_begin_ns()

    def latency(self) -> tuple[int, int | None]:
        """Adds no latency, and can hold frames for an unlimited time."""
        return 0, None

    # Frames and events.

    @override
    def receiver(self, pad: Pad) -> Callable[[Frame], None]:
        return self._put

    def _put(self, frame: Frame) -> None:
        self._writer.put(frame)  # of the current run

    def receive_event(self, pad: Pad, event: Event) -> None:
        """Sends an event to the other process."""
        self._writer.send_event(event)

    def stream(self) -> None:
        """Body of the reading thread: sends frames and events on, in order, until EOS."""
        if self.reads:
            self._reader.run()
            self.pads["src"].send_eos()

    def flush(self, *, begins: bool) -> None:
        """Begins or ends a flush, which drops what is on the way."""
        with self.lock:
            super().flush(begins=begins)
            if self.writes and self._newest is not None:
                self._newest.counts[FLUSHED] = self._newest.counts[SENT]

    @override
    def await_frame_in_flight(self) -> None:
        if self.reads:
            self._reader.await_push()

    # The connection.

    def connect(self, end: socket.socket, counts: memoryview) -> None:
        """Uses a new connection, the first one or one to a process that was started again."""
        with self.changed:
            for unused in self._channels[:-1]:  # shut down at the connection before this one
                unused.close()
            del self._channels[:-1]
            for old in self._channels:
                old.shut_down()
            self._newest = Connection(Channel(end), counts, NumberRing(counts[WAITING + 1 :]))
            self._channels.append(self._newest.channel)
            self.changed.notify_all()
        self._writer.reconnected()

    def give_up(self) -> None:
        """The other process has died and is not started again: ends the stream on both sides."""
        with self.changed:
            self.is_given_up = True
            self.changed.notify_all()

    def disconnect(self) -> None:
        """Closes the connection, unmaps its memory, and counts what was on the way; after the last thread."""
        with self.changed:
            channels, self._channels, self._newest = self._channels, [], None
        self.count_drop(LOST, self.lost())
        if self.counts:
            self.count_drop("pipeline stopped", self.counts[-1][SENT] - self.counts[-1][TAKEN])
        self.counts = []
        self.is_given_up = False
        self._writer = LinkWriter(self)
        for channel in channels:
            channel.close()

    def lost(self) -> int:
        """Number of frames that were on the way through connections that have been replaced."""
        return sum(counts[SENT] - counts[TAKEN] for counts in self.counts[:-1])

    def connection(self) -> Connection:
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

    def receive(self, channel: Channel) -> list[bytes]:
        """Receives messages; the wait for them is counted."""
        began_ns = time.perf_counter_ns()
        try:
            return channel.receive()
        finally:
            self.link_wait_ns += time.perf_counter_ns() - began_ns
