"""Checks of ties across flight strips: terrain repeats itself, and a false tie bends the plane."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from streamkit.geometry.homography import FloatArray, project, scale_change
from streamkit_stitcher.plane.keyframe_graph import Tie

# Allowed error between two keyframes, as a part of the width: errors of direction accumulate along the path
# of ties between them.
_ALLOWED: Final = 0.01
_GROWTH: Final = 1.5
# The largest error that ties correct, as a part of the width.
MAX_DRIFT: Final = 0.1
# Over paths this short nothing accumulates, whatever a tie says.
_FEW_STEPS: Final = 4
_SETTLED: Final = 0.003
_MIN_CORRELATION: Final = 0.5


def accepted_ties(
    ties: Sequence[Tie],
    homographies: Mapping[int, FloatArray],
    steps: Mapping[int, int],
    shape: tuple[int, int],
) -> tuple[tuple[Tie, ...], bool]:
    """The ties that can be accepted, and whether one of them moves more than the newest few keyframes.

    A tie is accepted where its error is within what the path of ties between its keyframes allows. One with a
    larger error needs a high correlation over all shared ground.

    Args:
        ties: of one newest keyframe.
        homographies: of the keyframes, to the plane.
        steps: length of the path of ties from the newest keyframe; absent where there is none.
        shape: of the newest keyframe.
    """
    found, is_far = [], False
    for tie in ties:
        if tie.host not in homographies or tie.observer not in homographies:
            continue
        # Shift of the observer against its host that the tie asks for, px of the plane.
        shifts = project(homographies[tie.host], tie.host_points) - project(
            homographies[tie.observer], tie.points
        )
        distance, path = float(np.hypot(*np.median(shifts, axis=0))), steps.get(tie.host)
        width = shape[1] * scale_change(homographies[tie.observer], shape)
        is_long = path is None or path > _FEW_STEPS
        allowed = MAX_DRIFT if path is None else min(MAX_DRIFT, _ALLOWED * path**_GROWTH)
        if distance <= width * allowed or (is_long and tie.correlation > _MIN_CORRELATION):
            found.append(tie)
            is_far |= distance > width * _SETTLED
    return tuple(found), is_far
