"""Admission of feeds by measured cost: which ones their machines cannot hold."""

from __future__ import annotations

from collections.abc import Mapping

from streamkit import Pipeline
from streamkit_fleet.feeds import FeedSpec

WARM_UP_FRAMES = 25  # the first ones fill caches and queues
WINDOW_FRAMES = 50  # two seconds of a usual camera


class CostMeter:
    """Measures the cores that a playing pipeline needs to hold a frame rate, 1/s.

    Attributes:
        cores: processor time per frame of the last whole window, times the frame rate; 0 before the first.
    """

    def __init__(self, pipeline: Pipeline, frame_rate: float) -> None:
        self._pipeline, self._frame_rate = pipeline, frame_rate
        self._from: tuple[int, int] | None = None  # frames and processor time (ns) where the window begins
        self.cores = 0.0

    def update(self) -> None:
        """Ends the window if it is long enough.

        Frames that queues dropped do not count: without room for all, the rest costs what all would.
        """
        rows = self._pipeline.statistics()
        frames = max((row.frames_in for row in rows), default=0)
        frames -= sum(row.total_dropped for row in rows if row.queue is not None)
        begin = WARM_UP_FRAMES if self._from is None else self._from[0] + WINDOW_FRAMES
        if frames < begin:
            return
        cpu_ns = sum(row.cpu_ns for row in self._pipeline.process_statistics())
        if self._from is not None:
            self.cores = (cpu_ns - self._from[1]) / 1e9 / (frames - self._from[0]) * self._frame_rate
        self._from = frames, cpu_ns


def excess(needs: Mapping[str, float], room: float, new: Mapping[str, FeedSpec]) -> dict[str, str]:
    """The new feeds of a machine that it cannot hold, with the reason.

    Those with the highest nice go first, of equal ones the last. `needs` are the cores that each feed on the
    machine needs, `room` those that it has.
    """
    refused = {}
    total = sum(needs.values())
    for name, feed in sorted(new.items(), key=lambda item: item[1].nice)[::-1]:
        if total <= room:
            break
        total -= needs[name]
        refused[name] = (
            f"no room: for {feed.frame_rate:g} frames/s it needs {needs[name]:.2f} of {room:g} cores, and "
            f"the other feeds there {total:.2f}; set its cores to {needs[name]:.2f}, or a lower frame_rate"
        )
    return refused
