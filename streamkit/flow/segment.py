"""Segment: maps timestamps of a stream to running time."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Segment:
    """A segment of a stream.

    Attributes:
        start_ns: first timestamp; frames wholly before it are not rendered.
        stop_ns: end timestamp; None is open.
        base_ns: running time at `start_ns`.

    Source: GStreamer's segment arithmetic, for playback at normal speed.
    """

    start_ns: int = 0
    stop_ns: int | None = None
    base_ns: int = 0

    def running_time_ns(self, pts_ns: int) -> int:
        """Running time of a timestamp, ns; less than `base_ns` before `start_ns`."""
        return pts_ns - self.start_ns + self.base_ns

    def holds(self, pts_ns: int, duration_ns: int | None) -> bool:
        """Whether a frame overlaps the segment."""
        if self.stop_ns is not None and pts_ns >= self.stop_ns:
            return False
        return pts_ns >= self.start_ns or (bool(duration_ns) and pts_ns + (duration_ns or 0) > self.start_ns)


OPEN_SEGMENT = Segment()
