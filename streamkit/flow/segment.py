"""Segment: how the timestamps of a stream lie on the pipeline's running time."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Segment:
    """A stretch of a stream.

    Attributes:
        start_ns: timestamp where the stretch begins; what lies wholly before it is not shown.
        stop_ns: timestamp where it ends; None is open.
        base_ns: running time at `start_ns`.

    Source: GStreamer's segment arithmetic, for playback at normal speed.
    """

    start_ns: int = 0
    stop_ns: int | None = None
    base_ns: int = 0

    def running_time_ns(self, pts_ns: int) -> int:
        """The running time at which a timestamp is due, ns; before `start_ns` it is less than `base_ns`."""
        return pts_ns - self.start_ns + self.base_ns

    def holds(self, pts_ns: int, duration_ns: int | None) -> bool:
        """Whether any of a frame lies in the stretch."""
        if self.stop_ns is not None and pts_ns >= self.stop_ns:
            return False
        return pts_ns >= self.start_ns or (bool(duration_ns) and pts_ns + (duration_ns or 0) > self.start_ns)


OPEN_SEGMENT = Segment()
