"""LinkCounts: the frames on their way through one connection, in memory that outlives both processes."""

from __future__ import annotations

from typing import NamedTuple

from streamkit.crossing.channel import Channel
from streamkit.crossing.shared_memory import make_memory, map_memory

SIZE = 16


class LinkCounts:
    """Counts of one connection of a link; its two processes and the main process share them.

    If they die, the main process still knows how many frames were sent and not taken.

    Args:
        descriptor: of the memory; the caller closes it.
    """

    def __init__(self, descriptor: int) -> None:
        memory = memoryview(map_memory(descriptor, SIZE, writable=True)).cast("B")
        self._sent, self._taken = memory[:8].cast("q"), memory[8:].cast("q")

    @classmethod
    def make(cls) -> tuple[LinkCounts, int]:
        """New counts, and the descriptor to be sent to the processes and then closed."""
        descriptor = make_memory("streamkit-counts", SIZE)
        return cls(descriptor), descriptor

    def count_sent(self, frames: int = 1) -> None:
        """Counts frames that are sent; only the writing process calls it, before it sends them."""
        self._sent[0] += frames

    def count_taken(self) -> None:
        """Counts a frame that the elements downstream have taken; only the reading process calls it."""
        self._taken[0] += 1

    @property
    def on_the_way(self) -> int:
        """Frames sent and not taken."""
        return self._sent[0] - self._taken[0]


class LinkConnection(NamedTuple):
    """A connection to one run of the other process, and the counts of the frames that pass through it."""

    channel: Channel
    counts: LinkCounts
