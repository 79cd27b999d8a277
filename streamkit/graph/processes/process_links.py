"""ProcessLinks: what connects the processes of one pipeline, as the main process sees it."""

from __future__ import annotations

import functools
import os
import threading
from collections.abc import Callable, Iterable, Mapping

from streamkit.crossing.channel import Channel
from streamkit.crossing.shared_memory import make_numbers
from streamkit.graph.bins import Bin
from streamkit.graph.graph import Graph
from streamkit.graph.processes.connection import COUNTS
from streamkit.graph.processes.part import Part
from streamkit.graph.processes.process_link import ProcessLink


class ProcessLinks:
    """Connects the two ends of every link, and again where a process is started again.

    Args:
        graph: the whole graph.
        parts: its processes; none in a child.
    """

    def __init__(self, graph: Graph, parts: Mapping[Bin, Part]) -> None:
        self._ends = graph.process_links
        self._numbers = {link: number for number, link in enumerate(self._ends)}
        self._parts = parts
        self._connecting = threading.Lock()

    def connect(self, await_messages: Callable[[Iterable[Part]], None]) -> None:
        """Connects all links of the processes that have just been started.

        Args:
            await_messages: waits until what some processes have posted has arrived; called before an EOS of
                theirs is sent on.
        """
        for link, (writer, _) in self._ends.items():
            self._connect(link)
            if writer is not None:
                link.before_end = functools.partial(await_messages, [self._parts[writer]])

    def _connect(self, link: ProcessLink) -> None:
        """Gives the two ends of a new connection to the processes that a link connects.

        One that has died gets none: its restart makes another connection.
        """
        counts, descriptor = make_numbers(COUNTS)
        with self._connecting:  # both ends get the connections of two restarts in the same order
            link.counts.append(counts)
            for home, end in zip(self._ends[link], Channel.pair(), strict=True):
                if home is None:
                    link.connect(end, counts)
                    continue
                with end:
                    descriptors = end.fileno(), descriptor
                    self._parts[home].order("connect", self._numbers[link], descriptors=descriptors)
        os.close(descriptor)

    def reconnect(self, part: Part) -> None:
        """Connects a process that was started again, except to those that have ended for good."""
        for link in self._of(part):
            if link.is_given_up:
                part.order("give-up", self._numbers[link])
            else:
                self._connect(link)

    def give_up(self, part: Part) -> None:
        """Ends the streams from and to a process that has failed."""
        for link in self._of(part):
            link.give_up()
            for home in self._ends[link]:
                if home is not None and home is not part.home:
                    self._parts[home].order("give-up", self._numbers[link])

    def newest_frame(self) -> int:
        """Number of the newest frame that has come to this process, -1 before one."""
        return max((link.last_frame[0] for link in self._ends if link.reads), default=-1)

    def disconnect(self) -> None:
        """Closes every connection of this process, and counts the frames on the way as dropped."""
        for link in self._ends:
            link.disconnect()

    def _of(self, part: Part) -> list[ProcessLink]:
        return [link for link, ends in self._ends.items() if part.home in ends]
