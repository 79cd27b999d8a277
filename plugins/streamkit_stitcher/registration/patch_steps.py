"""Compiled joint alignment: Gauss-Newton steps of a homography over all patches of a keyframe.

Common arguments: `centres` float64[n, 2], px of the keyframe; `scaling` float64[3], centre x y and size of
normalised coordinates; `parameters` float64[8], of a step in these; `probes` float32[m, 3, 225], `numbers`
int64[n] and `usable` bool[n], see `PatchLevel`. Results go into arrays of the caller. Loops assign single
elements: assigning an array to a slice takes the compiler seconds, for messages about shapes.
"""

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt
from numba import types

from streamkit.geometry.homography import FloatArray, GreyArray, MaskArray
from streamkit_kernels import BOOL_1D, FLOAT64, FLOAT64_1D, INT64_1D, UINT8_READONLY, compiled, kernel
from streamkit_stitcher.registration.patch_comparison import probe
from streamkit_stitcher.registration.patches import MIN_STD, OFF_PLANE

_SingleArray = npt.NDArray[np.float32]
_PATCHES = types.Array(types.float32, 3, "C")
_MATRICES = types.Array(types.float64, 3, "C")
# Common shift of the patches, px, that is taken before any other motion, and the displacement that is none.
_FAR: Final = 1.0
_WILD: Final = 10.0
# Patches within this distance of the common shift, px, are never off the plane.
_CLOSE: Final = 0.3
_FEWEST: Final = 10
_MIN_COARSE_CORRELATION: Final = 0.2
_MIN_CORRELATION: Final = 0.6
_MAX_CONDITION: Final = 1e14


@kernel(UINT8_READONLY, FLOAT64, _PATCHES, INT64_1D, BOOL_1D, FLOAT64_1D, types.int64, types.float64, FLOAT64)
def settle(
    image: GreyArray,
    centres: FloatArray,
    probes: _SingleArray,
    numbers: npt.NDArray[np.int64],
    usable: MaskArray,
    scaling: FloatArray,
    passes: int,
    settled: float,
    matrix: FloatArray,
) -> bool:
    """Improves a motion from keyframe to image until it converges; returns whether it has.

    `passes` is the maximum of iterations; `settled` the largest last displacement of a patch, px.
    """
    count = len(centres)
    products, seen = np.empty((3, count)), np.empty(count, np.bool_)
    valid, near, moves = np.empty(count, np.bool_), np.empty(count, np.bool_), np.empty((2, count))
    squares, information = np.empty(count), np.zeros((3, count))
    normal, parameters = np.empty((8, 8)), np.empty(8)
    for _ in range(passes):
        visible = probe(image, centres, probes, numbers, usable, matrix, products, seen)
        if _above(products, seen, _MIN_COARSE_CORRELATION, valid) < max(_FEWEST, visible // 3):
            return False
        x, y = _together(products, valid, near, squares)
        far = np.sqrt(x * x + y * y)
        if far > _FAR:
            parameters[:] = 0.0
            parameters[2], parameters[5] = x / scaling[2], y / scaling[2]
        else:
            for patch in range(count):
                weight = products[2, patch] if near[patch] else 0.0
                information[0, patch] = information[2, patch] = weight
            if not solve(centres, scaling, products, information, normal, parameters):
                return False
            far = displace(centres, scaling, parameters, seen, moves)
        if far > _WILD:
            return False
        compose(matrix, scaling, parameters)
        if far < settled:
            return True
    return False


class JointStep(NamedTuple):
    """One step of the motion over all n patches of a keyframe, and what is left after it.

    Attributes:
        size: largest displacement of a patch in view, px; infinite where no step was found.
        visible_count: number of patches in view.
        variance: of a position relative to its covariance.
        residuals: float64[2, n], shift of each patch after the step, x and y, px of the keyframe.
        information: float64[3, n], inverse covariance of each position, x x, x y, y y, 1 / px^2.
        normal: float64[8, 8], normal matrix of the step.
        correlated: bool[n], patches in view that look like the frame.
        on_plane: bool[n], of these the ones that the step explains to within their covariances.
    """

    size: float
    visible_count: int
    variance: float
    residuals: FloatArray
    information: FloatArray
    normal: FloatArray
    correlated: MaskArray
    on_plane: MaskArray


@kernel(UINT8_READONLY, FLOAT64, _PATCHES, INT64_1D, BOOL_1D, _MATRICES, FLOAT64_1D, FLOAT64)
def improve(
    image: GreyArray,
    centres: FloatArray,
    probes: _SingleArray,
    numbers: npt.NDArray[np.int64],
    usable: MaskArray,
    inverse_hessian: FloatArray,
    scaling: FloatArray,
    matrix: FloatArray,
) -> JointStep:
    """One step of the motion that minimises all differences, weighted by each patch's covariance.

    Two fits: the first, in which all patches have about equal weights, finds the patches off the plane; the
    second is of those on it. `matrix`, the motion, takes the step; without one (too few patches correlate, or
    they leave it undetermined) it stays.
    """
    count = len(centres)
    products, seen = np.empty((3, count)), np.empty(count, np.bool_)
    correlated, on_plane = np.empty(count, np.bool_), np.empty(count, np.bool_)
    information, weights, squares = np.empty((3, count)), np.empty((3, count)), np.empty(count)
    normal, parameters, moves = np.empty((8, 8)), np.empty(8), np.empty((2, count))
    size, variance = np.inf, 0.0
    visible_count = probe(image, centres, probes, numbers, usable, matrix, products, seen)
    found = _above(products, seen, _MIN_CORRELATION, correlated) >= max(_FEWEST, visible_count // 3)
    if found:
        _inform(products, inverse_hessian, information)
        _together(products, correlated, on_plane, squares)
        _weigh_alike(information, correlated, on_plane, weights)
        found = solve(centres, scaling, products, weights, normal, parameters)
    if found:
        displace(centres, scaling, parameters, seen, moves)
        _weighted_squares(products, moves, information, squares)
        _find_on_plane(squares, correlated, on_plane)
        _weigh_by_covariance(information, on_plane, weights)
        found = solve(centres, scaling, products, weights, normal, parameters)
    if found:
        size = displace(centres, scaling, parameters, seen, moves)
        compose(matrix, scaling, parameters)
        _weighted_squares(products, moves, information, squares)
        variance = _mean_square(squares, on_plane)
        for patch in range(count):
            products[0, patch] -= moves[0, patch]
            products[1, patch] -= moves[1, patch]
    return JointStep(size, visible_count, variance, products[:2], information, normal, correlated, on_plane)


@compiled
def _weigh_alike(
    information: FloatArray, correlated: MaskArray, near: MaskArray, weights: FloatArray
) -> None:
    """About equal weights, alike in all directions, of the patches `near` the common shift."""
    count = len(near)
    strengths = np.empty(count)
    for patch in range(count):
        xx, xy, yy = information[0, patch], information[1, patch], information[2, patch]
        strengths[patch] = (xx * yy - xy * xy) / (xx + yy)
    most = _median(strengths, correlated)
    for patch in range(count):
        weights[0, patch] = weights[2, patch] = min(strengths[patch], most) if near[patch] else 0.0
        weights[1, patch] = 0.0


@compiled
def _find_on_plane(squares: FloatArray, correlated: MaskArray, on_plane: MaskArray) -> None:
    """Chooses the correlated patches whose squared residual is below a multiple of the median."""
    bound = OFF_PLANE * _median(squares, correlated)
    for patch in range(len(squares)):
        on_plane[patch] = correlated[patch] and squares[patch] < bound


@compiled
def _weigh_by_covariance(information: FloatArray, on_plane: MaskArray, weights: FloatArray) -> None:
    """Weights of the patches on the plane: their inverse covariances."""
    for patch in range(len(on_plane)):
        for row in range(3):
            weights[row, patch] = information[row, patch] if on_plane[patch] else 0.0


@compiled
def _mean_square(squares: FloatArray, on_plane: MaskArray) -> float:
    """The squared residuals on the plane over their degrees of freedom less those of the step."""
    total, freedom = 0.0, -8
    for patch in range(len(squares)):
        if on_plane[patch]:
            total += squares[patch]
            freedom += 2
    return total / max(1, freedom)


@compiled
def _median(values: FloatArray, chosen: MaskArray) -> float:
    """The median of chosen values, of which there is at least one."""
    part = np.sort(values[chosen])
    return float(part[len(part) // 2])


@compiled
def _together(
    shift: FloatArray, chosen: MaskArray, near: MaskArray, squares: FloatArray
) -> tuple[float, float]:
    """The median shift of chosen patches; `near` are those with about that shift."""
    x, y = _median(shift[0], chosen), _median(shift[1], chosen)
    for patch in range(len(chosen)):
        squares[patch] = (shift[0, patch] - x) ** 2 + (shift[1, patch] - y) ** 2
    bound = max(OFF_PLANE * _median(squares, chosen), _CLOSE**2)
    for patch in range(len(chosen)):
        near[patch] = chosen[patch] and squares[patch] <= bound
    return x, y


@compiled
def _above(products: FloatArray, seen: MaskArray, least: float, chosen: MaskArray) -> int:
    """Chooses patches in view whose correlation is above `least`; returns their number."""
    count = 0
    for patch in range(len(seen)):
        chosen[patch] = seen[patch] and products[2, patch] > least
        count += chosen[patch]
    return count


@compiled
def _inform(products: FloatArray, inverse_hessian: FloatArray, information: FloatArray) -> None:
    """The inverse covariance of each patch's position, see `improve`."""
    for patch in range(products.shape[1]):
        # Images of unit deviation with correlation c differ by 2 - 2 c.
        noise = 2 * max(1 - products[2, patch], 1e-3)
        xx = inverse_hessian[patch, 0, 0] * noise + MIN_STD**2
        xy = inverse_hessian[patch, 0, 1] * noise
        yy = inverse_hessian[patch, 1, 1] * noise + MIN_STD**2
        determinant = xx * yy - xy * xy
        information[0, patch], information[1, patch] = yy / determinant, -xy / determinant
        information[2, patch] = xx / determinant


@compiled
def _weighted_squares(
    shift: FloatArray, moves: FloatArray, information: FloatArray, squares: FloatArray
) -> None:
    """The squared residuals after a step, in units of their deviations."""
    for patch in range(len(squares)):
        x, y = shift[0, patch] - moves[0, patch], shift[1, patch] - moves[1, patch]
        xx, xy, yy = information[0, patch], information[1, patch], information[2, patch]
        squares[patch] = (xx * x + 2 * xy * y) * x + yy * y * y


@compiled
def solve(
    centres: FloatArray,
    scaling: FloatArray,
    shift: FloatArray,
    information: FloatArray,
    normal: FloatArray,
    parameters: FloatArray,
) -> bool:
    """The homography near the identity that fits `shift`, its first two rows in px; False if degenerate.

    `information` float64[3, n] holds inverse covariances, x x, x y, y y. Results are the `normal` matrix
    float64[8, 8] and the normalised `parameters` float64[8].
    """
    sides, across, down = np.zeros(8), np.zeros(8), np.zeros(8)
    normal[:] = 0.0
    for patch in range(len(centres)):
        xx, xy, yy = information[0, patch], information[1, patch], information[2, patch]
        if xx + yy <= 0:
            continue
        _slopes(centres[patch, 0], centres[patch, 1], scaling, across, down)
        x, y = shift[0, patch], shift[1, patch]
        for row in range(8):
            from_x, from_y = xx * across[row] + xy * down[row], xy * across[row] + yy * down[row]
            sides[row] += (from_x * x + from_y * y) / scaling[2]
            for column in range(row + 1):
                normal[row, column] += from_x * across[column] + from_y * down[column]
                normal[column, row] = normal[row, column]
    return _solved(normal, sides, parameters)


@compiled
def _solved(normal: FloatArray, sides: FloatArray, parameters: FloatArray) -> bool:
    """Solves the normal equations by Gaussian elimination; False where a pivot is lost to rounding.

    A positive definite matrix needs no row exchange. LAPACK's eigenvectors take 5 us longer for eight.
    """
    table = np.empty((8, 9))
    for row in range(8):
        for column in range(8):
            table[row, column] = normal[row, column]
        table[row, 8] = sides[row]
    for pivot in range(8):
        if not table[pivot, pivot] * _MAX_CONDITION > normal[pivot, pivot]:
            return False
        for row in range(pivot + 1, 8):
            share = table[row, pivot] / table[pivot, pivot]
            for column in range(pivot, 9):
                table[row, column] -= share * table[pivot, column]
    for row in range(7, -1, -1):
        rest = table[row, 8]
        for column in range(row + 1, 8):
            rest -= table[row, column] * parameters[column]
        parameters[row] = rest / table[row, row]
    return True


@compiled
def _slopes(x: float, y: float, scaling: FloatArray, across: FloatArray, down: FloatArray) -> None:
    """Derivatives of a point's x and y by the eight parameters, in normalised coordinates."""
    x, y = (x - scaling[0]) / scaling[2], (y - scaling[1]) / scaling[2]
    across[0] = down[3] = x
    across[1] = down[4] = y
    across[2] = down[5] = 1.0
    across[6], across[7] = -x * x, -x * y
    down[6], down[7] = -x * y, -y * y


@compiled
def displace(
    centres: FloatArray, scaling: FloatArray, parameters: FloatArray, seen: MaskArray, moves: FloatArray
) -> float:
    """Displacement of each patch by a step, float64[2, n], px; returns the largest of those in view."""
    across, down, far = np.zeros(8), np.zeros(8), 0.0
    for patch in range(len(centres)):
        _slopes(centres[patch, 0], centres[patch, 1], scaling, across, down)
        x = y = 0.0
        for parameter in range(8):
            x += across[parameter] * parameters[parameter] * scaling[2]
            y += down[parameter] * parameters[parameter] * scaling[2]
        moves[0, patch], moves[1, patch] = x, y
        if seen[patch]:
            far = max(far, abs(x), abs(y))
    return far


@compiled
def compose(matrix: FloatArray, scaling: FloatArray, parameters: FloatArray) -> None:
    """Composes a motion with a step in the keyframe."""
    x, y, size = scaling[0], scaling[1], scaling[2]
    to_px = np.array([[size, 0.0, x], [0.0, size, y], [0.0, 0.0, 1.0]])
    from_px = np.array([[1 / size, 0.0, -x / size], [0.0, 1 / size, -y / size], [0.0, 0.0, 1.0]])
    step = np.eye(3)
    for parameter in range(8):
        step[parameter // 3, parameter % 3] += parameters[parameter]
    moved = matrix @ to_px @ step @ from_px
    for row in range(3):
        for column in range(3):
            matrix[row, column] = moved[row, column] / moved[2, 2]
