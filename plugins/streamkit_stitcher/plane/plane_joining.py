"""Joins planes whose keyframes show the same ground."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from streamkit.geometry.homography import FloatArray, corners, inverse, normalised, project, scale_change
from streamkit_stitcher.plane.frame_registration import OK_STD, is_stretched
from streamkit_stitcher.plane.keyframe_graph import KeyframeGraph, Tie
from streamkit_stitcher.plane.keyframes import Keyframe, predicted_error
from streamkit_stitcher.registration.gauss_newton import deviation_at
from streamkit_stitcher.registration.motion_models import MotionModel, least_squares

_MIN_POINTS: Final = 24
_MANY_POINTS: Final = 50
_MIN_CORRELATION: Final = 0.15
# Planes of more keyframes than this are about level, and differ by a similarity; the few ties of one overlap
# would bend the rest of them.
_FEW_KEYFRAMES: Final = 2
# Largest misfit of a join, the root mean square distance of its tie points. Of a video, px: that of a
# similarity is a tilt, which is worst at the corners, that of a homography is relief. Of photographs, by the
# width: they are adjusted together in the end.
_MAX_VIDEO_MISFITS: Final = {MotionModel.SIMILARITY: OK_STD, MotionModel.HOMOGRAPHY: 2.0}
_MAX_SURVEY_MISFIT: Final = 0.05
# Ties that wait, the newest: those of some sixty keyframes.
_MAX_WAITING: Final = 200


class PlaneTies:
    """The ties between keyframes of different planes, which wait until they suffice to join these.

    Photographs are joined by one tie, and adjusted together in the end. Frames of a video are `ok` on both
    planes, and have to be on the joined one: there all ties between two planes count together, as one over a
    narrow overlap leaves the other side of the frame open.
    """

    def __init__(self) -> None:
        self._waiting: list[Tie] = []

    def joins(
        self, ties: Iterable[Tie], graph: KeyframeGraph, current: int, shape: tuple[int, int], is_survey: bool
    ) -> Iterator[tuple[FloatArray, int, int]]:
        """The changes that bring planes together, each to be applied to the graph before the next is taken.

        The smaller plane moves; of equal ones that which is not current. Ties of joined planes are added to
        the graph.

        Args:
            ties: new ones of keyframes of different planes.
            graph: the keyframes of all planes.
            current: number of the current plane.
            shape: of the frames.
            is_survey: whether the frames are photographs.

        Yields:
            float64[3, 3], old plane to new, the number of the plane that moves, and of the one that it joins.
        """
        reliable = [tie for tie in ties if _is_reliable(tie)]
        waiting = [
            tie
            for tie in ([] if is_survey else self._waiting) + reliable
            if tie.host in graph.planes and tie.observer in graph.planes
        ]
        pools = [[tie] for tie in waiting] if is_survey else _by_planes(waiting, graph.planes)
        for pool in sorted(pools, key=lambda pool: -sum(len(tie.patches) for tie in pool)):
            planes = _planes_of(pool[0], graph.planes)
            if len(planes) > 1:
                moved, kept = sorted(planes, key=lambda plane: (graph.added[plane], plane == current))
                change = _change(pool, graph, moved, shape, is_survey)
                if change is None:
                    continue
                yield change, moved, kept
            for tie in pool:
                graph.tie(tie)
        apart = [tie for tie in waiting if len(_planes_of(tie, graph.planes)) > 1]
        self._waiting = [] if is_survey else apart[-_MAX_WAITING:]

    def seen_from(self, plane: int, keyframes: Iterable[Keyframe], graph: KeyframeGraph) -> list[Keyframe]:
        """The keyframes of other planes, where the waiting ties put them on `plane`.

        They are precise near the ties only, which suffices to find more of them.
        """
        found = []
        for pool in _by_planes(self._waiting, graph.planes):
            planes = _planes_of(pool[0], graph.planes)
            if plane in planes and len(planes) > 1:
                (other,) = planes - {plane}
                change = least_squares(MotionModel.HOMOGRAPHY, *_points(pool, graph, other))
                found += [
                    replace(one, to_reference=normalised(change @ one.to_reference), plane=plane)
                    for one in keyframes
                    if one.plane == other and change is not None
                ]
        return found


def _is_reliable(tie: Tie) -> bool:
    """Trees lean differently in each frame and hardly correlate; then many points must agree."""
    count = len(tie.patches)
    return count >= _MANY_POINTS or (count >= _MIN_POINTS and tie.correlation >= _MIN_CORRELATION)


def _planes_of(tie: Tie, planes: Mapping[int, int]) -> frozenset[int]:
    """The numbers of the planes that a tie connects, or of the one that it lies in."""
    return frozenset((planes[tie.host], planes[tie.observer]))


def _by_planes(ties: Iterable[Tie], planes: Mapping[int, int]) -> list[list[Tie]]:
    """The ties of each two planes."""
    found: dict[frozenset[int], list[Tie]] = {}
    for tie in ties:
        found.setdefault(_planes_of(tie, planes), []).append(tie)
    return list(found.values())


def _points(ties: Sequence[Tie], graph: KeyframeGraph, moved: int) -> tuple[FloatArray, FloatArray]:
    """The points of the ties of two planes, float64[n, 2]: on the plane `moved`, and on the other one."""
    pairs = []
    for tie in ties:
        host = project(graph.homographies[tie.host], tie.host_points)
        observer = project(graph.homographies[tie.observer], tie.points)
        pairs.append((host, observer) if graph.planes[tie.host] == moved else (observer, host))
    source, target = zip(*pairs, strict=True)
    return np.concatenate(source), np.concatenate(target)


def _change(
    ties: Sequence[Tie], graph: KeyframeGraph, moved: int, shape: tuple[int, int], is_survey: bool
) -> FloatArray | None:
    """The change of the plane that moves; None where it is imprecise, fits badly or stretches a frame."""
    source, target = _points(ties, graph, moved)
    kept = next(index for index in _keyframes(ties) if graph.planes[index] != moved)
    scale = scale_change(graph.homographies[kept], shape)
    misfits = dict.fromkeys(_MAX_VIDEO_MISFITS, _MAX_SURVEY_MISFIT * shape[1])
    if not is_survey:
        misfits = _MAX_VIDEO_MISFITS
        if _error(ties, graph, moved, shape) > OK_STD:
            return None
    for model in (MotionModel.SIMILARITY, MotionModel.HOMOGRAPHY)[graph.added[moved] <= _FEW_KEYFRAMES :]:
        change = least_squares(model, source, target)
        if change is None or _rms(project(change, source) - target) > misfits[model] * scale:
            continue
        places = [change @ graph.homographies[index] for index, own in graph.planes.items() if own == moved]
        if not any(is_stretched(normalised(matrix), shape) for matrix in places):
            return normalised(change)
    return None


def _error(ties: Sequence[Tie], graph: KeyframeGraph, moved: int, shape: tuple[int, int]) -> float:
    """Predicted error between the tied keyframes of two planes, at their worst corner, px.

    That of a homography, whatever is applied: a similarity that fits a strip hides a tilt.
    """
    source, target = _points(ties, graph, moved)
    change = least_squares(MotionModel.HOMOGRAPHY, source, target)
    if change is None:
        return math.inf
    rmse, to_source, worst = _rms(project(change, source) - target), inverse(change), 0.0
    for index in _keyframes(ties):
        placed = graph.homographies[index]
        if graph.planes[index] == moved:
            placed = normalised(change @ placed)
        outline, scale = project(to_source @ placed, corners(shape)), scale_change(placed, shape)
        if not scale:
            return math.inf
        worst = max(worst, deviation_at(outline, change, source, rmse) / scale)
    return predicted_error(worst, min(tie.share for tie in ties))


def _keyframes(ties: Iterable[Tie]) -> set[int]:
    """The numbers of the keyframes that ties connect."""
    return {index for tie in ties for index in (tie.host, tie.observer)}


def _rms(shifts: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.sum(shifts**2, axis=1))))
