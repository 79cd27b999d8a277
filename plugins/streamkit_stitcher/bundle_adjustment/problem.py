"""A bundle adjustment's input, and the order of its sums."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import FloatArray, MaskArray
from streamkit_stitcher.bundle_adjustment.lens import Lens
from streamkit_stitcher.registration.motion_models import MotionModel

IndexArray = npt.NDArray[np.int64]

_SHORT: Final = 1 << 16
_UPPER: Final = {size: np.stack(np.triu_indices(size, 1)) for size in range(2, 9)}


# Columns turn a camera's free parameters into the elements h11 h12 h13 h21 h22 h23 h31 h32.
BASES: Final[dict[MotionModel, FloatArray]] = {
    MotionModel.HOMOGRAPHY: np.eye(8),
    MotionModel.AFFINE: np.eye(8)[:, :6],
    MotionModel.SIMILARITY: np.array(
        [
            [1.0, 0, 0, 0, 1, 0, 0, 0],
            [0, -1, 0, 1, 0, 0, 0, 0],
            [0, 0, 1, 0, 0, 0, 0, 0],
            [0, 0, 0, 0, 0, 1, 0, 0],
        ]
    ).T,
}


@dataclass(frozen=True, eq=False)
class PlaneProblem:
    """Frames of a plane and their observations of its points.

    Attributes:
        cameras: float64[n, 3, 3], plane coordinates to pixels of each frame, last element 1.
        points: float64[m, 2], on the plane.
        camera_index: int64[k], the frame of each observation.
        point_index: int64[k], its point; at most one observation per frame and point.
        observed: float64[k, 2], its position in the frame, px.
        fixed: bool[n], frames that do not move: at least one, which is the gauge, unless the lens is known.
        lens: of all frames, which then see a level plane; None if unknown.
    """

    cameras: FloatArray
    points: FloatArray
    camera_index: IndexArray
    point_index: IndexArray
    observed: FloatArray
    fixed: MaskArray
    lens: Lens | None = None

    def check(self) -> None:
        """Checks sizes and indices.

        Raises:
            ValueError: sizes differ, an index is out of range, or no frame is fixed.
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
        has_gauge = self.fixed.any() or self.lens is not None
        if len(self.fixed) != len(self.cameras) or not has_gauge:
            raise ValueError(
                "fixed: one flag per camera, and at least one set: without a camera that holds still the "
                "plane may drift freely"
            )


@dataclass(frozen=True, eq=False)
class Layout:
    """Observations sorted by camera, the fixed ones last, and pairs of observations of the same point.

    Attributes:
        order: int64[k], the observations, grouped by camera and by point within a camera.
        camera: int64[k], the camera of each sorted observation.
        point: int64[k], its point.
        points: number of points.
        free: int64[f], the free cameras.
        camera_bounds: int64[f + 1], bounds of the free cameras' sorted observations.
        first: int64[p], sorted observations of pairs that share a point, free cameras only.
        second: int64[p], their partners, of a later camera.
        pair_cameras: int64[q, 2], positions in `free` of each group of pairs.
        pair_bounds: int64[q + 1], bounds of the groups in `first` and `second`.
    """

    order: IndexArray
    camera: IndexArray
    point: IndexArray
    points: int
    free: IndexArray
    camera_bounds: IndexArray
    first: IndexArray
    second: IndexArray
    pair_cameras: IndexArray
    pair_bounds: IndexArray


def layout(problem: PlaneProblem) -> Layout:
    """Sorts a problem's observations once, for all iterations."""
    free = np.flatnonzero(~problem.fixed)
    column = np.full(len(problem.fixed), len(free), dtype=np.int64)
    column[free] = np.arange(len(free))
    by_point = _sorted(problem.point_index, len(problem.points))
    order = by_point[_sorted(column[problem.camera_index[by_point]], len(free) + 1)]
    camera, point = problem.camera_index[order], problem.point_index[order]
    columns = column[camera]
    bounds = np.searchsorted(columns, np.arange(len(free) + 1))
    first, second = _pairs(point[: bounds[-1]], len(problem.points))
    key = columns[first] * len(free) + columns[second]
    grouped = _sorted(key, len(free) ** 2)
    key = key[grouped]
    heads = np.flatnonzero(np.append(True, key[1:] != key[:-1])) if len(key) else np.zeros(0, dtype=np.int64)
    return Layout(
        order,
        camera,
        point,
        len(problem.points),
        free,
        bounds,
        first[grouped],
        second[grouped],
        np.stack(np.divmod(key[heads], max(1, len(free))), axis=1),
        np.append(heads, len(key)),
    )


def _sorted(keys: IndexArray, limit: int) -> IndexArray:
    """Stable argsort of keys from 0 to below `limit`; small ones by radix sort."""
    return np.argsort(keys.astype(np.uint16) if limit <= _SHORT else keys, kind="stable")


def _pairs(point: IndexArray, count: int) -> tuple[IndexArray, IndexArray]:
    """All pairs of observations of the same point, of `count` points, the earlier observation first."""
    order = _sorted(point, count)
    sizes = np.bincount(point, minlength=count)
    starts = np.cumsum(sizes) - sizes
    firsts, seconds = [order[:0]], [order[:0]]
    for size in np.flatnonzero(np.bincount(sizes)):
        upper = _UPPER.get(int(size))
        if upper is None:
            upper = np.stack(np.triu_indices(int(size), 1))
        heads = starts[sizes == size]
        firsts.append((heads[:, np.newaxis] + upper[0]).ravel())
        seconds.append((heads[:, np.newaxis] + upper[1]).ravel())
    return order[np.concatenate(firsts)], order[np.concatenate(seconds)]
