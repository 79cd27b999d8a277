"""Homographies between planes: projection, plausibility, overlap of footprints."""

import math
from typing import Final

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
GreyArray = npt.NDArray[np.uint8]
MaskArray = npt.NDArray[np.bool_]

IDENTITY: Final[FloatArray] = np.eye(3)
IDENTITY.setflags(write=False)

_SMALLEST: Final = 1e-12
_DETERMINANTS: Final = 1e-8, 1e8  # beyond them pixels are lost to rounding
_FEW_POINTS: Final = 8  # plain numbers are quicker than numpy up to here, with the same bits
_EPSILON: Final = float(np.finfo(np.float64).eps)
_MAX_TILT: Final = 0.1


def normalised(matrix: FloatArray) -> FloatArray:
    """Scales a homography so that its last element is 1.

    Args:
        matrix: float64[3, 3].

    Returns:
        float64[3, 3]; the identity if the last element is zero or an element is not finite.
    """
    # As a list: nine numbers are summed before numpy has begun.
    values = matrix.ravel().tolist()
    last = values[8]
    if abs(last) < _SMALLEST or not math.isfinite(sum(values)):
        return IDENTITY
    return np.asarray(matrix / last, dtype=np.float64)


def inverse(matrix: FloatArray) -> FloatArray:
    """Inverts a homography by its adjugate, scaled as by `normalised`; the identity for a singular one."""
    (a, b, c), (d, e, f), (g, h, i) = matrix.tolist()
    adjugate = np.array(
        [
            [e * i - f * h, c * h - b * i, b * f - c * e],
            [f * g - d * i, a * i - c * g, c * d - a * f],
            [d * h - e * g, b * g - a * h, a * e - b * d],
        ]
    )
    determinant = a * adjugate[0, 0] + b * adjugate[1, 0] + c * adjugate[2, 0]
    return normalised(adjugate) if abs(determinant) > _SMALLEST else IDENTITY


def is_invertible(matrix: FloatArray) -> bool:
    """Whether a matrix is a finite homography, float64[3, 3], whose inverse can be trusted."""
    if matrix.shape != (3, 3) or matrix[2, 2] == 0.0 or not math.isfinite(sum(matrix.ravel().tolist())):
        return False
    (a, b, c), (d, e, f), (g, h, i) = (matrix / matrix[2, 2]).tolist()
    smallest, largest = _DETERMINANTS
    determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    return bool(smallest < abs(determinant) < largest)


def project(matrix: FloatArray, points: FloatArray) -> FloatArray:
    """Maps points through a homography.

    Args:
        matrix: float64[3, 3].
        points: float64[n, 2], x y.

    Returns:
        float64[n, 2]; points at infinity become zeros.
    """
    (a, b, c), (d, e, f), (g, h, i) = matrix.tolist()
    if len(points) <= _FEW_POINTS:
        few = np.empty((len(points), 2))
        for index, (x, y) in enumerate(points.tolist()):
            depth = g * x + h * y + i
            scale = 1.0 / depth if abs(depth) > _EPSILON else 0.0
            few[index] = (a * x + b * y + c) * scale, (d * x + e * y + f) * scale
        return few
    x, y = points[:, 0], points[:, 1]
    depth = g * x + h * y + i
    scale = np.divide(1.0, depth, out=np.zeros_like(depth), where=np.abs(depth) > _EPSILON)
    return np.stack([(a * x + b * y + c) * scale, (d * x + e * y + f) * scale], axis=1)


def translation(shift: FloatArray) -> FloatArray:
    """The homography that adds `shift`, float64[2] x y."""
    matrix = np.eye(3)
    matrix[:2, 2] = shift
    return matrix


def corners(shape: tuple[int, int]) -> FloatArray:
    """Centres of the four corner pixels of an image of `shape` (height, width), clockwise, float64[4, 2]."""
    height, width = shape
    return np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], dtype=np.float64)


def centre(shape: tuple[int, int]) -> FloatArray:
    """Centre of an image of `shape` (height, width), float64[2] x y."""
    height, width = shape
    return np.array([(width - 1) / 2, (height - 1) / 2])


def resized(matrix: FloatArray, factor: float) -> FloatArray:
    """A homography between two images, for the same images at `factor` times their size.

    Images are reduced by averaging blocks: of images reduced by `factor`, pixel x is at full-size
    x * factor + (factor - 1) / 2.

    Args:
        matrix: float64[3, 3].
        factor: of both sides; below 1 for smaller images.

    Returns:
        float64[3, 3].
    """
    offset, reduced = (factor - 1) / 2, (1 - factor) / (2 * factor)
    lift = np.array([[factor, 0, offset], [0, factor, offset], [0, 0, 1]])
    lower = np.array([[1 / factor, 0, reduced], [0, 1 / factor, reduced], [0, 0, 1]])
    return normalised(lift @ matrix @ lower)


def corner_shift(matrix: FloatArray, shape: tuple[int, int]) -> float:
    """Largest distance any of the four image corners moves under `matrix`, in px."""
    points = corners(shape)
    return max(map(math.dist, project(matrix, points).tolist(), points.tolist()))


def is_convex(quadrilateral: FloatArray) -> bool:
    """Whether a quadrilateral, float64[4, 2], is convex and clockwise, as the corners of an image."""
    x, y = quadrilateral.T.tolist()
    for here, after, last in ((0, 1, 2), (1, 2, 3), (2, 3, 0), (3, 0, 1)):
        turn = (x[after] - x[here]) * (y[last] - y[after]) - (y[after] - y[here]) * (x[last] - x[after])
        if not turn > 0:
            return False
    return True


def tilt(matrix: FloatArray, shape: tuple[int, int]) -> float:
    """Relative change of scale across an image; infinite if the horizon is inside."""
    height, width = shape
    g, h, i = matrix[2].tolist()
    least = min(i + g * x + h * y for x in (0, width) for y in (0, height))
    return max(abs(g) * width, abs(h) * height) / least if least > 0 else math.inf


def is_plausible(
    matrix: FloatArray,
    shape: tuple[int, int],
    max_step: float,
    max_tilt: float = _MAX_TILT,
    max_area_scale: float = 2.0,
) -> bool:
    """Whether a homography is a possible motion of a flying camera.

    The corners must stay convex.

    Args:
        matrix: float64[3, 3], last element 1.
        shape: (height, width) of the image, px.
        max_step: maximum displacement of a corner, relative to the width.
        max_tilt: maximum `tilt`; small between successive frames, larger for an oblique camera that turns.
        max_area_scale: largest area scale at the centre, and the inverse of the smallest.
    """
    (a, b, c), (d, e, f), (g, h, i) = matrix.tolist()
    height, width = shape
    if not math.isfinite(a + b + c + d + e + f + g + h + i) or not tilt(matrix, shape) < max_tilt:
        return False
    determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    scale = determinant / (i + (g * width + h * height) / 2) ** 3
    if not 1 / max_area_scale < scale < max_area_scale:
        return False
    return is_convex(project(matrix, corners(shape))) and corner_shift(matrix, shape) < max_step * width


def overlap(matrix: FloatArray, shape: tuple[int, int]) -> float:
    """Fraction of an image's footprint that is inside the other image, 0 to 1.

    Args:
        matrix: float64[3, 3], maps pixels of the image to pixels of the other one, which has the same shape.
        shape: (height, width), px.

    Source: Sutherland and Hodgman, Reentrant polygon clipping, Communications of the ACM 17 (1974).
    """
    footprint = project(matrix, corners(shape))
    own = polygon_area(footprint) if is_convex(footprint) else 0.0
    if not own > 0:
        return 0.0
    points = [(float(x), float(y)) for x, y in footprint]
    for axis, size in ((0, shape[1]), (1, shape[0])):
        for sign, limit in ((1.0, 0.0), (-1.0, -(size - 1.0))):
            depths = [sign * point[axis] - limit for point in points]
            kept: list[tuple[float, float]] = []
            for index, (point, depth) in enumerate(zip(points, depths, strict=True)):
                before, depth_before = points[index - 1], depths[index - 1]
                if (depth >= 0) != (depth_before >= 0):
                    share = depth_before / (depth_before - depth)
                    crossing = [a + (b - a) * share for a, b in zip(before, point, strict=True)]
                    kept.append((crossing[0], crossing[1]))
                if depth >= 0:
                    kept.append(point)
            points = kept
    return min(1.0, polygon_area(np.array(points, dtype=np.float64).reshape(-1, 2)) / own)


def scale_change(matrix: FloatArray, shape: tuple[int, int]) -> float:
    """Linear scale of the image's footprint under `matrix`; 0 if degenerate."""
    footprint = project(matrix, corners(shape))
    if not is_convex(footprint):
        return 0.0
    return float(np.sqrt(polygon_area(footprint) / ((shape[0] - 1) * (shape[1] - 1))))


def polygon_area(polygon: FloatArray) -> float:
    """Area of a simple polygon, float64[n, 2], by the shoelace formula."""
    points = polygon.tolist()
    following = points[1:] + points[:1]
    twice = sum(x * v - y * u for (x, y), (u, v) in zip(points, following, strict=True))
    return 0.5 * float(abs(twice))
