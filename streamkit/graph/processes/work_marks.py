"""WorkMarks: what a child was doing, in memory that outlives it."""

from __future__ import annotations

from streamkit.crossing.shared_memory import make_memory, map_memory


class WorkMarks:
    """Memory that parent and child share.

    Args:
        count: number of elements of the graph.
        descriptor: of the memory; the caller closes it.

    Attributes:
        at_work: `Element.at_work` of each element.
        last_frame: number of the newest frame that came through a link, -1 before one.
    """

    def __init__(self, count: int, descriptor: int) -> None:
        memory = memoryview(map_memory(descriptor, 8 + count, writable=True)).cast("B")
        self.last_frame, self.at_work = memory[:8].cast("q"), memory[8:]

    @classmethod
    def make(cls, count: int) -> tuple[WorkMarks, int]:
        """New marks, and the descriptor to be sent to the child and then closed."""
        descriptor = make_memory("streamkit-marks", 8 + count)
        marks = cls(count, descriptor)
        marks.last_frame[0] = -1
        return marks, descriptor
