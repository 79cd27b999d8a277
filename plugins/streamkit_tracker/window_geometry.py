"""Rotated windows as rows `x, y, length, width, angle`, and how homographies move them.

Pixel coordinates: x right, y down, (0, 0) the centre of the top-left pixel. Angles in radians from +x
towards +y. `length` lies along the angle, `width` across it.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from streamkit_kernels import compiled

FloatArray = NDArray[np.float64]

X, Y, LENGTH, WIDTH, ANGLE = range(5)
MINIMUM_SIDE = 2.0
NO_SCALE = 1e-9
IDENTITY: FloatArray = np.eye(2)
IDENTITY.setflags(write=False)


def window_sides(windows: FloatArray) -> FloatArray:
    """Geometric means of the sides of windows float64[n, 5]: float64[n], px."""
    return np.asarray(np.sqrt(windows[:, LENGTH] * windows[:, WIDTH]))


def half_turn(angle: FloatArray | float) -> FloatArray:
    """Wraps angles of a direction without sign into [-pi/2, pi/2)."""
    return np.asarray((np.asarray(angle, np.float64) + np.pi / 2) % np.pi - np.pi / 2)


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


def map_windows(homography: FloatArray, windows: FloatArray) -> FloatArray:
    """Moves windows by a homography, to first order around their centres.

    Args:
        homography: float64[3, 3].
        windows: float64[n, 5].

    Returns:
        float64[n, 5]: the length follows its own direction, the width keeps the mapped area.
    """
    centres, jacobians = map_points(homography, windows[:, :2])
    mapped = np.empty_like(windows)
    mapped[:, :2] = centres
    _reshape(jacobians, windows, mapped)
    return mapped


@compiled
def _reshape(jacobians: FloatArray, windows: FloatArray, mapped: FloatArray) -> None:
    """Fills in the sides and angles of mapped windows."""
    for index in range(len(windows)):
        jacobian, angle = jacobians[index], windows[index, ANGLE]
        x = jacobian[0, 0] * np.cos(angle) + jacobian[0, 1] * np.sin(angle)
        y = jacobian[1, 0] * np.cos(angle) + jacobian[1, 1] * np.sin(angle)
        stretch = max(np.hypot(x, y), NO_SCALE)
        area_ratio = abs(jacobian[0, 0] * jacobian[1, 1] - jacobian[0, 1] * jacobian[1, 0])
        mapped[index, LENGTH] = max(windows[index, LENGTH] * stretch, MINIMUM_SIDE)
        mapped[index, WIDTH] = max(windows[index, WIDTH] * area_ratio / stretch, MINIMUM_SIDE)
        mapped[index, ANGLE] = (np.arctan2(y, x) + np.pi / 2) % np.pi - np.pi / 2


def window_boxes(windows: FloatArray) -> FloatArray:
    """Upright boxes around windows: float64[n, 4], x0 y0 x1 y1."""
    cosine, sine = np.abs(np.cos(windows[:, ANGLE])), np.abs(np.sin(windows[:, ANGLE]))
    half_x = 0.5 * (windows[:, LENGTH] * cosine + windows[:, WIDTH] * sine)
    half_y = 0.5 * (windows[:, LENGTH] * sine + windows[:, WIDTH] * cosine)
    x, y = windows[:, X], windows[:, Y]
    return np.column_stack([x - half_x, y - half_y, x + half_x, y + half_y])


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
        x, y, length, width, angle = windows[column]
        cosine, sine = np.cos(angle), np.sin(angle)
        for row in range(len(points)):
            right, down = points[row, 0] - x, points[row, 1] - y
            along, across = abs(right * cosine + down * sine), abs(down * cosine - right * sine)
            inside[row, column] = along < 0.5 * scale * length and across < 0.5 * scale * width


def extent(windows: FloatArray) -> tuple[float, float, float, float]:
    """x0, y0, x1, y1 of an upright box that surely holds every window."""
    largest = windows.max(axis=0).tolist()
    x0, y0 = windows[:, :2].min(axis=0).tolist()
    reach = 0.5 * math.hypot(largest[LENGTH], largest[WIDTH])
    return x0 - reach, y0 - reach, largest[X] + reach, largest[Y] + reach


def visible_fraction(windows: FloatArray, image_shape: tuple[int, int]) -> FloatArray:
    """Part of each window's upright box that lies inside the image: float64[n], 0 to 1."""
    height, width = image_shape
    x0, y0, x1, y1 = extent(windows)
    if x0 >= -0.5 and y0 >= -0.5 and x1 <= width - 0.5 and y1 <= height - 0.5:
        return np.ones(len(windows))
    boxes = window_boxes(windows)
    low = np.maximum(boxes[:, :2], -0.5)
    high = np.minimum(boxes[:, 2:], np.array([width - 0.5, height - 0.5]))
    inside = np.prod(np.maximum(high - low, 0.0), axis=1)
    return np.asarray(inside / np.maximum(np.prod(boxes[:, 2:] - boxes[:, :2], axis=1), 1e-9))
