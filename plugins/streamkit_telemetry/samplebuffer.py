"""Samples in time order, and the one for a frame."""

from __future__ import annotations

import bisect
from collections import deque
from dataclasses import replace

from streamkit_telemetry_formats.sample import Sample, between

CAPACITY = 4096


class SampleBuffer:
    """Holds the newest samples; finds or interpolates the one for a time.

    Args:
        longest_gap_ns: a sample further from its frame is stale; two more than twice as far apart are not
            interpolated.
    """

    def __init__(self, longest_gap_ns: int) -> None:
        self._longest_gap_ns = longest_gap_ns
        self._samples: deque[Sample] = deque(maxlen=CAPACITY)
        self._has_evicted = False

    def __len__(self) -> int:
        return len(self._samples)

    def add(self, sample: Sample) -> None:
        """Adds a sample; it replaces one of the same time."""
        samples = self._samples
        if not samples or sample.pts > samples[-1].pts:
            self._has_evicted |= len(samples) == CAPACITY
            samples.append(sample)
            return
        at = bisect.bisect_left(samples, sample.pts, key=_time)
        if samples[at].pts == sample.pts:
            samples[at] = sample
        elif len(samples) < CAPACITY:
            samples.insert(at, sample)

    def clear(self) -> None:
        """Removes all samples: the timestamps restart."""
        self._samples.clear()
        self._has_evicted = False

    def covers(self, pts: int) -> bool:
        """Whether a sample of this time or later is held, so that waiting brings nothing nearer."""
        return bool(self._samples) and self._samples[-1].pts >= pts

    def was_evicted(self, pts: int) -> bool:
        """Whether samples at a time were removed to make room for newer ones."""
        return self._has_evicted and pts < self._samples[0].pts

    def sample_at(self, pts: int) -> tuple[Sample, int, bool] | None:
        """The sample for a time.

        Returns:
            The sample, interpolated where its neighbours are near enough; the time from the frame to the
            nearest one measured (negative: it is older), ns; whether that is stale. None without any sample.
        """
        samples = self._samples
        if not samples:
            return None
        at = bisect.bisect_left(samples, pts, key=_time)
        neighbours = [samples[i] for i in (at - 1, at) if 0 <= i < len(samples)]
        nearest = min(neighbours, key=lambda sample: abs(sample.pts - pts))
        gap = nearest.pts - pts
        stale = abs(gap) > self._longest_gap_ns
        if len(neighbours) == 2 and gap and neighbours[1].pts - neighbours[0].pts <= 2 * self._longest_gap_ns:
            return between(neighbours[0], neighbours[1], pts), gap, stale
        return replace(nearest, pts=pts), gap, stale


def _time(sample: Sample) -> int:
    return sample.pts
