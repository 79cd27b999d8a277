"""The block-sparse normal equations and their solution by the Schur complement."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.linalg
import scipy.sparse
import scipy.sparse.linalg

from streamkit_stitcher.bundle_adjustment.problem import Layout
from streamkit_stitcher.bundle_adjustment.projection import Linearised
from streamkit_stitcher.homographies import FloatArray

_DENSE_LIMIT: Final = 1000
_SMALLEST_PIVOT: Final = 1e-12


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Sums over the observations of one linearisation.

    Attributes:
        camera_blocks: float64[f, c, c], of each free camera (U).
        camera_sides: float64[f, c].
        point_blocks: float64[m, 3], xx xy yy of each point's 2 x 2 block (V).
        point_sides: float64[m, 2].
        linearised: the observations behind them, grouped by point.
    """

    camera_blocks: FloatArray
    camera_sides: FloatArray
    point_blocks: FloatArray
    point_sides: FloatArray
    linearised: Linearised


def form(linearised: Linearised, layout: Layout) -> NormalEquations:
    """Sums the blocks of the normal equations; `linearised` is grouped by point."""
    residuals = linearised.residuals
    point_blocks, point_sides = _point_sums(residuals, linearised.point, layout)
    size = linearised.camera.shape[2]
    rows = linearised.camera[layout.by_camera].reshape(-1, size)
    wanted = residuals[layout.by_camera].reshape(-1)
    blocks = np.empty((len(layout.free), size, size))
    camera_sides = np.empty((len(layout.free), size))
    bounds = (2 * layout.camera_bounds).tolist()
    for camera in range(len(layout.free)):
        own = rows[bounds[camera] : bounds[camera + 1]]
        blocks[camera] = own.T @ own
        camera_sides[camera] = own.T @ wanted[bounds[camera] : bounds[camera + 1]]
    return NormalEquations(
        blocks,
        camera_sides,
        point_blocks,
        point_sides,
        linearised,
    )


def point_steps(residuals: FloatArray, slopes: FloatArray, layout: Layout) -> FloatArray:
    """float64[m, 2], the step of each point that suits its observations best while the cameras hold still.

    Args:
        residuals: float64[k, 2], weighted, grouped by point.
        slopes: float64[k, 2, 2], weighted derivatives of the projections by the points.
        layout: the order of the observations.
    """
    blocks, sides = _point_sums(residuals, slopes, layout)
    factor = _inverse_factor(blocks, 0.0)
    return np.asarray(
        (factor @ (factor.transpose(0, 2, 1) @ sides[:, :, np.newaxis]))[:, :, 0], dtype=np.float64
    )


def _point_sums(residuals: FloatArray, slopes: FloatArray, layout: Layout) -> tuple[FloatArray, FloatArray]:
    across, down = slopes[:, :, 0], slopes[:, :, 1]
    products = np.stack(
        [
            (across * across).sum(axis=1),
            (across * down).sum(axis=1),
            (down * down).sum(axis=1),
            (across * residuals).sum(axis=1),
            (down * residuals).sum(axis=1),
        ],
        axis=1,
    )
    sums = np.add.reduceat(products, layout.point_starts, axis=0)
    return sums[:, :3], sums[:, 3:]


def solve(equations: NormalEquations, layout: Layout, damping: float) -> tuple[FloatArray, FloatArray]:
    """One damped step: cameras first, with the points eliminated, then the points.

    Args:
        equations: the normal equations.
        layout: the order of the observations.
        damping: added to the diagonal, times the diagonal.

    Returns:
        float64[f, c] changes of the free cameras' parameters and float64[m, 2] of the points.

    Raises:
        numpy.linalg.LinAlgError: the reduced system is not positive definite at this damping.

    Source: Lourakis and Argyros, SBA, ACM TOMS 36 (2009), section 3; Triggs et al., Bundle adjustment, a
    modern synthesis, 2000, section 6.1.
    """
    factor = _inverse_factor(equations.point_blocks, damping)
    camera, point = equations.linearised.camera, equations.linearised.point
    # W V^-1 W' is Z Z' with Z = W L and V^-1 = L L'; rows of `reduced` are those of Z' for each observation.
    scaled = point @ factor[layout.group_of]
    reduced = scaled.transpose(0, 2, 1) @ camera
    sides = np.einsum("mij,mi->mj", factor, equations.point_sides)
    system, wanted = _reduced_system(equations, layout, reduced, sides, damping)
    cameras = system.solve(wanted).reshape(wanted.shape[0] // camera.shape[2], camera.shape[2])
    moved = np.zeros((len(layout.order), 2))
    own = layout.by_camera
    step = np.repeat(cameras, np.diff(layout.camera_bounds), axis=0)
    moved[own] = np.einsum("kij,kj->ki", reduced[own], step)
    rest = sides - np.add.reduceat(moved, layout.point_starts, axis=0)
    return cameras, np.einsum("mij,mj->mi", factor, rest)


def _inverse_factor(blocks: FloatArray, damping: float) -> FloatArray:
    """float64[m, 2, 2], L with L L' the inverse of each damped 2 x 2 block."""
    a, b, c = blocks.T
    a, c = a * (1 + damping) + _SMALLEST_PIVOT, c * (1 + damping) + _SMALLEST_PIVOT
    first = np.sqrt(a)
    second = np.sqrt(np.maximum(c - b * b / a, _SMALLEST_PIVOT))
    factor = np.zeros((len(blocks), 2, 2))
    factor[:, 0, 0] = 1 / first
    factor[:, 0, 1] = -b / (a * second)
    factor[:, 1, 1] = 1 / second
    return factor


class _DenseSystem:
    """Symmetric positive definite blocks in one matrix, solved by Cholesky."""

    def __init__(self, count: int, size: int) -> None:
        self._matrix = np.zeros((count, size, count, size))

    def put(self, row: int, column: int, block: FloatArray) -> None:
        self._matrix[row, :, column] = block

    def solve(self, wanted: FloatArray) -> FloatArray:
        side = len(wanted)
        factor = scipy.linalg.cho_factor(
            self._matrix.reshape(side, side), lower=False, overwrite_a=True, check_finite=False
        )
        return np.asarray(scipy.linalg.cho_solve(factor, wanted, check_finite=False))


class _SparseSystem:
    """The same for many cameras: only blocks of cameras that share points are kept."""

    def __init__(self, count: int, size: int) -> None:
        self._side, self._size = count * size, size
        self._rows: list[int] = []
        self._columns: list[int] = []
        self._blocks: list[FloatArray] = []

    def put(self, row: int, column: int, block: FloatArray) -> None:
        for place, other, values in ((row, column, block), (column, row, block.T))[: 1 + (row != column)]:
            self._rows.append(place)
            self._columns.append(other)
            self._blocks.append(values)

    def solve(self, wanted: FloatArray) -> FloatArray:
        inside = np.arange(self._size)
        rows = np.array(self._rows)[:, np.newaxis, np.newaxis] * self._size + inside[:, np.newaxis]
        columns = np.array(self._columns)[:, np.newaxis, np.newaxis] * self._size + inside
        shape = (len(self._rows), self._size, self._size)
        matrix = scipy.sparse.csc_array(
            (
                np.array(self._blocks).ravel(),
                (np.broadcast_to(rows, shape).ravel(), np.broadcast_to(columns, shape).ravel()),
            ),
            shape=(self._side, self._side),
        )
        try:
            solved = scipy.sparse.linalg.splu(matrix, options={"SymmetricMode": True}).solve(wanted)
        except RuntimeError as error:
            raise np.linalg.LinAlgError(str(error)) from error
        return np.asarray(solved)


def _reduced_system(
    equations: NormalEquations, layout: Layout, reduced: FloatArray, sides: FloatArray, damping: float
) -> tuple[_DenseSystem | _SparseSystem, FloatArray]:
    """The cameras' system S = U - Z Z' and its right-hand side."""
    count, size = equations.camera_sides.shape
    kind = _DenseSystem if count * size <= _DENSE_LIMIT else _SparseSystem
    system = kind(count, size)
    rows = reduced[layout.by_camera].reshape(-1, size)
    taken = sides[layout.group_of[layout.by_camera]].reshape(-1)
    wanted = equations.camera_sides.copy()
    bounds = (2 * layout.camera_bounds).tolist()
    diagonal = np.arange(size)
    for camera in range(count):
        own = rows[bounds[camera] : bounds[camera + 1]]
        block = equations.camera_blocks[camera] - own.T @ own
        block[diagonal, diagonal] += damping * equations.camera_blocks[camera, diagonal, diagonal]
        system.put(camera, camera, block)
        wanted[camera] -= own.T @ taken[bounds[camera] : bounds[camera + 1]]
    first, second = reduced[layout.first].reshape(-1, size), reduced[layout.second].reshape(-1, size)
    bounds = (2 * layout.pair_bounds).tolist()
    for pair, (row, column) in enumerate(layout.pair_cameras.tolist()):
        inside = slice(bounds[pair], bounds[pair + 1])
        system.put(row, column, -(first[inside].T @ second[inside]))
    return system, wanted.ravel()
