"""Compiled loops of joint alignment: Gauss-Newton steps of a homography over all patches of a keyframe.

Common arguments: `centres` float64[n, 2], px of the keyframe; `scaling` float64[3], centre x y and size of
normalised coordinates; `probes` float32[n, 3, 225], see `PatchLevel`; `usable` bool[n]. Results go into
arrays of the caller. All kernels are in this module, as numba's cache misses changes elsewhere.
"""

from typing import Final

import numpy as np
import numpy.typing as npt
from numba import types

from streamkit.geometry.homography import FloatArray, GreyArray, MaskArray
from streamkit_kernels import FLAGS, INPUT, TABLE, compiled, kernel
from streamkit_stitcher.registration.patches import RADIUS

_SingleArray = npt.NDArray[np.float32]
_PATCHES = types.Array(types.float32, 3, "C")
_MATRICES = types.Array(types.float64, 3, "C")
_VALUES = types.Array(types.float64, 1, "C")
_SIDE: Final = 2 * RADIUS + 1
_PIXELS: Final = _SIDE**2
_MARGIN: Final = RADIUS + 3
_ONE: Final = 65536
_FAR: Final = 1.0
_FEWEST: Final = 10
_MIN_COARSE_CORRELATION: Final = 0.2
_MIN_CORRELATION: Final = 0.6
_TRIM: Final = 9.0
_WILD: Final = 10.0
_CLOSE: Final = 0.3
# Smallest deviation of a patch, px: lens, shutter and terrain do not quite follow a plane's homography.
_FLOOR: Final = 0.04
_SMALLEST_PIVOT: Final = 2.3e-16


@compiled
def probe(
    image: GreyArray,
    centres: FloatArray,
    probes: _SingleArray,
    usable: MaskArray,
    matrix: FloatArray,
    products: FloatArray,
    seen: MaskArray,
) -> int:
    """One Gauss-Newton step of each patch from its position under a motion.

    Each is compared with the image resampled bilinearly through the homography's local affine part. Results:
    `products` float64[3, n], shift in x and y, px of the keyframe, and correlation, 0 out of view; `seen`
    bool[n], usable and in view. Returns the number of patches in view.
    """
    height, width = image.shape
    pixels, below = image.ravel(), np.uintp(width)
    last_x, last_y = (width - 1) * _ONE - 1, (height - 1) * _ONE - 1
    middle_x, middle_y = (width - 1) / 2, (height - 1) / 2
    inner_x, inner_y = middle_x + (0.5 - _MARGIN), middle_y + (0.5 - _MARGIN)
    fraction = np.float32(1 / _ONE)
    for patch in range(len(centres)):
        products[0, patch] = products[1, patch] = products[2, patch] = 0.0
        x, y = centres[patch, 0], centres[patch, 1]
        weight = 1 / (matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2])
        to_x = (matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2]) * weight
        to_y = (matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2]) * weight
        seen[patch] = usable[patch] and abs(to_x - middle_x) < inner_x and abs(to_y - middle_y) < inner_y
        if not seen[patch]:
            continue
        xx, xy = (matrix[0, 0] - matrix[2, 0] * to_x) * weight, (matrix[0, 1] - matrix[2, 1] * to_x) * weight
        yx, yy = (matrix[1, 0] - matrix[2, 0] * to_y) * weight, (matrix[1, 1] - matrix[2, 1] * to_y) * weight
        step_x, step_y = np.int64(xx * _ONE), np.int64(yx * _ONE)
        total = squares = across = down = correlation = np.float32(0)
        pixel = 0
        for row in range(-RADIUS, RADIUS + 1):
            at_x = np.int64((to_x + xy * row - xx * RADIUS) * _ONE)
            at_y = np.int64((to_y + yy * row - yx * RADIUS) * _ONE)
            for _ in range(_SIDE):
                # Edge pixels repeat beyond the border.
                low_x, low_y = min(max(at_x, 0), last_x), min(max(at_y, 0), last_y)
                place = np.uintp((low_y >> 16) * width + (low_x >> 16))
                right, lower = np.float32(low_x & 65535) * fraction, np.float32(low_y & 65535) * fraction
                first, second = np.float32(pixels[place]), np.float32(pixels[place + below])
                first += right * (np.float32(pixels[place + np.uintp(1)]) - first)
                second += right * (np.float32(pixels[place + below + np.uintp(1)]) - second)
                value = first + lower * (second - first)
                total += value
                squares += value * value
                across += value * probes[patch, 0, pixel]
                down += value * probes[patch, 1, pixel]
                correlation += value * probes[patch, 2, pixel]
                pixel += 1
                at_x += step_x
                at_y += step_y
        mean = total / np.float32(_PIXELS)
        deviation = np.sqrt(max(squares / np.float32(_PIXELS) - mean * mean, np.float32(1e-6)))
        products[0, patch], products[1, patch] = across / deviation, down / deviation
        products[2, patch] = correlation / deviation
    return int(np.count_nonzero(seen))


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
    return _solve(normal, sides, parameters)


@compiled
def _solve(normal: FloatArray, sides: FloatArray, parameters: FloatArray) -> bool:
    """Solves eight equations by Cholesky; returns False if degenerate."""
    lower = np.zeros((8, 8))
    for row in range(8):
        for column in range(row + 1):
            rest = normal[row, column]
            for other in range(column):
                rest -= lower[row, other] * lower[column, other]
            if row != column:
                lower[row, column] = rest / lower[column, column]
            elif rest > _SMALLEST_PIVOT:
                lower[row, row] = np.sqrt(rest)
            else:
                return False
    for row in range(8):
        parameters[row] = sides[row]
        for other in range(row):
            parameters[row] -= lower[row, other] * parameters[other]
        parameters[row] /= lower[row, row]
    for row in range(7, -1, -1):
        for other in range(row + 1, 8):
            parameters[row] -= lower[other, row] * parameters[other]
        parameters[row] /= lower[row, row]
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
def _move(
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
    bound = max(_TRIM * _median(squares, chosen), _CLOSE**2)
    near[:] = chosen & (squares <= bound)
    return x, y


@compiled
def _advance(matrix: FloatArray, scaling: FloatArray, parameters: FloatArray) -> None:
    """Composes a motion with a step in the keyframe."""
    x, y, size = scaling[0], scaling[1], scaling[2]
    a, b, c = 1 + parameters[0], parameters[1], parameters[2]
    d, e, f = parameters[3], 1 + parameters[4], parameters[5]
    g, h = parameters[6] / size, parameters[7] / size
    # The step in px: scaling @ step @ inverse scaling.
    i = 1 - g * x - h * y
    a, b, d, e = a + x * g, b + x * h, d + y * g, e + y * h
    c, f = size * c + x - a * x - b * y, size * f + y - d * x - e * y
    for row in range(3):
        first, second, third = matrix[row, 0], matrix[row, 1], matrix[row, 2]
        matrix[row, 0] = first * a + second * d + third * g
        matrix[row, 1] = first * b + second * e + third * h
        matrix[row, 2] = first * c + second * f + third * i
    matrix /= matrix[2, 2]


@kernel(INPUT, TABLE, _PATCHES, FLAGS, _VALUES, types.int64, types.float64, TABLE)
def settle(
    image: GreyArray,
    centres: FloatArray,
    probes: _SingleArray,
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
        visible = probe(image, centres, probes, usable, matrix, products, seen)
        if _above(products, seen, _MIN_COARSE_CORRELATION, valid) < max(_FEWEST, visible // 3):
            return False
        x, y = _together(products, valid, near, squares)
        far = np.sqrt(x * x + y * y)
        if far > _FAR:
            parameters[:] = 0.0
            parameters[2], parameters[5] = x / scaling[2], y / scaling[2]
        else:
            information[0] = information[2] = np.where(near, products[2], 0.0)
            if not solve(centres, scaling, products, information, normal, parameters):
                return False
            far = _move(centres, scaling, parameters, seen, moves)
        if far > _WILD:
            return False
        _advance(matrix, scaling, parameters)
        if far < settled:
            return True
    return False


@compiled
def _above(products: FloatArray, seen: MaskArray, least: float, chosen: MaskArray) -> int:
    """Chooses patches in view whose correlation is above `least`; returns their number."""
    chosen[:] = seen & (products[2] > least)
    return int(np.count_nonzero(chosen))


@kernel(INPUT, TABLE, _PATCHES, FLAGS, _VALUES, _MATRICES, TABLE, TABLE, TABLE, TABLE, FLAGS, FLAGS)
def improve(
    image: GreyArray,
    centres: FloatArray,
    probes: _SingleArray,
    usable: MaskArray,
    scaling: FloatArray,
    inverse_hessian: FloatArray,
    matrix: FloatArray,
    products: FloatArray,
    information: FloatArray,
    normal: FloatArray,
    alike: MaskArray,
    near: MaskArray,
) -> tuple[float, int, float]:
    """One step of the motion that minimises all differences, weighted by each patch's covariance.

    Patches off the plane are found while all patches have about equal weights. Results, besides `matrix`:
    `products` as of `probe`, with the residuals after the step; `information` float64[3, n], inverse
    covariance of each position, x x, x y, y y, 1 / px^2; the `normal` matrix; the `alike` patches, in view
    and correlated; of these the patches `near` the plane, within their covariances.

    Returns:
        The largest displacement of a patch in view, px, infinite if too few are correlated; the number of
        patches in view; the variance of a position relative to its covariance.
    """
    count = len(centres)
    seen, moves, parameters = np.empty(count, np.bool_), np.empty((2, count)), np.empty(8)
    squares, counted = np.empty(count), np.empty((3, count))
    visible_count = probe(image, centres, probes, usable, matrix, products, seen)
    if _above(products, seen, _MIN_CORRELATION, alike) < max(_FEWEST, visible_count // 3):
        return np.inf, visible_count, 0.0
    _inform(products, inverse_hessian, information)
    _together(products, alike, near, squares)
    xx, xy, yy = information[0], information[1], information[2]
    squares[:] = (xx * yy - xy * xy) / (xx + yy)
    most = _median(squares, alike)
    counted[0] = counted[2] = np.where(near, np.minimum(squares, most), 0.0)
    counted[1] = 0.0
    if not solve(centres, scaling, products, counted, normal, parameters):
        return np.inf, visible_count, 0.0
    _move(centres, scaling, parameters, seen, moves)
    _weighted_squares(products, moves, information, squares)
    bound = _TRIM * _median(squares, alike)
    near[:] = alike & (squares < bound)
    counted[:] = np.where(near, information, 0.0)
    if not solve(centres, scaling, products, counted, normal, parameters):
        return np.inf, visible_count, 0.0
    far = _move(centres, scaling, parameters, seen, moves)
    _advance(matrix, scaling, parameters)
    _weighted_squares(products, moves, information, squares)
    products[:2] -= moves
    freedom = 2 * np.count_nonzero(near) - 8
    return far, visible_count, squares[near].sum() / max(1, freedom)


@compiled
def _inform(products: FloatArray, inverse_hessian: FloatArray, information: FloatArray) -> None:
    """The inverse covariance of each patch's position, see `improve`."""
    # Images of unit deviation with correlation c differ by 2 - 2 c.
    noise = 2 * np.maximum(1 - products[2], 1e-3)
    xx = inverse_hessian[:, 0, 0] * noise + _FLOOR**2
    xy = inverse_hessian[:, 0, 1] * noise
    yy = inverse_hessian[:, 1, 1] * noise + _FLOOR**2
    determinant = xx * yy - xy * xy
    information[0], information[1], information[2] = yy / determinant, -xy / determinant, xx / determinant


@compiled
def _weighted_squares(
    shift: FloatArray, moves: FloatArray, information: FloatArray, squares: FloatArray
) -> None:
    """The squared residuals after a step, in units of their deviations."""
    x, y = shift[0] - moves[0], shift[1] - moves[1]
    squares[:] = (information[0] * x + 2 * information[1] * y) * x + information[2] * y * y
