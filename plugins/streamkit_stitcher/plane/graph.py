"""Key pictures and the tie points between them: what a bundle adjustment is made of."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from streamkit.geometry.homography import FloatArray, inverse, normalised, project
from streamkit_stitcher.bundle_adjustment.problem import IndexArray, PlaneProblem

_PATCHES = 1 << 20


@dataclass(frozen=True, eq=False)
class Tie:
    """Patches of one key picture found in another.

    Attributes:
        host: index of the key picture that the patches are from.
        observer: index of the one they were found in.
        patches: int64[k], numbers of the patches in the host, below 2**20.
        host_points: float64[k, 2], where they lie in the host, px.
        points: float64[k, 2], where they were found, px.
        rmse: root mean square distance of the match, px.
        likeness: how much the two key pictures look alike over all the ground they share, -1 to 1.
    """

    host: int
    observer: int
    patches: IndexArray
    host_points: FloatArray
    points: FloatArray
    rmse: float = 0.0
    likeness: float = 1.0

    def thinned(self, most: int) -> "Tie":
        """At most `most` of the patches, evenly chosen."""
        if len(self.patches) <= most:
            return self
        kept = np.linspace(0, len(self.patches) - 1, most).astype(np.int64)
        return replace(
            self,
            patches=self.patches[kept],
            host_points=self.host_points[kept],
            points=self.points[kept],
        )


class KeyframeGraph:
    """The places of all key pictures of a plane, and the ties of the newest of them.

    Args:
        max_tied: key pictures whose ties are kept; older ones keep their places and are not adjusted again.
    """

    def __init__(self, max_tied: int) -> None:
        self._max_tied = max_tied
        self._taken = 0
        self._places: dict[int, FloatArray] = {}
        self._ties: dict[int, list[Tie]] = {}

    def __len__(self) -> int:
        """Key pictures that were ever added."""
        return self._taken

    @property
    def places(self) -> Mapping[int, FloatArray]:
        """float64[3, 3] of each key picture, its pixels to the reference plane."""
        return self._places

    @property
    def indices(self) -> tuple[int, ...]:
        """The key pictures, oldest first."""
        return tuple(self._places)

    @property
    def tied(self) -> tuple[int, ...]:
        """The key pictures that can still be adjusted, oldest first."""
        return tuple(self._ties)

    def add(self, index: int, place: FloatArray, ties: Sequence[Tie]) -> None:
        """Adds a key picture with its ties to earlier ones."""
        self._taken += 1
        self._places[index] = place
        self._ties[index] = list(ties)
        if len(self._ties) > self._max_tied:
            del self._ties[next(iter(self._ties))]

    def tie(self, tie: Tie) -> None:
        """Adds a tie found later, unless its key pictures are not adjusted any more."""
        if tie.observer in self._ties and tie.host in self._places:
            self._ties[tie.observer].append(tie)

    def hosts(self, index: int) -> set[int]:
        """The key pictures that `index` is tied to as the later one."""
        return {tie.host for tie in self._ties.get(index, ())}

    def steps_from(self, index: int) -> dict[int, int]:
        """Along how many ties each key picture is reached from `index`, itself in none."""
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

    def move(self, places: Mapping[int, FloatArray]) -> None:
        """Takes over adjusted places."""
        self._places.update((index, place) for index, place in places.items() if index in self._places)

    def forget(self, most: int, needed: Collection[int]) -> None:
        """Drops the oldest places, a twentieth of them at once, where there are more than `most`.

        Args:
            most: places to keep.
            needed: key pictures whose places stay, beside those that have ties.
        """
        if len(self._places) <= most:
            return
        tied = {tie.host for ties in self._ties.values() for tie in ties} | self._ties.keys() | set(needed)
        free = [index for index in self._places if index not in tied]
        for index in free[: max(1, most // 20)]:
            del self._places[index]

    def rebase(self, change: FloatArray) -> None:
        """Moves every place to another plane by float64[3, 3], old plane to new."""
        for index, place in self._places.items():
            self._places[index] = normalised(change @ place)

    def problem(self, free: Collection[int], reference: int) -> tuple[PlaneProblem, tuple[int, ...]] | None:
        """The adjustment of some key pictures while those they are tied to hold still.

        Args:
            free: the key pictures to adjust; the reference among them holds still, too.
            reference: the key picture that is the plane.

        Returns:
            The problem and the key picture of each of its cameras, or None where nothing could move.
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
        fixed = np.array([index not in wanted or index == reference for index in indices])
        if not fixed.any():
            fixed[0] = True
        if fixed.all():
            return None
        number = {index: camera for camera, index in enumerate(indices)}
        keys, cameras, observed = _observations(ties, number)
        unique, first, point_index = np.unique(keys, return_index=True, return_inverse=True)
        places = np.array([self._places[index] for index in indices])
        start = np.empty((len(unique), 2))
        hosts = cameras[first]
        for camera in np.unique(hosts):
            own = hosts == camera
            start[own] = project(places[camera], observed[first[own]])
        matrices = np.array([inverse(place) for place in places])
        return PlaneProblem(matrices, start, cameras, point_index.astype(np.int64), observed, fixed), indices


def _observations(
    ties: Sequence[Tie], number: Mapping[int, int]
) -> tuple[IndexArray, IndexArray, FloatArray]:
    """Point, camera and position of each observation; the hosts' own views come first."""
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
