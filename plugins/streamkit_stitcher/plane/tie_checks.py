"""Checks of ties across flight strips and planes: terrain repeats itself, and a false tie bends the plane."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import numpy as np

from streamkit.geometry.homography import FloatArray, normalised, project, scale_change
from streamkit_stitcher.plane.frame_registration import OK_STD, is_stretched
from streamkit_stitcher.plane.keyframe_graph import KeyframeGraph, Tie
from streamkit_stitcher.registration.motion_models import MotionModel, least_squares

# Allowed error between two keyframes, as a part of the width: errors of direction accumulate along the path
# of ties between them.
_ALLOWED: Final = 0.01
_GROWTH: Final = 1.5
_MAX_ALLOWED: Final = 0.1
# Over paths this short nothing accumulates, whatever a tie says.
_FEW_STEPS: Final = 4
_SETTLED: Final = 0.003
_MIN_CORRELATION: Final = 0.5
# To join planes.
_MIN_JOIN_POINTS: Final = 24
_MANY_POINTS: Final = 50
_MIN_JOIN_CORRELATION: Final = 0.15
# Planes of more keyframes than this are about level, and differ by a similarity; the few ties of one overlap
# would bend the rest of them.
_FEW_KEYFRAMES: Final = 2
# Largest misfit of a join, the root mean square distance of its tie points. Of a video, px: that of a
# similarity is a tilt, which is worst at the corners, that of a homography is relief. Of photographs, by the
# width: they are adjusted together in the end.
_MAX_VIDEO_MISFITS: Final = {MotionModel.SIMILARITY: OK_STD, MotionModel.HOMOGRAPHY: 2.0}
_MAX_SURVEY_MISFIT: Final = 0.05


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
        allowed = _MAX_ALLOWED if path is None else min(_MAX_ALLOWED, _ALLOWED * path**_GROWTH)
        if distance <= width * allowed or (is_long and tie.correlation > _MIN_CORRELATION):
            found.append(tie)
            is_far |= distance > width * _SETTLED
    return tuple(found), is_far


def joins(
    ties: Sequence[Tie], graph: KeyframeGraph, current: int, shape: tuple[int, int], is_survey: bool
) -> Iterator[tuple[FloatArray, int, int]]:
    """The changes that bring planes together, each to be applied to the graph before the next is asked for.

    The smaller plane moves; of equal ones that which is not current. Reliable ties are added to the graph.

    Args:
        ties: of keyframes of different planes.
        graph: the keyframes of all planes.
        current: number of the current plane.
        shape: of the frames.
        is_survey: whether the frames are photographs.

    Yields:
        float64[3, 3], old plane to new, the number of the plane that moves, and of the one that it joins.
    """
    survey_misfits = dict.fromkeys(_MAX_VIDEO_MISFITS, _MAX_SURVEY_MISFIT * shape[1])
    misfits = survey_misfits if is_survey else _MAX_VIDEO_MISFITS
    for tie in sorted(ties, key=lambda tie: -len(tie.patches)):
        planes = graph.planes
        is_known = tie.host in planes and tie.observer in planes
        # Frames of a video are ok on both planes, and have to be on the joined one.
        is_precise = is_survey or tie.corner_std <= OK_STD
        if not (is_known and is_precise and _is_reliable(tie)):
            continue
        host, observer = planes[tie.host], planes[tie.observer]
        if host != observer:
            moved, kept = sorted((host, observer), key=lambda plane: (graph.added[plane], plane == current))
            change = _change(tie, graph, moved, shape, misfits)
            if change is None:
                continue
            yield change, moved, kept
        graph.tie(tie)


def _is_reliable(tie: Tie) -> bool:
    """Trees lean differently in each frame and hardly correlate; then many points must agree."""
    count = len(tie.patches)
    return count >= _MANY_POINTS or (count >= _MIN_JOIN_POINTS and tie.correlation >= _MIN_JOIN_CORRELATION)


def _change(
    tie: Tie,
    graph: KeyframeGraph,
    moved: int,
    shape: tuple[int, int],
    misfits: Mapping[MotionModel, float],
) -> FloatArray | None:
    """The change of the plane that moves; None where it stretches a frame or exceeds `misfits`, px."""
    source = project(graph.homographies[tie.observer], tie.points)
    target = project(graph.homographies[tie.host], tie.host_points)
    kept = tie.host
    if graph.planes[tie.host] == moved:
        source, target, kept = target, source, tie.observer
    scale = scale_change(graph.homographies[kept], shape)
    for model in (MotionModel.SIMILARITY, MotionModel.HOMOGRAPHY)[graph.added[moved] <= _FEW_KEYFRAMES :]:
        change = least_squares(model, source, target)
        if change is None:
            continue
        misfit = float(np.sqrt(np.mean(np.sum((project(change, source) - target) ** 2, axis=1)))) / scale
        if misfit > misfits[model]:
            continue
        places = [change @ graph.homographies[index] for index, own in graph.planes.items() if own == moved]
        if not any(is_stretched(normalised(matrix), shape) for matrix in places):
            return normalised(change)
    return None
