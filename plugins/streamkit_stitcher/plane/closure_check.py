"""Verification of loop closures: terrain repeats itself, and one false tie bends the plane."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from streamkit.geometry.homography import FloatArray, project, scale_change
from streamkit_stitcher.plane.keyframe_graph import Tie

# Allowed error between two keyframes, as a part of the width: errors of direction accumulate along the path
# of ties between them. Beyond the maximum a second tie must agree.
_ALLOWED: Final = 0.01
_GROWTH: Final = 1.5
_MAX_ALLOWED: Final = 0.1
# Over paths this short nothing accumulates, whatever other ties say.
FEW_STEPS: Final = 4
_AGREEING: Final = 0.05
_NEIGHBOURS: Final = 4
_MAX_WAITING: Final = 8
_SETTLED: Final = 0.003
_MIN_CORRELATION: Final = 0.5


class ClosureCheck:
    """Accepts or rejects ties across flight strips.

    A tie is accepted where its error is within what the path of ties between its keyframes allows. One with a
    larger error needs a high correlation over all shared ground, and waits until a second tie of about the
    same time asks for the same correction.
    """

    def __init__(self) -> None:
        self._waiting: list[Tie] = []
        self._is_far = False

    @property
    def is_far(self) -> bool:
        """Whether a tie that was accepted last moves more than the newest few keyframes."""
        return self._is_far

    def accepted(
        self,
        ties: Sequence[Tie],
        homographies: Mapping[int, FloatArray],
        steps: Mapping[int, int],
        shape: tuple[int, int],
    ) -> tuple[Tie, ...]:
        """The ties that can be accepted by now, waiting ones among them.

        Args:
            ties: of one newest keyframe.
            homographies: of the keyframes, to the plane.
            steps: length of the path of ties from the newest keyframe; absent where there is none.
            shape: of the newest keyframe.
        """
        found: list[Tie] = []
        self._is_far = False
        for tie in ties:
            if tie.host not in homographies or tie.observer not in homographies:
                continue
            correction, path = _correction(tie, homographies), steps.get(tie.host)
            width = shape[1] * scale_change(homographies[tie.observer], shape)
            distance = float(np.hypot(*correction))
            if distance <= width * _allowed(path):
                found.append(tie)
                self._is_far |= distance > width * _SETTLED
            elif tie.correlation > _MIN_CORRELATION and (path is None or path > FEW_STEPS):
                agreeing = self._agreeing(tie, correction, homographies, width * _AGREEING)
                self._waiting = [other for other in self._waiting if other not in agreeing]
                if agreeing:
                    found.extend([*agreeing, tie])
                    self._is_far = True
                else:
                    self._waiting.append(tie)
        self._waiting = self._waiting[-_MAX_WAITING:]
        return tuple(found)

    def _agreeing(
        self, tie: Tie, correction: FloatArray, homographies: Mapping[int, FloatArray], tolerance_px: float
    ) -> list[Tie]:
        """Waiting ties of about the same time and correction."""
        return [
            other
            for other in self._waiting
            if tie.observer - other.observer <= _NEIGHBOURS
            and other.observer in homographies
            and other.host in homographies
            and np.hypot(*(_correction(other, homographies) - correction)) <= tolerance_px
        ]


def _allowed(steps: int | None) -> float:
    return _MAX_ALLOWED if steps is None else min(_MAX_ALLOWED, _ALLOWED * steps**_GROWTH)


def _correction(tie: Tie, homographies: Mapping[int, FloatArray]) -> FloatArray:
    """Median shift of the observer against its host that a tie asks for, float64[2], px of the plane."""
    shifts = project(homographies[tie.host], tie.host_points) - project(
        homographies[tie.observer], tie.points
    )
    return np.asarray(np.median(shifts, axis=0))
