"""Size, place and turn of a target as its detections show them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from streamkit_tracker import kinematics
from streamkit_tracker.box_shape import (
    AGAIN_THERE,
    BOX_HEIGHT,
    BOX_WIDTH,
    RATED_S,
    SEEN_STD,
    STEP_S,
    YOUNG_S,
    follow_detections,
    settle_windows,
    turn_boxes,
    window_turn,
)
from streamkit_tracker.box_shape import DETECTED_S as DETECTED
from streamkit_tracker.observation import Sighting
from streamkit_tracker.window_geometry import ANGLE, FloatArray, window_sides

Size = TypeVar("Size", float, FloatArray)


class DetectedShape:
    """What detections have shown of one target.

    A detection knows where a target is and how large, but trembles; the window, led by the target's
    appearance, is steady but may sit on a part of the target or creep. So the window is left alone while
    both agree, and begins again on the detections where they contradict it for some frames.

    Attributes:
        numbers: float64[8], see `box_shape`; those of many targets are worked on together.

    Args:
        box: of the first detection, width and height, px.
    """

    def __init__(self, box: tuple[float, float]) -> None:
        self.numbers: FloatArray = np.zeros(8)
        self.numbers[[BOX_WIDTH, BOX_HEIGHT, STEP_S]] = *box, RATED_S

    @property
    def box(self) -> tuple[float, float]:
        """Width and height of the upright box, px."""
        return self.numbers.item(BOX_WIDTH), self.numbers.item(BOX_HEIGHT)

    @property
    def settled(self) -> bool:
        """Whether detections have shown all of the target."""
        return self.numbers.item(DETECTED) >= YOUNG_S

    def window(self, x: float, y: float, heading: float) -> FloatArray:
        """float64[5]: the box's shape turned into a direction, about a centre."""
        return np.array([x, y, *window_turn(*self.box, heading)])


@dataclass(frozen=True, eq=False)
class Motion:
    """States of n targets.

    Attributes:
        means: float64[n, 4], x y (px) and velocity (px/s).
        covariances: float64[n, 4, 4].
    """

    means: FloatArray
    covariances: FloatArray

    def headings(self, windows: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Directions of motion, or the windows' own meanwhile, and their standard deviations: float64[n]."""
        headings, deviations = kinematics.headings(self.means, self.covariances, window_sides(windows))
        return np.where(np.isnan(headings), windows[:, ANGLE], headings), deviations


def remember(shapes: Sequence[DetectedShape], sightings: Sequence[Sighting], step_s: float) -> None:
    """Lets the boxes of n targets follow detections that show nothing else."""
    if not shapes:
        return
    numbers = _numbers(shapes)
    follow_detections(numbers, seen_rows(sightings), step_s)
    _keep(shapes, numbers)


def turned_boxes(shapes: Sequence[DetectedShape], headings: FloatArray) -> FloatArray:
    """float64[n, 3]: length and width (px) of the windows in the boxes of n targets, and their angles."""
    turned = np.empty((len(shapes), 3))
    turn_boxes(_numbers(shapes), headings, turned)
    return turned


def restarts(
    shapes: Sequence[DetectedShape],
    sightings: Sequence[Sighting],
    windows: FloatArray,
    motion: Motion,
    alike: NDArray[np.bool_],
    looked_at: NDArray[np.bool_],
) -> list[tuple[FloatArray, bool] | None]:
    """Where the windows of n targets are to begin again, or None where they are right.

    Args:
        shapes: of the targets.
        sightings: their detections in this frame, which show nothing else.
        windows: float64[n, 5], as found by appearance.
        motion: of the targets.
        alike: bool[n], whether they were recognised.
        looked_at: bool[n], whether anybody tried.

    Returns:
        For each a window float64[5] and whether the state moves there too.
    """
    if not shapes:
        return []
    numbers, seen = _numbers(shapes), seen_rows(sightings)
    headings, deviations = motion.headings(windows)
    trusts = np.minimum(1.0, centroid_std(window_sides(windows)) / seen[:, SEEN_STD]) ** 2
    verdicts, better = np.empty(len(shapes), np.int64), np.empty((len(shapes), 5))
    settle_windows(
        numbers,
        windows,
        motion.means,
        seen,
        headings,
        deviations,
        trusts,
        alike,
        looked_at,
        verdicts,
        better,
    )
    _keep(shapes, numbers)
    return [
        (window, verdict == AGAIN_THERE) if verdict else None
        for window, verdict in zip(better, verdicts.tolist(), strict=True)
    ]


def _numbers(shapes: Sequence[DetectedShape]) -> FloatArray:
    return np.array([shape.numbers for shape in shapes])


def _keep(shapes: Sequence[DetectedShape], numbers: FloatArray) -> None:
    for shape, row in zip(shapes, numbers, strict=True):
        shape.numbers = row


def seen_rows(sightings: Sequence[Sighting]) -> FloatArray:
    """Rows float64[n, 8] of what is seen, see `box_shape`."""
    return np.array([(*s.centroid, *s.box, *s.middle, s.std, s.crowded) for s in sightings], np.float64)


def centroid_std(side: Size) -> Size:
    """Standard deviation expected of a detection's centroid, px, for a target of a given side, px."""
    return 1.0 + 0.04 * side
