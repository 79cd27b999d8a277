"""Admission of feeds by measured cost: which ones their machines cannot hold."""

from __future__ import annotations

import time
from collections.abc import Mapping

from streamkit import Pipeline
from streamkit_fleet.feeds import FeedSpec

WINDOW_FRAMES = 50  # two seconds of a usual camera
WINDOW_S, MIN_FRAMES = 2.0, 5  # of one with fewer frames


class CostMeter:
    """Measures the cores that a playing pipeline needs to hold a frame rate.

    Args:
        pipeline: the pipeline.
        frame_rate: to hold, 1/s.
        sharing: number of pipelines in the process, which count as equal parts of its processor time.

    Attributes:
        cores: processor time per frame of the last whole window, times the frame rate; 0 before the second,
            as the frames of the first one fill caches and queues.
    """

    def __init__(self, pipeline: Pipeline, frame_rate: float, sharing: int = 1) -> None:
        self._pipeline, self._frame_rate, self._sharing = pipeline, frame_rate, sharing
        self._frames, self._began_s, self._cpu_ns = 0, time.monotonic(), 0  # where the window begins
        self.cores = 0.0

    def update(self) -> None:
        """Ends the window if it is long enough.

        Frames that queues dropped do not count: without room for all, the rest costs what all would.
        """
        rows = self._pipeline.statistics()
        frames = max((row.frames_in for row in rows), default=0)
        frames -= sum(row.total_dropped for row in rows if row.queue is not None)
        new, now_s = frames - self._frames, time.monotonic()
        if new < WINDOW_FRAMES and (new < MIN_FRAMES or now_s - self._began_s < WINDOW_S):
            return
        cpu_ns = sum(row.cpu_ns for row in self._pipeline.process_statistics())
        if self._frames:
            self.cores = (cpu_ns - self._cpu_ns) / 1e9 / self._sharing / new * self._frame_rate
        self._frames, self._began_s, self._cpu_ns = frames, now_s, cpu_ns


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
            f"no room: for {feed.frame_rate:g} frames/s it needs {needs[name]:.3g} of {room:g} cores, and "
            f"the other feeds there {total:.3g}; set its cores to {needs[name]:.3g}, or a lower frame_rate"
        )
    return refused
