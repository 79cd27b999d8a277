"""Connection: what a process link uses to reach one run of the other process."""

from __future__ import annotations

from typing import NamedTuple

from streamkit.crossing.channel import Channel

SENT, TAKEN, FLUSHED, REFUSED = range(4)
COUNTS = 4


class Connection(NamedTuple):
    """A connection to one run of the other process.

    Attributes:
        channel: between the two processes.
        counts: of frames `SENT` by the writer, `TAKEN` by the elements behind the reader, and `FLUSHED`: of
            those sent, how many a flush drops. `REFUSED` is 1 once these elements want no more. The memory
            outlives both processes.
    """

    channel: Channel
    counts: memoryview
