"""Levelling of the reference plane, whose first keyframe was seen by a tilted camera."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from streamkit.geometry.homography import (
    FloatArray,
    centre,
    corners,
    normalised,
    project,
    scale_change,
    translation,
)
from streamkit_stitcher.plane.frame_registration import depth_ratio

_ITERATIONS: Final = 5
_LARGEST_STEP: Final = 0.5
# Well within the limits of a mosaic, see `mosaic.is_paintable`.
_PLANE_SCALE: Final = (0.3, 3.3)
# Photographs that lean 12 degrees one way and the other, of a camera that sees 60 degrees.
_MAX_DEPTH_RATIO: Final = 1.75
# Beyond these the plane is levelled, once there are some keyframes.
_LEVEL_SCALE: Final = (0.6, 1.6)
_LEVEL_DEPTH_RATIO: Final = 1.35
_FEWEST: Final = 4
_LESS: Final = 0.95


def is_stretched(
    to_plane: FloatArray,
    shape: tuple[int, int],
    largest_ratio: float = _MAX_DEPTH_RATIO,
    scales: tuple[float, float] = _PLANE_SCALE,
) -> bool:
    """Whether the plane stretches a frame too much for a mosaic."""
    return not (
        depth_ratio(to_plane, shape) < largest_ratio and scales[0] < scale_change(to_plane, shape) < scales[1]
    )


def levelling_due(to_plane: Sequence[FloatArray], shape: tuple[int, int]) -> FloatArray | None:
    """The change that levels a plane where it begins to stretch the last of its keyframes, else None."""
    newest = to_plane[-1]
    if len(to_plane) < _FEWEST or not is_stretched(newest, shape, _LEVEL_DEPTH_RATIO, _LEVEL_SCALE):
        return None
    change = levelling(to_plane, shape)
    if change is None:
        return None
    levelled = [normalised(change @ matrix) for matrix in to_plane]
    if any(is_stretched(matrix, shape) for matrix in levelled):
        return None
    return change if _stretch(levelled[-1], shape) < _LESS * _stretch(newest, shape) else None


def _stretch(to_plane: FloatArray, shape: tuple[int, int]) -> float:
    """How far a frame's scale or depths are from even, 1 or more."""
    scale = max(1e-9, scale_change(to_plane, shape))
    return max(scale, 1 / scale, depth_ratio(to_plane, shape))


def levelling(to_plane: Sequence[FloatArray], shape: tuple[int, int]) -> FloatArray | None:
    """The change of the plane after which all frames have about the same scale; None where there is none.

    Tilts of photographs average out over a survey, while that of the first one, which the plane has,
    stretches the ground ever more with the distance from it. Heights are assumed to vary about a mean.

    Args:
        to_plane: float64[3, 3] of each keyframe.
        shape: of the frames.

    Returns:
        float64[3, 3], old plane to new; the scale at the middle of the keyframes stays.
    """
    points = np.concatenate([corners(shape), centre(shape)[np.newaxis]])
    places = np.concatenate([project(matrix, points) for matrix in to_plane])
    logs = np.concatenate([_log_scales(matrix, points) for matrix in to_plane])
    if not np.isfinite(logs).all():
        return None
    middle = places.mean(axis=0)
    size = max(1.0, float(np.abs(places - middle).max()))
    x, y = ((places - middle) / size).T
    tilt = np.zeros(2)
    for _ in range(_ITERATIONS):
        depth = 1 + tilt[0] * x + tilt[1] * y
        rest = logs - 1.5 * np.log(depth)
        slopes = np.stack([1.5 * x / depth, 1.5 * y / depth, np.ones_like(x)], axis=1)
        solved, *_ = np.linalg.lstsq(slopes, rest, rcond=None)
        step = solved[:2]
        tilt = tilt + step * min(1.0, _LARGEST_STEP / max(1e-9, float(np.abs(step).sum())))
        if not (1 + tilt[0] * x + tilt[1] * y).min() > 0:
            return None
    matrix = np.eye(3)
    matrix[2, :2] = tilt / size
    return normalised(matrix @ translation(-middle))


def _log_scales(matrix: FloatArray, points: FloatArray) -> FloatArray:
    """Logarithm of a homography's linear magnification at some points; NaN behind the camera."""
    depths = points @ matrix[2, :2] + matrix[2, 2]
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(0.5 * np.log(np.linalg.det(matrix) / depths**3))
