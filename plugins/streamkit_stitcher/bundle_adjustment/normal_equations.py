"""The block-sparse normal equations and their solution by the Schur complement."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
import scipy

from streamkit.geometry.homography import FloatArray
from streamkit_stitcher.bundle_adjustment.problem import IndexArray, Layout
from streamkit_stitcher.bundle_adjustment.projection import ProjectedObservations

_DENSE_LIMIT: Final = 1000
_SMALLEST_PIVOT: Final = 1e-12
_ELEMENTS: Final = 8


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """The normal equations of one linearisation.

    Attributes:
        camera_blocks: float64[f, 8, 8], of each free camera's matrix elements (U).
        camera_sides: float64[f, 8], right-hand sides.
        point_blocks: float64[3, m], xx xy yy of each point's 2 x 2 block (V).
        point_sides: float64[2, m], right-hand sides.
        views: the observations, in the layout's order.
        slopes: float64[2, 2, k], their derivatives by the points.
    """

    camera_blocks: FloatArray
    camera_sides: FloatArray
    point_blocks: FloatArray
    point_sides: FloatArray
    views: ProjectedObservations
    slopes: FloatArray


def form(views: ProjectedObservations, layout: Layout) -> NormalEquations:
    """Sums the blocks of the normal equations over observations in the layout's order."""
    slopes = views.slopes()
    point_blocks, point_sides = _point_sums(views.residuals, slopes, layout)
    scale = views.scale
    each = np.zeros((2, 2, len(scale)))
    each[0, 0] = each[1, 1] = scale
    rows = _camera_rows(views, layout, each)
    rows[:, :, _ELEMENTS] = views.residuals[:, : len(rows)].T
    sums = _sums_by_camera(rows, layout)
    blocks, sides = sums[:, :_ELEMENTS, :_ELEMENTS], sums[:, :_ELEMENTS, _ELEMENTS]
    return NormalEquations(blocks, sides, point_blocks, point_sides, views, slopes)


def point_steps(views: ProjectedObservations, layout: Layout) -> FloatArray:
    """float64[2, m], the best step of each point while the cameras are fixed."""
    blocks, sides = _point_sums(views.residuals, views.slopes(), layout)
    factor = _inverse_factor(blocks, 0.0)
    return _unwhitened(factor, _whitened(factor, sides))


def solve(
    equations: NormalEquations, layout: Layout, basis: FloatArray, damping: float
) -> tuple[FloatArray, FloatArray]:
    """One damped step by the Schur complement: cameras first, then points.

    `basis` float64[8, c] maps a camera's free parameters to its matrix elements; `damping` is the factor of
    the diagonal that is added to it.

    Returns:
        float64[f, 8] changes of the free cameras' elements and float64[2, m] of the points.

    Raises:
        numpy.linalg.LinAlgError: the reduced system is not positive definite at this damping.

    Source: Lourakis and Argyros, SBA, ACM TOMS 36 (2009), section 3; Triggs et al., Bundle adjustment, a
    modern synthesis, 2000, section 6.1.
    """
    factor = _inverse_factor(equations.point_blocks, damping)
    sides = _whitened(factor, equations.point_sides)
    # W V^-1 W' is Z Z' with Z = W L and V^-1 = L L'; `rows` are those of Z' for each observation.
    rows = _camera_rows(equations.views, layout, _whitened_slopes(factor[:, layout.point], equations))
    rows[:, :, _ELEMENTS] = sides[:, layout.point[: len(rows)]].T
    own = _sums_by_camera(rows, layout)
    diagonal = equations.camera_blocks - own[:, :_ELEMENTS, :_ELEMENTS]
    inside = np.arange(_ELEMENTS)
    diagonal[:, inside, inside] += damping * equations.camera_blocks[:, inside, inside]
    wanted = equations.camera_sides - own[:, :_ELEMENTS, _ELEMENTS]
    others = _sums_by_pair(rows, layout)
    if basis.shape[1] != _ELEMENTS:
        diagonal, others = (basis.T @ blocks @ basis for blocks in (diagonal, others))
        wanted = wanted @ basis
    solver = _solve_dense if wanted.size <= _DENSE_LIMIT else _solve_sparse
    cameras = solver(diagonal, others, layout.pair_cameras, wanted) @ basis.T
    moved = np.empty((2, len(rows)))
    bounds = layout.camera_bounds.tolist()
    for camera, step in enumerate(cameras):
        part = slice(bounds[camera], bounds[camera + 1])
        moved[:, part] = (rows[part, :, :_ELEMENTS] @ step).T
    point = layout.point[: len(rows)]
    for row in range(2):
        sides[row] -= np.bincount(point, weights=moved[row], minlength=layout.points)
    return cameras, _unwhitened(factor, sides)


def _camera_rows(views: ProjectedObservations, layout: Layout, mixture: FloatArray) -> FloatArray:
    """Mixed derivatives of x and y by the free cameras' elements, float64[k', 2, 9], the last column not set.

    `mixture` float64[2, 2, k] holds the weights of x and y in each of the two rows, divided by the depth.
    """
    count = int(layout.camera_bounds[-1])
    x, y = views.points[:, :count]
    seen_x, seen_y = views.projected[:, :count]
    rows = np.empty((count, 2, _ELEMENTS + 1))
    for row, (across, down) in enumerate(mixture[:, :, :count]):
        own = rows[:, row].T
        depth = across * seen_x
        depth += down * seen_y
        np.negative(depth, out=depth)
        for start, share in ((0, across), (3, down)):
            np.multiply(share, x, out=own[start])
            np.multiply(share, y, out=own[start + 1])
            own[start + 2] = share
        np.multiply(depth, x, out=own[6])
        np.multiply(depth, y, out=own[7])
    return rows


def _sums_by_camera(rows: FloatArray, layout: Layout) -> FloatArray:
    """float64[f, 9, 9], the products of the rows of each free camera."""
    sums = np.empty((len(layout.free), _ELEMENTS + 1, _ELEMENTS + 1))
    flat = rows.reshape(-1, _ELEMENTS + 1)
    bounds = (2 * layout.camera_bounds).tolist()
    for camera in range(len(sums)):
        own = flat[bounds[camera] : bounds[camera + 1]]
        np.matmul(own.T, own, out=sums[camera])
    return sums


def _sums_by_pair(rows: FloatArray, layout: Layout) -> FloatArray:
    """float64[q, 8, 8], the negative products of the rows of each pair of cameras that share points."""
    sums = np.empty((len(layout.pair_cameras), _ELEMENTS + 1, _ELEMENTS + 1))
    first = rows[layout.first].reshape(-1, _ELEMENTS + 1)
    second = rows[layout.second].reshape(-1, _ELEMENTS + 1)
    bounds = (2 * layout.pair_bounds).tolist()
    for pair, (start, end) in enumerate(pairwise(bounds)):
        np.matmul(first[start:end].T, second[start:end], out=sums[pair])
    return -sums[:, :_ELEMENTS, :_ELEMENTS]


def _point_sums(residuals: FloatArray, slopes: FloatArray, layout: Layout) -> tuple[FloatArray, FloatArray]:
    """The points' blocks, float64[3, m], and right-hand sides, float64[2, m]."""
    across, down = slopes[:, 0], slopes[:, 1]
    sums = np.empty((5, layout.points))
    pairs = (across, across), (across, down), (down, down), (across, residuals), (down, residuals)
    for row, (one, other) in enumerate(pairs):
        products = one[0] * other[0]
        products += one[1] * other[1]
        sums[row] = np.bincount(layout.point, weights=products, minlength=layout.points)
    return sums[:3], sums[3:]


def _inverse_factor(blocks: FloatArray, damping: float) -> FloatArray:
    """The upper triangle, float64[3, m], of L with L L' the inverse of each damped 2 x 2 block."""
    a, b, c = blocks
    a, c = a * (1 + damping) + _SMALLEST_PIVOT, c * (1 + damping) + _SMALLEST_PIVOT
    factor = np.empty_like(blocks)
    np.divide(1, np.sqrt(a), out=factor[0])
    np.divide(1, np.sqrt(np.maximum(c - b * b / a, _SMALLEST_PIVOT)), out=factor[2])
    np.multiply(-b / a, factor[2], out=factor[1])
    return factor


def _whitened(factor: FloatArray, sides: FloatArray) -> FloatArray:
    """L' times each right-hand side, float64[2, m]."""
    return np.stack([factor[0] * sides[0], factor[1] * sides[0] + factor[2] * sides[1]])


def _unwhitened(factor: FloatArray, sides: FloatArray) -> FloatArray:
    """L times each right-hand side, float64[2, m]."""
    return np.stack([factor[0] * sides[0] + factor[1] * sides[1], factor[2] * sides[1]])


def _whitened_slopes(factor: FloatArray, equations: NormalEquations) -> FloatArray:
    """float64[2, 2, k], the mixture for the rows of Z'; `factor` is L of each observation's point."""
    first, second, third = factor * equations.views.scale
    across, down = equations.slopes[:, 0], equations.slopes[:, 1]
    return np.stack([across * first, across * second + down * third])


def _solve_dense(
    diagonal: FloatArray, others: FloatArray, pairs: IndexArray, wanted: FloatArray
) -> FloatArray:
    """The cameras' steps, float64[f, c], by Cholesky; `others` are above the diagonal."""
    count, size = wanted.shape
    matrix = np.zeros((count, size, count, size))
    inside = np.arange(count)
    matrix[inside, :, inside] = diagonal
    matrix[pairs[:, 0], :, pairs[:, 1]] = others
    # The upper triangle in row order is the lower one in LAPACK's column order.
    _, solved, failed = scipy.linalg.lapack.dposv(
        matrix.reshape(count * size, -1).T, wanted.ravel(), lower=1, overwrite_a=1
    )
    if failed:
        raise np.linalg.LinAlgError(f"the reduced camera system is not positive definite ({failed})")
    return np.asarray(solved, dtype=np.float64).reshape(count, size)


def _solve_sparse(
    diagonal: FloatArray, others: FloatArray, pairs: IndexArray, wanted: FloatArray
) -> FloatArray:
    """The same for many cameras, with the blocks of cameras that share points only."""
    count, size = wanted.shape
    blocks = np.concatenate([diagonal, others, others.transpose(0, 2, 1)])
    inside = np.arange(count)
    rows = np.concatenate([inside, pairs[:, 0], pairs[:, 1]])
    columns = np.concatenate([inside, pairs[:, 1], pairs[:, 0]])
    element = np.arange(size)
    matrix = scipy.sparse.csc_array(
        (
            blocks.ravel(),
            (
                np.broadcast_to((rows * size)[:, None, None] + element[:, None], blocks.shape).ravel(),
                np.broadcast_to((columns * size)[:, None, None] + element, blocks.shape).ravel(),
            ),
        ),
        shape=(count * size, count * size),
    )
    try:
        solved = scipy.sparse.linalg.splu(matrix, options={"SymmetricMode": True}).solve(wanted.ravel())
    except RuntimeError as error:
        raise np.linalg.LinAlgError(str(error)) from error
    return np.asarray(solved, dtype=np.float64).reshape(count, size)
