"""Steps of a homography to where patches look like a frame, as compiled loops over their pixels.

All take the same patches: `centres` float64[n, 2], px of the keyframe, of the middle x y and the size that
`scaling` float64[3] tells, see `Scaling`; their `probes` float32[n, 3, 225], see `PatchLevel`; which are
`usable`, bool[n]. What is found is written into arrays of the caller's.
"""

from typing import Final

import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import FloatArray, GreyArray, MaskArray
from streamkit_kernels import FLAGS, INPUT, TABLE, compiled, kernel
from streamkit_stitcher.registration.patch_types import COUNT, NUMBER, PATCHES, SHAPES, VALUES
from streamkit_stitcher.registration.patches import RADIUS

_SingleArray = npt.NDArray[np.float32]

_SIDE: Final = 2 * RADIUS + 1
_PIXELS: Final = _SIDE**2
_MARGIN: Final = RADIUS + 3
_ONE: Final = 65536
_FAR: Final = 1.0
_FEWEST: Final = 10
_FAINT: Final = 0.2
_ALIKE: Final = 0.6
_TRIM: Final = 9.0
_WILD: Final = 10.0
_CLOSE: Final = 0.3
# What no patch is better than, px: the lens, the shutter, the ground are not quite a plane's.
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
    """One Gauss-Newton step of each patch from where a motion expects it.

    Each is compared with the image resampled through the homography's local affine part, bilinearly. Found:
    `products` float64[3, n], how far off the expected place each patch is seen, x and y, px of the key
    frame, and how well it correlates there, -1 to 1; and which are `seen`, bool[n]: usable and in view; the
    products of the others are 0. Returns the number of those seen.
    """
    height, width = image.shape
    pixels, below = image.ravel(), np.uintp(width)
    last_x, last_y = (width - 1) * _ONE - 1, (height - 1) * _ONE - 1
    middle_x, middle_y = (width - 1) / 2, (height - 1) / 2
    inner_x, inner_y = middle_x + (0.5 - _MARGIN), middle_y + (0.5 - _MARGIN)
    fraction, count = np.float32(1 / _ONE), 0
    for patch in range(len(centres)):
        products[0, patch] = products[1, patch] = products[2, patch] = 0.0
        x, y = centres[patch, 0], centres[patch, 1]
        weight = 1 / (matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2])
        to_x = (matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2]) * weight
        to_y = (matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2]) * weight
        seen[patch] = usable[patch] and abs(to_x - middle_x) < inner_x and abs(to_y - middle_y) < inner_y
        if not seen[patch]:
            continue
        count += 1
        xx, xy = (matrix[0, 0] - matrix[2, 0] * to_x) * weight, (matrix[0, 1] - matrix[2, 1] * to_x) * weight
        yx, yy = (matrix[1, 0] - matrix[2, 0] * to_y) * weight, (matrix[1, 1] - matrix[2, 1] * to_y) * weight
        step_x, step_y = np.int64(xx * _ONE), np.int64(yx * _ONE)
        total = squares = across = down = correlation = np.float32(0)
        pixel = 0
        for row in range(-RADIUS, RADIUS + 1):
            at_x = np.int64((to_x + xy * row - xx * RADIUS) * _ONE)
            at_y = np.int64((to_y + yy * row - yx * RADIUS) * _ONE)
            for _ in range(_SIDE):
                # Beyond the border the edge pixels repeat.
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
    return count


@compiled
def solve(
    centres: FloatArray,
    scaling: FloatArray,
    shift: FloatArray,
    information: FloatArray,
    normal: FloatArray,
    parameters: FloatArray,
) -> bool:
    """The homography near the identity that suits shifts of patches best, by their inverse covariances.

    Of `shift`, px, the first two rows count, by `information` float64[3, n], x x, x y, y y. Found are the
    `normal` matrix float64[8, 8] and the `parameters` float64[8] in units of the scaling. Returns whether the
    patches fix one.
    """
    sides, across, down = np.zeros(8), np.zeros(8), np.zeros(8)
    for row in range(8):
        for column in range(8):
            normal[row, column] = 0.0
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
    for row in range(8):
        for column in range(row):
            normal[column, row] = normal[row, column]
    return _solve(normal, sides, parameters)


@compiled
def _solve(normal: FloatArray, sides: FloatArray, parameters: FloatArray) -> bool:
    """Cholesky's solution of eight equations; false where they do not fix one."""
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
    """How the eight parameters move a point in x and in y, in units of the scaling."""
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
    """Fills in how a step moves each patch, float64[2, n], px; returns the farthest of those in view."""
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
def _median(values: FloatArray, chosen: MaskArray, scratch: FloatArray) -> float:
    """The middle one of chosen values, of which there is one at least; `scratch` is as long as `values`."""
    count = 0
    for index in range(len(values)):
        if chosen[index]:
            place, count = count, count + 1
            while place > 0 and scratch[place - 1] > values[index]:
                scratch[place] = scratch[place - 1]
                place -= 1
            scratch[place] = values[index]
    return float(scratch[count // 2])


@compiled
def _together(
    shift: FloatArray, chosen: MaskArray, near: MaskArray, squares: FloatArray, scratch: FloatArray
) -> tuple[float, float]:
    """The median shift of chosen patches, and in `near` which of them move about as it does.

    A corner of the frame that moves by itself would bend a homography to it before it could be told apart.
    """
    x, y = _median(shift[0], chosen, scratch), _median(shift[1], chosen, scratch)
    for patch in range(len(chosen)):
        squares[patch] = (shift[0, patch] - x) ** 2 + (shift[1, patch] - y) ** 2
    bound = max(_TRIM * _median(squares, chosen, scratch), _CLOSE**2)
    for patch in range(len(chosen)):
        near[patch] = chosen[patch] and squares[patch] <= bound
    return x, y


@compiled
def _advance(matrix: FloatArray, scaling: FloatArray, parameters: FloatArray) -> None:
    """Puts a step before a motion: the keyframe's points were there where the step moves them."""
    x, y, size = scaling[0], scaling[1], scaling[2]
    a, b, c = 1 + parameters[0], parameters[1], parameters[2]
    d, e, f = parameters[3], 1 + parameters[4], parameters[5]
    g, h = parameters[6] / size, parameters[7] / size
    # The step in px: scaling, step and inverse scaling multiplied out.
    i = 1 - g * x - h * y
    a, b, d, e = a + x * g, b + x * h, d + y * g, e + y * h
    c, f = size * c + x - a * x - b * y, size * f + y - d * x - e * y
    for row in range(3):
        first, second, third = matrix[row, 0], matrix[row, 1], matrix[row, 2]
        matrix[row, 0] = first * a + second * d + third * g
        matrix[row, 1] = first * b + second * e + third * h
        matrix[row, 2] = first * c + second * f + third * i
    last = matrix[2, 2]
    for row in range(3):
        for column in range(3):
            matrix[row, column] /= last


@kernel(INPUT, TABLE, PATCHES, FLAGS, VALUES, COUNT, NUMBER, TABLE)
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
    """Improves a motion from keyframe to image until it hardly changes any more.

    There are `passes` at most; `settled` is the last change of a patch's place, px. Returns whether the
    patches are seen and settle.
    """
    count = len(centres)
    products, seen = np.empty((3, count)), np.empty(count, np.bool_)
    valid, near, moves = np.empty(count, np.bool_), np.empty(count, np.bool_), np.empty((2, count))
    squares, scratch, information = np.empty(count), np.empty(count), np.zeros((3, count))
    normal, parameters = np.empty((8, 8)), np.empty(8)
    for _ in range(passes):
        visible = probe(image, centres, probes, usable, matrix, products, seen)
        if _above(products, seen, _FAINT, valid) < max(_FEWEST, visible // 3):
            return False
        x, y = _together(products, valid, near, squares, scratch)
        far = np.sqrt(x * x + y * y)
        if far > _FAR:
            for row in range(8):
                parameters[row] = 0.0
            parameters[2], parameters[5] = x / scaling[2], y / scaling[2]
        else:
            for patch in range(count):
                information[0, patch] = information[2, patch] = products[2, patch] if near[patch] else 0.0
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
    """Fills in which patches in view look more than `least` like the keyframe's; returns their number."""
    count = 0
    for patch in range(len(seen)):
        chosen[patch] = seen[patch] and products[2, patch] > least
        count += chosen[patch]
    return count


@kernel(INPUT, TABLE, PATCHES, FLAGS, VALUES, SHAPES, TABLE, TABLE, TABLE, TABLE, FLAGS, FLAGS)
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
    """Moves a motion to where all patches differ least, each counting by its covariance in either direction.

    Which lie on the plane is told while every patch counts for about as much ground as any other.

    Found are, beside the better `matrix`: `products` as of `probe`, but where each patch is seen less where
    the better motion tells; `information` float64[3, n], the inverse covariance of each place, x x, x y, y y,
    1 / px^2; the `normal` matrix; which patches are `alike`, in view and like the keyframe's; and which of
    these are `near`, where the motion tells as far as their covariances allow.

    Returns:
        The farthest that a patch in view was moved, px, infinite where the patches are not seen; the number
        of patches in view; the variance of a place in units of what was expected.
    """
    count = len(centres)
    seen, moves, parameters = np.empty(count, np.bool_), np.empty((2, count)), np.empty(8)
    squares, scratch, counted = np.empty(count), np.empty(count), np.empty((3, count))
    visible_count = probe(image, centres, probes, usable, matrix, products, seen)
    if _above(products, seen, _ALIKE, alike) < max(_FEWEST, visible_count // 3):
        return np.inf, visible_count, 0.0
    _inform(products, inverse_hessian, information)
    _together(products, alike, near, squares, scratch)
    for patch in range(count):
        xx, xy, yy = information[0, patch], information[1, patch], information[2, patch]
        squares[patch] = (xx * yy - xy * xy) / (xx + yy)
    most = _median(squares, alike, scratch)
    for patch in range(count):
        counted[0, patch] = counted[2, patch] = min(squares[patch], most) if near[patch] else 0.0
        counted[1, patch] = 0.0
    if not solve(centres, scaling, products, counted, normal, parameters):
        return np.inf, visible_count, 0.0
    _move(centres, scaling, parameters, seen, moves)
    _weighted_squares(products, moves, information, squares)
    bound = _TRIM * _median(squares, alike, scratch)
    for patch in range(count):
        near[patch] = alike[patch] and squares[patch] < bound
        for row in range(3):
            counted[row, patch] = information[row, patch] if near[patch] else 0.0
    if not solve(centres, scaling, products, counted, normal, parameters):
        return np.inf, visible_count, 0.0
    far = _move(centres, scaling, parameters, seen, moves)
    _advance(matrix, scaling, parameters)
    _weighted_squares(products, moves, information, squares)
    total, freedom = 0.0, -8
    for patch in range(count):
        products[0, patch] -= moves[0, patch]
        products[1, patch] -= moves[1, patch]
        if near[patch]:
            total += squares[patch]
            freedom += 2
    return far, visible_count, total / max(1, freedom)


@compiled
def _inform(products: FloatArray, inverse_hessian: FloatArray, information: FloatArray) -> None:
    """Fills in the inverse covariance of each patch's place, see `improve`."""
    for patch in range(len(inverse_hessian)):
        # Frames of unit deviation that correlate by c differ by 2 - 2 c.
        noise = 2 * max(1 - products[2, patch], 1e-3)
        xx = inverse_hessian[patch, 0, 0] * noise + _FLOOR**2
        xy = inverse_hessian[patch, 0, 1] * noise
        yy = inverse_hessian[patch, 1, 1] * noise + _FLOOR**2
        determinant = xx * yy - xy * xy
        information[0, patch], information[2, patch] = yy / determinant, xx / determinant
        information[1, patch] = -xy / determinant


@compiled
def _weighted_squares(
    shift: FloatArray, moves: FloatArray, information: FloatArray, squares: FloatArray
) -> None:
    """Fills in the squared distances that are left after a step, in units of their deviations."""
    for patch in range(len(squares)):
        x, y = shift[0, patch] - moves[0, patch], shift[1, patch] - moves[1, patch]
        squares[patch] = (information[0, patch] * x + 2 * information[1, patch] * y) * x
        squares[patch] += information[2, patch] * y * y
