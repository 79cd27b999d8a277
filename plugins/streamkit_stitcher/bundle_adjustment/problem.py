"""What a bundle adjustment is given, and the order in which its sums are formed."""

from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from streamkit_stitcher.homographies import FloatArray, MaskArray

IndexArray = npt.NDArray[np.int64]


class CameraModel(StrEnum):
    """What a camera's homography may be; the others hold it to fewer parameters."""

    HOMOGRAPHY = "homography"
    AFFINE = "affine"
    SIMILARITY = "similarity"


def _basis(rows: list[list[int]]) -> FloatArray:
    return np.array(rows, dtype=np.float64).T


# Columns turn a camera's free parameters into the elements h11 h12 h13 h21 h22 h23 h31 h32.
BASES: Final[dict[CameraModel, FloatArray]] = {
    CameraModel.HOMOGRAPHY: np.eye(8),
    CameraModel.AFFINE: np.eye(8)[:, :6],
    CameraModel.SIMILARITY: _basis(
        [
            [1, 0, 0, 0, 1, 0, 0, 0],
            [0, -1, 0, 1, 0, 0, 0, 0],
            [0, 0, 1, 0, 0, 0, 0, 0],
            [0, 0, 0, 0, 0, 1, 0, 0],
        ]
    ),
}


@dataclass(frozen=True, eq=False)
class PlaneProblem:
    """Pictures of a plane and the points of it that they show.

    Attributes:
        cameras: float64[n, 3, 3], from plane coordinates to pixels of each picture, last element 1.
        points: float64[m, 2], on the plane.
        camera_index: int64[k], the picture of each observation.
        point_index: int64[k], its point; at most one observation per picture and point.
        observed: float64[k, 2], where the picture shows the point, px.
        fixed: bool[n], pictures that hold still: at least one, which is the gauge.
    """

    cameras: FloatArray
    points: FloatArray
    camera_index: IndexArray
    point_index: IndexArray
    observed: FloatArray
    fixed: MaskArray

    def check(self) -> None:
        """Refuses what could not be solved.

        Raises:
            ValueError: sizes do not agree, an index points nowhere, or no picture is fixed.
        """
        count = len(self.observed)
        if not (len(self.camera_index) == len(self.point_index) == count):
            raise ValueError(
                f"observations: {count} positions need as many camera and point indices, got "
                f"{len(self.camera_index)} and {len(self.point_index)}"
            )
        for name, index, limit in (
            ("camera_index", self.camera_index, len(self.cameras)),
            ("point_index", self.point_index, len(self.points)),
        ):
            if count and not (index.min() >= 0 and index.max() < limit):
                raise ValueError(f"{name} must lie in 0 to {limit - 1}, got {index.min()} to {index.max()}")
        if len(self.fixed) != len(self.cameras) or not self.fixed.any():
            raise ValueError(
                "fixed: one flag per camera, and at least one set: without a camera that holds still the "
                "plane may drift freely"
            )


@dataclass(frozen=True, eq=False)
class Layout:
    """Observations in the order of their points, and which of them meet in a point.

    Attributes:
        order: int64[k], the observations, grouped by point.
        point_starts: int64[m], where each point's group begins in `order`.
        columns: int64[n], the number of each free camera, -1 for fixed ones.
        free: int64[f], the free cameras.
        by_camera: int64[f' <= k], sorted observations of free cameras, grouped by camera.
        camera_bounds: int64[f + 1], the groups of `by_camera`.
        first: int64[p], sorted observations of pairs that share a point, free cameras only.
        second: int64[p], their partners, of a later camera.
        pair_cameras: int64[q, 2], numbers of the free cameras of each group of pairs.
        pair_bounds: int64[q + 1], the groups of `first` and `second`.
    """

    order: IndexArray
    point_starts: IndexArray
    columns: IndexArray
    free: IndexArray
    by_camera: IndexArray
    camera_bounds: IndexArray
    first: IndexArray
    second: IndexArray
    pair_cameras: IndexArray
    pair_bounds: IndexArray

    @cached_property
    def group_of(self) -> IndexArray:
        """int64[k], the point of each sorted observation."""
        ends = np.append(self.point_starts[1:], len(self.order))
        return np.repeat(np.arange(len(self.point_starts)), ends - self.point_starts)


def layout(problem: PlaneProblem) -> Layout:
    """Sorts a problem's observations once, for all iterations; every point must have one at least."""
    order = np.lexsort((problem.camera_index, problem.point_index))
    points, cameras = problem.point_index[order], problem.camera_index[order]
    starts = np.flatnonzero(np.append(True, points[1:] != points[:-1]))
    free = np.flatnonzero(~problem.fixed)
    columns = np.full(len(problem.fixed), -1, dtype=np.int64)
    columns[free] = np.arange(len(free))
    column = columns[cameras]
    by_camera = np.argsort(column, kind="stable")
    by_camera = by_camera[np.searchsorted(column[by_camera], 0) :]
    camera_bounds = np.searchsorted(column[by_camera], np.arange(len(free) + 1))
    first, second = _pairs(np.diff(np.append(starts, len(order))), starts)
    kept = (column[first] >= 0) & (column[second] >= 0)
    first, second = first[kept], second[kept]
    key = column[first] * max(1, len(free)) + column[second]
    grouped = np.argsort(key, kind="stable")
    key = key[grouped]
    heads = np.flatnonzero(np.append(True, key[1:] != key[:-1])) if len(key) else np.zeros(0, dtype=np.int64)
    return Layout(
        order,
        starts,
        columns,
        free,
        by_camera,
        camera_bounds,
        first[grouped],
        second[grouped],
        np.stack([key[heads] // max(1, len(free)), key[heads] % max(1, len(free))], axis=1),
        np.append(heads, len(key)),
    )


def _pairs(sizes: IndexArray, starts: IndexArray) -> tuple[IndexArray, IndexArray]:
    """All pairs of members of each group, the earlier member first."""
    firsts, seconds = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for size in np.unique(sizes):
        upper = np.stack(np.triu_indices(int(size), 1))
        heads = starts[sizes == size]
        firsts.append((heads[:, np.newaxis] + upper[0]).ravel())
        seconds.append((heads[:, np.newaxis] + upper[1]).ravel())
    return np.concatenate(firsts), np.concatenate(seconds)
