"""Connection: what a process link uses to reach one run of the other process."""

from __future__ import annotations

from typing import NamedTuple

from streamkit.crossing.channel import Channel
from streamkit.crossing.shared_memory import NumberRing

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
