"""Rotated windows as rows `x, y, length, width, angle`, and how homographies move them.

Pixel coordinates: x right, y down, (0, 0) the centre of the top-left pixel. Angles in radians from +x
towards +y. `length` lies along the angle, `width` across it.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TypeVar

import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray

from streamkit.geometry import boxes
from streamkit_kernels import compiled

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
ByteArray = NDArray[np.uint8]
IntArray = NDArray[np.int64]
Number = TypeVar("Number", float, FloatArray)

X, Y, LENGTH, WIDTH, ANGLE = range(5)
MINIMUM_SIDE = 2.0
NO_SCALE = 1e-9
IDENTITY: FloatArray = np.eye(2)
IDENTITY.setflags(write=False)

upright_sides = register_jitable(boxes.upright_sides)


@register_jitable
def half_turn(angle: Number) -> Number:
    """Wraps angles of directions without sign into [-pi/2, pi/2)."""
    return (angle + np.pi / 2) % np.pi - np.pi / 2


def map_points(homography: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Maps points float64[n, 2] by a homography, and gives the derivative of the map at each.

    Returns:
        float64[n, 2], the mapped points, and float64[n, 2, 2], the Jacobians there. Points on the line at
        infinity stay where they are, with the identity.
    """
    images = points @ homography[:, :2].T + homography[:, 2]
    usable = np.abs(images[:, 2:]) > NO_SCALE
    scales = np.where(usable, images[:, 2:], 1.0)
    mapped = np.where(usable, images[:, :2] / scales, points)
    slopes = (homography[:2, :2] - mapped[:, :, None] * homography[2, :2]) / scales[:, :, None]
    return mapped, np.where(usable[:, :, None], slopes, IDENTITY)


@register_jitable
def is_inside(x: float, y: float, window: FloatArray, scale: float) -> bool:
    """Whether a point lies inside a window, float64[5], `scale` times as large about its centre."""
    right, down = x - window[X], y - window[Y]
    cosine, sine = np.cos(window[ANGLE]), np.sin(window[ANGLE])
    along, across = abs(right * cosine + down * sine), abs(down * cosine - right * sine)
    return bool(along < 0.5 * scale * window[LENGTH] and across < 0.5 * scale * window[WIDTH])


def widened(windows: FloatArray, factor: float | FloatArray) -> FloatArray:
    """A copy of windows float64[..., 5] with their sides multiplied."""
    wider = windows.copy()
    wider[..., LENGTH : WIDTH + 1] *= factor
    return wider


@compiled
def visible_fraction(windows: FloatArray, image_shape: tuple[int, int]) -> FloatArray:
    """Part of each window's upright box that lies in the image: float64[n] of float64[n, 5], 0 to 1."""
    shown = np.empty(len(windows))
    for index in range(len(windows)):
        x, y, length, width, angle = windows[index]
        across, down = upright_sides(length, width, angle)
        half_x, half_y = 0.5 * across, 0.5 * down
        inside_x = min(x + half_x, image_shape[1] - 0.5) - max(x - half_x, -0.5)
        inside_y = min(y + half_y, image_shape[0] - 0.5) - max(y - half_y, -0.5)
        shown[index] = max(inside_x, 0.0) * max(inside_y, 0.0) / max(4 * half_x * half_y, 1e-9)
    return shown


@lru_cache(maxsize=32)
def unit_grid(patch: tuple[int, int]) -> NDArray[np.float32]:
    """Sampling points float32[2, rows * columns] of a patch (rows, columns) in its own unit square.

    u lies along the length and v across it; row by row, each from -0.5 to 0.5.
    """
    rows, columns = patch
    steps_across = (np.arange(rows, dtype=np.float32) + 0.5) / rows - 0.5
    steps_along = (np.arange(columns, dtype=np.float32) + 0.5) / columns - 0.5
    across, along = np.meshgrid(steps_across, steps_along, indexing="ij")
    return np.stack([along.ravel(), across.ravel()])
