"""Rotated windows as rows `x, y, length, width, angle`, and how homographies move them.

Pixel coordinates: x right, y down, (0, 0) the centre of the top-left pixel. Angles in radians from +x
towards +y. `length` lies along the angle, `width` across it.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from streamkit_kernels import compiled

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

X, Y, LENGTH, WIDTH, ANGLE = range(5)
MINIMUM_SIDE = 2.0
NO_SCALE = 1e-9
IDENTITY: FloatArray = np.eye(2)
IDENTITY.setflags(write=False)


@compiled
def half_turn(angle: float) -> float:
    """Wraps the angle of a direction without sign into [-pi/2, pi/2)."""
    return (angle + np.pi / 2) % np.pi - np.pi / 2


def invertible(homography: FloatArray) -> FloatArray | None:
    """Inverse of a homography scaled to a last element of 1, or None where there is none to trust."""
    matrix = np.asarray(homography, np.float64)
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all():
        return None
    area_ratio, inverse = abs(cv2.determinant(matrix)), cv2.invert(matrix)[1]
    if area_ratio < 1e-9 or abs(matrix[2, 2]) < 1e-9:
        return None
    return None if abs(inverse[2, 2]) < 1e-9 else np.asarray(inverse / inverse[2, 2])


def map_points(homography: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Maps points and gives the derivative of the map at each.

    Args:
        homography: float64[3, 3].
        points: float64[n, 2], x y.

    Returns:
        float64[n, 2], the mapped points, and float64[n, 2, 2], the Jacobians there. Points on the line at
        infinity stay where they are, with the identity.
    """
    mapped, jacobians = np.empty((len(points), 2)), np.empty((len(points), 2, 2))
    _map(np.array(homography, np.float64), np.array(points, np.float64), mapped, jacobians)
    return mapped, jacobians


@compiled
def _map(homography: FloatArray, points: FloatArray, mapped: FloatArray, jacobians: FloatArray) -> None:
    """Fills in the mapped points and the Jacobians."""
    for index in range(len(points)):
        x, y = points[index]
        scale = homography[2, 0] * x + homography[2, 1] * y + homography[2, 2]
        usable = abs(scale) > NO_SCALE
        for axis in range(2):
            row = homography[axis]
            place = (row[0] * x + row[1] * y + row[2]) / scale if usable else points[index, axis]
            mapped[index, axis] = place
            for side in range(2):
                slope = (row[side] - place * homography[2, side]) / scale
                jacobians[index, axis, side] = slope if usable else (1.0 if axis == side else 0.0)


def inside_windows(points: FloatArray, windows: FloatArray, scale: float) -> NDArray[np.bool_]:
    """Which points lie inside which windows.

    Args:
        points: float64[n, 2], px.
        windows: float64[m, 5].
        scale: the windows are taken this much larger, about their centres.

    Returns:
        bool[n, m].
    """
    inside = np.empty((len(points), len(windows)), np.bool_)
    _find_inside(np.array(points, np.float64), windows, scale, inside)
    return inside


@compiled
def _find_inside(points: FloatArray, windows: FloatArray, scale: float, inside: NDArray[np.bool_]) -> None:
    """Fills in which points lie inside."""
    for column in range(len(windows)):
        for row in range(len(points)):
            inside[row, column] = is_inside(points[row, 0], points[row, 1], windows[column], scale)


@compiled
def is_inside(x: float, y: float, window: FloatArray, scale: float) -> bool:
    """Whether a point lies inside a window, float64[5], that is taken `scale` times as large."""
    cosine, sine = np.cos(window[ANGLE]), np.sin(window[ANGLE])
    right, down = x - window[X], y - window[Y]
    along, across = abs(right * cosine + down * sine), abs(down * cosine - right * sine)
    return bool(along < 0.5 * scale * window[LENGTH] and across < 0.5 * scale * window[WIDTH])


def visible_fraction(windows: FloatArray, image_shape: tuple[int, int]) -> FloatArray:
    """Part of each window's upright box that lies inside the image: float64[n], 0 to 1."""
    return np.array([visible_part(window, *image_shape) for window in windows])


@compiled
def visible_part(window: FloatArray, height: int, width: int) -> float:
    """Part of a window's upright box that lies inside the frame, 0 to 1."""
    cosine, sine = abs(np.cos(window[ANGLE])), abs(np.sin(window[ANGLE]))
    half_x = 0.5 * (window[LENGTH] * cosine + window[WIDTH] * sine)
    half_y = 0.5 * (window[LENGTH] * sine + window[WIDTH] * cosine)
    inside_x = min(window[0] + half_x, width - 0.5) - max(window[0] - half_x, -0.5)
    inside_y = min(window[1] + half_y, height - 0.5) - max(window[1] - half_y, -0.5)
    return float(max(inside_x, 0.0) * max(inside_y, 0.0) / max(4 * half_x * half_y, 1e-9))


@lru_cache(maxsize=32)
def unit_grid(patch: tuple[int, int]) -> NDArray[np.float32]:
    """Sampling points of a patch in its own unit square.

    Args:
        patch: samples across and along the window (rows, columns).

    Returns:
        float32[2, rows * columns]: u (along the length) and v (across); row by row from -0.5 to 0.5.
    """
    rows, columns = patch
    steps_across = (np.arange(rows, dtype=np.float32) + 0.5) / rows - 0.5
    steps_along = (np.arange(columns, dtype=np.float32) + 0.5) / columns - 0.5
    across, along = np.meshgrid(steps_across, steps_along, indexing="ij")
    return np.stack([along.ravel(), across.ravel()])
