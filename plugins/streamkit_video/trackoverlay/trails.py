"""Past positions of targets, in pixels of the newest frame while the camera moves."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from streamkit.geometry.homography import inverse, is_invertible, project

FloatArray = NDArray[np.float64]

MAX_POINTS = 20_000
POINT = np.dtype([("id", np.int64), ("time_ns", np.int64), ("xy", np.float64, 2)])


class Trails:
    """Past positions of targets, warped from frame to frame with the ground.

    Limited by age and, over all targets, to `MAX_POINTS`; the oldest are dropped first.
    """

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Drops all positions."""
        self._points = np.empty(0, POINT)

    def __len__(self) -> int:
        return len(self._points)

    def warp(self, to_previous: FloatArray) -> None:
        """Warps all positions into a new frame; drops them if the homography is singular.

        Args:
            to_previous: float64[3, 3], maps pixels of the new frame to the previous one.
        """
        if not len(self):
            return
        if not is_invertible(to_previous):
            self.clear()
            return
        self._points["xy"] = project(inverse(to_previous), self._points["xy"])

    def extend(self, ids: Sequence[int], points: Sequence[tuple[float, float]], time_ns: int) -> None:
        """Adds the positions of the newest frame."""
        added = [(identity, time_ns, point) for identity, point in zip(ids, points, strict=True)]
        self._points = np.concatenate([self._points, np.array(added, POINT)])

    def drop_before(self, time_ns: int) -> None:
        """Drops positions older than a time, and the oldest beyond the limit."""
        newest = self._points[-MAX_POINTS:]
        self._points = newest[newest["time_ns"] >= time_ns]

    def paths(self) -> Iterator[tuple[int, FloatArray]]:
        """Each target's id and its float64[n, 2] positions, oldest first, px of the newest frame."""
        for identity in np.unique(self._points["id"]):
            yield int(identity), self._points["xy"][self._points["id"] == identity]
