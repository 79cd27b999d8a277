"""Where to cut a chain into processes, so that its work is spread evenly over the cores."""

from __future__ import annotations

import functools
from collections.abc import Collection, Sequence

MIN_GAIN = 0.1  # of the time of a frame: a process takes about 120 MiB, and times vary by some percent


def balanced_cuts(work: Sequence[float], cuts: Collection[int], cores: int, crossing: float) -> list[int]:
    """The places at which to cut a chain, such that the busiest process has least to do.

    Args:
        work: of each part of the chain, in order.
        cuts: numbers of the parts before which it may be cut.
        cores: largest number of processes.
        crossing: what a cut costs each of the two processes, in the unit of `work`.

    Returns:
        Some of `cuts`, in order; none if that would save less than a tenth.
    """

    @functools.cache
    def split(first: int, processes: int) -> tuple[float, int, tuple[int, ...]]:
        """The work of the busiest process from a part on, and the number and places of the cuts."""
        before = crossing if first else 0.0
        found: list[tuple[float, int, tuple[int, ...]]] = [(before + sum(work[first:]), 0, ())]
        for place in (place for place in cuts if processes > 1 and place > first):
            most, count, places = split(place, processes - 1)
            most = max(most, before + sum(work[first:place]) + crossing)
            found.append((most, count + 1, (place, *places)))
        return min(found)

    most, _, places = split(0, cores)
    return list(places) if most <= (1 - MIN_GAIN) * sum(work) else []
