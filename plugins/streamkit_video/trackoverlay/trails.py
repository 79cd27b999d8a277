"""Past positions of targets, in pixels of the newest frame while the camera moves."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

MAX_POINTS = 20_000


class Trails:
    """Past positions of targets, warped from frame to frame with the ground.

    Limited by age and, over all targets, to `MAX_POINTS`; the oldest are dropped first.
    """

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Drops all positions."""
        self._ids: IntArray = np.empty(0, np.int64)
        self._times: IntArray = np.empty(0, np.int64)
        self._points: FloatArray = np.empty((0, 2))

    def __len__(self) -> int:
        return len(self._ids)

    def warp(self, to_previous: FloatArray) -> None:
        """Warps all positions into a new frame; drops them if the homography is singular.

        Args:
            to_previous: float64[3, 3], maps pixels of the new frame to the previous one.
        """
        if not len(self):
            return
        if not np.isfinite(to_previous).all() or abs(np.linalg.det(to_previous)) < 1e-9:
            self.clear()
            return
        warped = cv2.perspectiveTransform(self._points[None], np.linalg.inv(to_previous))
        self._points = np.asarray(warped[0], np.float64)

    def extend(self, ids: Sequence[int], points: Sequence[tuple[float, float]], time_ns: int) -> None:
        """Adds the positions of the newest frame."""
        if ids:
            self._ids = np.concatenate([self._ids, np.array(ids, np.int64)])
            self._points = np.concatenate([self._points, np.array(points, np.float64)])
            self._times = np.concatenate([self._times, np.full(len(ids), time_ns, np.int64)])

    def drop_before(self, time_ns: int) -> None:
        """Drops positions older than a time, and the oldest beyond the limit."""
        kept = self._times >= time_ns
        kept[: max(0, len(self) - MAX_POINTS)] = False
        if not kept.all():
            self._ids, self._times, self._points = self._ids[kept], self._times[kept], self._points[kept]

    def paths(self) -> Iterator[tuple[int, FloatArray]]:
        """Each target's id and its float64[n, 2] positions, oldest first, px of the newest frame."""
        for identity in np.unique(self._ids):
            yield int(identity), self._points[self._ids == identity]
