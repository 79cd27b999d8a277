"""ProcessLink: a link whose two ends are in different processes; a queue with one half in each."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from typing import Any

from typing_extensions import override

from streamkit.crossing.channel import Channel
from streamkit.crossing.link_counts import LinkConnection, LinkCounts
from streamkit.element.base import Element
from streamkit.element.pad import Pad
from streamkit.flow.caps import Caps
from streamkit.flow.events import EOS, EndOfStream, Event
from streamkit.flow.frame import Frame
from streamkit.graph.processes.link_reader import LinkReader
from streamkit.graph.processes.link_writer import LinkWriter


class ProcessLink(Element):
    """Takes frames and events in one process and sends them on in another.

    Each process has the whole graph and this element in it; only the half that is needed works: `LinkWriter`
    in the upstream process, `LinkReader` in the other. If one of them is started again, the frames on the way
    are counted as lost, and those that follow belong to a new epoch.

    Attributes:
        capacity: maximum number of frames on the way.
        writes, reads: which half works here.
        renumbers: whether the numbers of frames start again with a new writing process, because a source in
            it counts them; set on the reading side.
        packages: top-level packages whose metadata may arrive.
        before_end: called before EOS is sent on; waits until the messages from before it have arrived.
        last_frame: the number of the newest frame received, -1 before one; a child has it in memory that
            outlives it.
        waited_ns: time that the half here waited for frames or for room, ns.
    """

    sink = src = "ANY"

    def __init__(self, name: str = "", **properties: Any) -> None:
        self.capacity = 8
        self.writes = self.reads = self.renumbers = False
        self.packages: set[str] = set()
        self.before_end: Callable[[], None] = lambda: None
        self.last_frame = memoryview(bytearray(8)).cast("q")
        self.waited_ns = 0
        self._newest: LinkConnection | None = None  # guarded by `changed`
        self._channels: list[Channel] = []  # all that may be open
        self._is_given_up = False
        self._writer, self._reader = LinkWriter(self), LinkReader(self)
        super().__init__(name, **properties)

    @override
    def query_caps(self, pad: Pad) -> Caps:
        return self.pads["sink" if pad.is_src else "src"].peer_caps()

    def latency(self) -> tuple[int, int | None]:
        """None of its own; it holds frames for an unlimited time."""
        return 0, None

    def begin_run(self) -> None:
        """Resets the state of an earlier run; the connection stays."""
        self._is_given_up = False
        self._writer.reset()
        self._reader.reset()
        self.last_frame[0] = -1
        self.waited_ns = 0

    def receive(self, channel: Channel, wait_s: float) -> list[bytes]:
        """Receives messages; the wait for them is counted."""
        began_ns = time.perf_counter_ns()
        try:
            return channel.receive(wait_s)
        finally:
            self.waited_ns += time.perf_counter_ns() - began_ns

    def connect(self, end: socket.socket, counts: LinkCounts) -> None:
        """Uses a new connection, the first one or one to a process that was started again."""
        with self.changed:
            for old in self._channels:
                old.shut_down()
            self._newest = LinkConnection(Channel(end), counts)
            self._channels.append(self._newest.channel)
            self.changed.notify_all()
        if self._writer.has_sent_eos:  # no thread is left to do it
            self.receive_event(self.pads["sink"], EOS)

    def give_up(self) -> None:
        """The other process has died and is not started again: ends the stream on both sides."""
        with self.changed:
            self._is_given_up = True
            self.changed.notify_all()

    def disconnect(self) -> None:
        """Closes the connection; only once no thread uses it."""
        with self.changed:
            channels, self._channels, self._newest = self._channels, [], None
        self._writer.disconnected()
        for channel in channels:
            channel.close()

    def interrupt(self) -> None:
        """Ends the waits of both halves if the pipeline stops."""
        self.wake()

    @override
    def receiver(self, pad: Pad) -> Callable[[Frame], None]:
        return self._writer.put

    def receive_event(self, pad: Pad, event: Event) -> None:
        """Sends an event in order with the frames."""
        if self.writes:
            self._writer.put_event(event)

    def stream(self) -> None:
        """Body of the reading thread: sends frames and events on, in order, until EOS."""
        if self.reads:
            self._reader.run()

    def open_connection(self) -> LinkConnection:
        """Waits for a connection that is open.

        Raises:
            FlowStop: there will be none.
        """
        with self.changed:
            self.wait_for(
                lambda: self._is_given_up or not (self._newest is None or self._newest.channel.is_closed)
            )
            if self._is_given_up:
                raise EndOfStream(self.name)
            assert self._newest is not None
            return self._newest
