"""Compiled Gauss-Newton step of a homography, weighted by covariances.

Common arguments: `centres` float64[n, 2], px of the keyframe; `scaling` float64[3], centre x y and size of
normalised coordinates; `parameters` float64[8], of the step in these.
"""

from typing import Final

import numpy as np

from streamkit.geometry.homography import FloatArray, MaskArray
from streamkit_kernels import compiled

_SMALLEST_PIVOT: Final = 2.3e-16


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
