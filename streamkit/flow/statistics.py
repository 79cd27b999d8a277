"""Statistics: counters of elements, processes and runs, as programs read them."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import msgspec

from streamkit.errors import StreamError

FILE_LIMIT_BYTES = 50_000_000


class PadStatistics(msgspec.Struct, frozen=True):
    """Counters of one pad since streaming began.

    Attributes:
        pad: name.
        direction: "sink" or "src".
        frames: number of frames.
        peer: linked element and pad, "queue0.sink", or None.
        caps: current caps, or None before negotiation.
    """

    pad: str
    direction: str
    frames: int
    peer: str | None
    caps: str | None


class QueueLevels(msgspec.Struct, frozen=True):
    """Current and maximum levels of a queue since streaming began.

    Attributes:
        buffers: queued frames.
        bytes: their size.
        time_ns: from the oldest to the newest, ns.
        max_buffers, max_bytes, max_time_ns: maximum levels.
        limit_buffers: frames that make it full; 0 is no limit.
    """

    buffers: int
    bytes: int
    time_ns: int
    max_buffers: int
    max_bytes: int
    max_time_ns: int
    limit_buffers: int


class ElementStatistics(msgspec.Struct, frozen=True):
    """Counters of one element since streaming began.

    Attributes:
        element: name.
        parent: name of the enclosing bin, or "".
        factory: element type.
        frames_in: frames over all sink pads.
        frames_out: frames over all src pads.
        dropped: frames not delivered, by reason.
        results: things made, such as tracks or files, by name.
        outcomes: frames by what the element has found of each, such as the status of its registration.
        location: the file or pattern of an element that has written files, else "".
        written: paths of the first and the last file of a sink; of one file, or none, just those.
        has_failed: whether a call of it has raised an error; the last file then lacks frames that arrived.
        errors, warnings: messages posted.
        busy_ns: working time, ns. Of a source: time to produce frames, 0 for a live one. Of a queue: time of
            upstream to push frames, including waits.
        age_ns: time since the newest frame arrived at its source, ns; None before a frame.
        queue: levels, or None for an element without a queue.
        pads: counters of each pad.
    """

    element: str
    parent: str
    factory: str
    frames_in: int
    frames_out: int
    dropped: dict[str, int]
    results: dict[str, int]
    outcomes: dict[str, int]
    location: str
    errors: int
    warnings: int
    busy_ns: int
    age_ns: int | None
    queue: QueueLevels | None
    pads: list[PadStatistics]
    written: list[str] = []
    has_failed: bool = False

    @property
    def total_dropped(self) -> int:
        """Frames not delivered, for any reason."""
        return sum(self.dropped.values())


class ProcessStatistics(msgspec.Struct, frozen=True):
    """Counters of one process since streaming began.

    Attributes:
        process: name of the bin that runs in it, or "main".
        pid: of the process.
        cpu_ns: processor time of all its threads, ns.
        rss_bytes: its resident memory now, shared memory included, bytes.
        frames: most frames that any element in it had.
        crossings: frames that came from other processes or went to them.
        waited_ns: time that its process links waited for frames, or for room in the next process, ns.
    """

    process: str
    pid: int
    cpu_ns: int
    rss_bytes: int
    frames: int
    crossings: int
    waited_ns: int


class RunStatistics(msgspec.Struct, frozen=True, kw_only=True):
    """The counters of a graph: the JSON of `launch --stats=json`, see docs/statistics.md.

    Attributes:
        schema: name and version of the format.
        elapsed_s: since the run began, s.
        elements: in the order of the description.
        processes: the main process, then one for each bin with `process=true`.
        shortfalls: what the pipeline is for and was not made, in words.
    """

    schema: Literal["streamkit.statistics/1"] = "streamkit.statistics/1"
    elapsed_s: float
    elements: list[ElementStatistics]
    processes: list[ProcessStatistics] = []
    shortfalls: list[str] = []


def read_statistics(file: str | Path) -> RunStatistics:
    """The counters in a file that `launch --stats-file` has written.

    Raises:
        OSError: the file cannot be read.
        StreamError: it holds something else.
    """
    file = Path(file)
    if file.stat().st_size > FILE_LIMIT_BYTES:
        raise StreamError(f"{file}: statistics have at most {FILE_LIMIT_BYTES} bytes")
    try:
        return msgspec.json.decode(file.read_bytes(), type=RunStatistics)
    except msgspec.DecodeError as error:
        raise StreamError(f"{file}: no statistics as launch --stats-file writes them: {error}") from None
