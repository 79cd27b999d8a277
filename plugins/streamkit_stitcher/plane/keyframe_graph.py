"""Keyframes and the tie points between them: the input of a bundle adjustment."""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from streamkit.geometry.homography import FloatArray, inverse, normalised, project, scale_change
from streamkit_stitcher.bundle_adjustment.adjustment import AdjustmentSettings, adjust
from streamkit_stitcher.bundle_adjustment.problem import IndexArray, PlaneProblem

# An adjustment, and the keyframe of each of its cameras.
Problem = tuple[PlaneProblem, tuple[int, ...]]
_PATCHES: Final = 1 << 20
_MAX_SCALE: Final = 50.0


@dataclass(frozen=True, eq=False)
class Tie:
    """Tie points: patches of one keyframe found in another.

    Attributes:
        host: index of the keyframe that the patches are from.
        observer: index of the keyframe they were found in.
        patches: int64[k], numbers of the patches in the host, below 2**20.
        host_points: float64[k, 2], their positions in the host, px.
        points: float64[k, 2], their positions in the observer, px.
        share: patches that agree, as a part of those in view.
        correlation: of both keyframes over all their shared ground, -1 to 1.
    """

    host: int
    observer: int
    patches: IndexArray
    host_points: FloatArray
    points: FloatArray
    share: float = 1.0
    correlation: float = 1.0

    def thinned(self, most: int) -> "Tie":
        """At most `most` of the patches, evenly chosen."""
        if len(self.patches) <= most:
            return self
        kept = np.linspace(0, len(self.patches) - 1, most).astype(np.int64)
        return replace(
            self, patches=self.patches[kept], host_points=self.host_points[kept], points=self.points[kept]
        )


class KeyframeGraph:
    """The homographies of all keyframes to their planes, and the ties of the newest of them.

    Args:
        max_tied: keyframes whose ties are kept; older ones are no longer adjusted.

    Attributes:
        added: number of keyframes ever added to each plane.
        homographies: float64[3, 3] of each keyframe, oldest first: its pixels to its plane.
        planes: the number of each keyframe's plane.
    """

    def __init__(self, max_tied: int) -> None:
        self._max_tied = max_tied
        self.added: Counter[int] = Counter()
        self.homographies: dict[int, FloatArray] = {}
        self.planes: dict[int, int] = {}
        self._ties: dict[int, list[Tie]] = {}

    @property
    def tied(self) -> tuple[int, ...]:
        """The keyframes that can still be adjusted, oldest first."""
        return tuple(self._ties)

    def add(self, index: int, to_reference: FloatArray, ties: Sequence[Tie], plane: int = 0) -> None:
        """Adds a keyframe to a plane with its ties to earlier ones."""
        self.added[plane] += 1
        self.planes[index] = plane
        self.homographies[index] = to_reference
        self._ties[index] = list(ties)
        if len(self._ties) > self._max_tied:
            del self._ties[next(iter(self._ties))]

    def tie(self, tie: Tie) -> None:
        """Adds a tie found later, unless its keyframes are no longer adjusted."""
        if tie.observer in self._ties and tie.host in self.homographies:
            self._ties[tie.observer].append(tie)

    def hosts(self, index: int) -> set[int]:
        """The earlier keyframes that `index` is tied to."""
        return {tie.host for tie in self._ties.get(index, ())}

    def steps_from(self, index: int) -> dict[int, int]:
        """Length of the shortest path of ties from `index` to each keyframe, by breadth-first search."""
        tied: dict[int, set[int]] = {}
        for ties in self._ties.values():
            for tie in ties:
                tied.setdefault(tie.host, set()).add(tie.observer)
                tied.setdefault(tie.observer, set()).add(tie.host)
        steps, edge = {index: 0}, {index}
        while edge:
            count = steps[next(iter(edge))] + 1
            edge = {near for far in edge for near in tied.get(far, ()) if near not in steps}
            steps.update(dict.fromkeys(edge, count))
        return steps

    def move(self, homographies: Mapping[int, FloatArray]) -> None:
        """Takes over adjusted homographies."""
        self.homographies.update(
            (index, matrix) for index, matrix in homographies.items() if index in self.homographies
        )

    def forget(self, most: int, needed: Collection[int]) -> None:
        """Drops the oldest twentieth of the homographies where there are more than `most`.

        Keyframes in `needed` and those with ties are kept.
        """
        if len(self.homographies) <= most:
            return
        tied = {tie.host for ties in self._ties.values() for tie in ties} | self._ties.keys() | set(needed)
        free = [index for index in self.homographies if index not in tied]
        for index in free[: max(1, most // 20)]:
            del self.homographies[index], self.planes[index]

    def rebase(self, change: FloatArray, plane: int, number: int) -> None:
        """Moves every keyframe of a plane to the plane `number`, which may exist; `change`: old to new."""
        for index, own in self.planes.items():
            if own == plane:
                self.homographies[index] = normalised(change @ self.homographies[index])
                self.planes[index] = number
        self.added[number] += self.added.pop(plane, 0)

    def problem(self, free: Collection[int], references: Collection[int]) -> Problem | None:
        """The adjustment of some keyframes, except the references; those they are tied to are fixed.

        None where nothing can move.
        """
        wanted = set(free)
        ties = [
            tie
            for ties in self._ties.values()
            for tie in ties
            if tie.observer in wanted or tie.host in wanted
        ]
        if not ties:
            return None
        indices = tuple(sorted({tie.observer for tie in ties} | {tie.host for tie in ties}))
        fixed = np.array([index not in wanted or index in references for index in indices])
        planes = np.array([self.planes[index] for index in indices])
        for plane in np.unique(planes):
            own = np.flatnonzero(planes == plane)
            fixed[own[0]] |= not fixed[own].any()
        if fixed.all():
            return None
        number = {index: camera for camera, index in enumerate(indices)}
        keys, cameras, observed = _observations(ties, number)
        unique, first, point_index = np.unique(keys, return_index=True, return_inverse=True)
        to_plane = np.array([self.homographies[index] for index in indices])
        points = np.empty((len(unique), 2))
        hosts = cameras[first]
        for camera in np.unique(hosts):
            own = hosts == camera
            points[own] = project(to_plane[camera], observed[first[own]])
        matrices = np.array([inverse(matrix) for matrix in to_plane])
        return PlaneProblem(matrices, points, cameras, point_index.astype(np.int64), observed, fixed), indices


def _observations(
    ties: Sequence[Tie], number: Mapping[int, int]
) -> tuple[IndexArray, IndexArray, FloatArray]:
    """Point, camera and position of each observation; those of the hosts come first."""
    keys = np.concatenate([tie.host * _PATCHES + tie.patches for tie in ties])
    host_points = np.concatenate([tie.host_points for tie in ties])
    hosts = np.concatenate([np.full(len(tie.patches), number[tie.host]) for tie in ties])
    observers = np.concatenate([np.full(len(tie.patches), number[tie.observer]) for tie in ties])
    points = np.concatenate([tie.points for tie in ties])
    own, once = np.unique(keys, return_index=True)
    return (
        np.concatenate([own, keys]),
        np.concatenate([hosts[once], observers]).astype(np.int64),
        np.concatenate([host_points[once], points]),
    )


def adjusted_homographies(
    found: Problem, settings: AdjustmentSettings
) -> tuple[dict[int, FloatArray], float]:
    """Homographies of the free keyframes, without degenerate ones, and the rms residual, px."""
    problem, indices = found
    result = adjust(problem, settings)
    homographies = {}
    for camera, index in enumerate(indices):
        matrix = inverse(result.cameras[camera])
        if not problem.fixed[camera] and 0 < scale_change(matrix, (720, 1280)) < _MAX_SCALE:
            homographies[index] = matrix
    return homographies, result.rmse
