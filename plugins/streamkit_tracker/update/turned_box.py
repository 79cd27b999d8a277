"""Turned windows that fill an upright box, by the direction of motion."""

from __future__ import annotations

import math

import numpy as np

from streamkit_kernels import compiled
from streamkit_tracker.window_geometry import MINIMUM_SIDE, FloatArray, half_turn

KNOWN_SPEED = 3.0  # standard deviations of the speed from which its direction is known
LEAST_SPEED = 0.3  # sides per second, likewise
LEAST_HEADING_STD = 0.08  # rad
USUAL_ASPECT = 2.0
ASPECT_WEIGHT = 0.3
LARGEST_ASPECT = 5.0
LEAST_AGREEMENT = 0.8


@compiled
def window_shape(box_width: float, box_height: float, heading: float) -> tuple[float, float]:
    """Length along the heading and width across it, of a rectangle that fills an upright box.

    Box width = length |cos| + width |sin|, box height = length |sin| + width |cos|. Near 45 degrees the
    two equations are one; there a weak pull towards a length of twice the width decides.

    Args:
        box_width: of the upright box, px.
        box_height: likewise, px.
        heading: direction of the length, rad.

    Returns:
        Length and width, px.
    """
    cosine, sine = abs(math.cos(heading)), abs(math.sin(heading))
    pull = ASPECT_WEIGHT**2
    diagonal_length, diagonal_width = 1 + pull, 1 + pull * USUAL_ASPECT**2
    mixed = 2 * cosine * sine - pull * USUAL_ASPECT
    along = cosine * box_width + sine * box_height
    across = sine * box_width + cosine * box_height
    determinant = diagonal_length * diagonal_width - mixed**2
    length = (diagonal_width * along - mixed * across) / determinant
    width = (diagonal_length * across - mixed * along) / determinant
    side = max(math.sqrt(max(box_width * box_height, 1.0)), MINIMUM_SIDE)
    length = min(max(length, 0.3 * side, MINIMUM_SIDE), LARGEST_ASPECT * side)
    width = min(max(width, length / LARGEST_ASPECT, MINIMUM_SIDE), 2.0 * side)
    return length, width


@compiled
def window_turn(box_width: float, box_height: float, heading: float) -> tuple[float, float, float]:
    """Length, width and angle of the window in an upright box: turned into the motion, where that can be.

    A car from above fills its box turned; a person who walks upright through a slanted view does not: no
    rectangle along the motion has that box. Then the box itself is the window.

    Args:
        box_width: of the upright box, px.
        box_height: likewise, px.
        heading: direction of motion, rad.

    Returns:
        Length and width, px, and the angle, rad.
    """
    length, width = window_shape(box_width, box_height, heading)
    cosine, sine = abs(math.cos(heading)), abs(math.sin(heading))
    sides = (length * cosine + width * sine, length * sine + width * cosine)
    common = min(sides[0], box_width) * min(sides[1], box_height)
    if common < LEAST_AGREEMENT * (sides[0] * sides[1] + box_width * box_height - common):
        return box_width, box_height, 0.0
    return length, width, half_turn(heading)


@compiled
def motion_heading(mean: FloatArray, covariance: FloatArray, side: float) -> tuple[float, float]:
    """Direction of motion in the frame and its standard deviation, rad; NaN and infinite while unknown.

    Args:
        mean: float64[4] of one state.
        covariance: float64[4, 4].
        side: of the target, px: what moves slowly for its size may turn on the spot.
    """
    across, down = mean[2], mean[3]
    speed = np.hypot(across, down)
    deviation = np.sqrt((covariance[2, 2] + covariance[3, 3]) / 2)
    if speed < KNOWN_SPEED * deviation or speed < LEAST_SPEED * side:
        return np.nan, np.inf
    return np.arctan2(down, across), max(LEAST_HEADING_STD, 1.5 * deviation / speed)
