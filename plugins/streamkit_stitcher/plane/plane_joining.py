"""Joining of planes whose keyframes show the same ground."""

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from streamkit.geometry.homography import FloatArray, normalised, project, scale_change
from streamkit_stitcher.plane.frame_registration import is_stretched
from streamkit_stitcher.plane.keyframe_graph import KeyframeGraph, Tie
from streamkit_stitcher.registration.motion_models import MotionModel, least_squares

_FEWEST_POINTS: Final = 24
_MANY_POINTS: Final = 50
_MIN_CORRELATION: Final = 0.15
# Planes of more keyframes than this are about level, and differ by a similarity; the few ties of one overlap
# would bend the rest of them.
_FEW: Final = 2
_LARGEST_ERROR: Final = 0.1


def joins(
    ties: Sequence[Tie], graph: KeyframeGraph, current: int, shape: tuple[int, int]
) -> Iterator[tuple[FloatArray, int, int]]:
    """The changes that bring planes together, each to be applied to the graph before the next is asked for.

    The smaller plane moves; of equal ones that which is not current. Reliable ties are added to the graph.

    Args:
        ties: of keyframes of different planes.
        graph: the keyframes of all planes.
        current: number of the current plane.
        shape: of the frames.

    Yields:
        float64[3, 3], old plane to new, the number of the plane that moves, and of the one that it joins.
    """
    for tie in sorted(ties, key=lambda tie: -len(tie.patches)):
        planes = graph.planes
        if tie.host not in planes or tie.observer not in planes or not _is_reliable(tie):
            continue
        host, observer = planes[tie.host], planes[tie.observer]
        if host != observer:
            moved, kept = sorted((host, observer), key=lambda plane: (graph.added(plane), plane == current))
            change = _change(tie, graph, moved, shape)
            if change is None:
                continue
            yield change, moved, kept
        graph.tie(tie)


def _is_reliable(tie: Tie) -> bool:
    """Trees lean differently in each frame and hardly correlate; then many points must agree."""
    count = len(tie.patches)
    return count >= _MANY_POINTS or (count >= _FEWEST_POINTS and tie.correlation >= _MIN_CORRELATION)


def _change(tie: Tie, graph: KeyframeGraph, moved: int, shape: tuple[int, int]) -> FloatArray | None:
    """The change of the plane that moves, or None where it would stretch a frame."""
    source = project(graph.homographies[tie.observer], tie.points)
    target = project(graph.homographies[tie.host], tie.host_points)
    if graph.planes[tie.host] == moved:
        source, target = target, source
    width = shape[1] * scale_change(graph.homographies[tie.observer], shape)
    for model in (MotionModel.SIMILARITY, MotionModel.HOMOGRAPHY)[graph.added(moved) <= _FEW :]:
        change = least_squares(model, source, target)
        if change is None or np.hypot(*(project(change, source) - target).T).max() > _LARGEST_ERROR * width:
            continue
        places = [change @ graph.homographies[index] for index, own in graph.planes.items() if own == moved]
        if not any(is_stretched(normalised(matrix), shape) for matrix in places):
            return normalised(change)
    return None
