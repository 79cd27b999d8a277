"""Connection: what a process link uses to reach one run of the other process."""

from __future__ import annotations

from typing import NamedTuple

from streamkit.crossing.channel import Channel

SENT, TAKEN, FLUSHED = range(3)
COUNTS = 3


class Connection(NamedTuple):
    """A connection to one run of the other process.

    Its counts of frames, `SENT` by the writer, `TAKEN` by what is downstream of the reader, and those of the
    former that a flush has dropped or will drop (`FLUSHED`), outlive both.
    """

    channel: Channel
    counts: memoryview
