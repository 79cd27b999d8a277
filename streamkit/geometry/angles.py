"""Angles: wrapped to the interval that their meaning asks for. All in radians."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


def wrap_axis(angle: float) -> float:
    """The direction of an axis without a front, such as a box's, in [-pi/2, pi/2)."""
    return (angle + math.pi / 2) % math.pi - math.pi / 2


def wrap_axes(angles: FloatArray) -> FloatArray:
    """The directions of axes without a front, float64 of any shape, in [-pi/2, pi/2)."""
    return (angles + np.pi / 2) % np.pi - np.pi / 2


def wrap_turn(angle: float) -> float:
    """The turn of an angle, in [-pi, pi]."""
    return math.remainder(angle, 2 * math.pi)


def wrap_bearing(angle: float) -> float:
    """A compass bearing, in [0, 2 pi)."""
    return angle % (2 * math.pi)
