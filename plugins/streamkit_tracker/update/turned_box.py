"""Turned windows that fill upright boxes, by the direction of motion."""

from __future__ import annotations

import numpy as np

from streamkit_tracker.window_geometry import MINIMUM_SIDE, FloatArray, half_turn, upright_sides

KNOWN_SPEED = 3.0  # standard deviations of the speed from which its direction is known
LEAST_SPEED = 0.3  # sides per second, likewise
LEAST_HEADING_STD = 0.08  # rad
USUAL_ASPECT = 2.0
ASPECT_WEIGHT = 0.3
LARGEST_ASPECT = 5.0
LEAST_AGREEMENT = 0.8


def window_shapes(boxes: FloatArray, headings: FloatArray) -> FloatArray:
    """Lengths along the headings and widths across them, of rectangles that fill upright boxes.

    Box width = length |cos| + width |sin|, box height = length |sin| + width |cos|. Near 45 degrees the
    two equations are one; there a weak pull towards a length of twice the width decides.

    Args:
        boxes: float64[n, 2], width and height, px.
        headings: float64[n], directions of the lengths, rad.

    Returns:
        float64[n, 2], px.
    """
    cosine, sine = np.abs(np.cos(headings)), np.abs(np.sin(headings))
    pull = ASPECT_WEIGHT**2
    diagonal_length, diagonal_width = 1 + pull, 1 + pull * USUAL_ASPECT**2
    mixed = 2 * cosine * sine - pull * USUAL_ASPECT
    along = cosine * boxes[:, 0] + sine * boxes[:, 1]
    across = sine * boxes[:, 0] + cosine * boxes[:, 1]
    determinant = diagonal_length * diagonal_width - mixed**2
    length = (diagonal_width * along - mixed * across) / determinant
    width = (diagonal_length * across - mixed * along) / determinant
    side = np.maximum(np.sqrt(np.maximum(boxes.prod(axis=1), 1.0)), MINIMUM_SIDE)
    length = np.clip(length, np.maximum(0.3 * side, MINIMUM_SIDE), LARGEST_ASPECT * side)
    width = np.clip(width, np.maximum(length / LARGEST_ASPECT, MINIMUM_SIDE), 2.0 * side)
    return np.stack([length, width], axis=1)


def turned_windows(centres: FloatArray, boxes: FloatArray, headings: FloatArray) -> FloatArray:
    """Windows in upright boxes: turned into the motion, where that can be.

    A car from above fills its box turned; a person who walks upright through a slanted view does not: no
    rectangle along the motion has that box. Then the box itself is the window.

    Args:
        centres: float64[n, 2], px.
        boxes: float64[n, 2], width and height, px.
        headings: float64[n], directions of motion, rad.

    Returns:
        float64[n, 5], x y length width angle.
    """
    turned = np.column_stack([centres, window_shapes(boxes, headings), half_turn(headings)])
    sides = upright_sides(turned)
    common = np.minimum(sides, boxes).prod(axis=1)
    unlike = common < LEAST_AGREEMENT * (sides.prod(axis=1) + boxes.prod(axis=1) - common)
    turned[unlike, 2:4], turned[unlike, 4] = boxes[unlike], 0.0
    return turned


def motion_headings(
    means: FloatArray, covariances: FloatArray, windows: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Directions of motion and their standard deviations, rad; NaN and infinite while unknown.

    What moves slowly for its size may turn on the spot.

    Args:
        means: float64[n, 4] of the states.
        covariances: float64[n, 4, 4].
        windows: float64[n, 5].
    """
    speed = np.hypot(means[:, 2], means[:, 3])
    deviation = np.sqrt((covariances[:, 2, 2] + covariances[:, 3, 3]) / 2)
    least = np.maximum(KNOWN_SPEED * deviation, LEAST_SPEED * np.sqrt(windows[:, 2] * windows[:, 3]))
    known = (speed >= least) & (speed > 0)
    relative = 1.5 * deviation / np.where(known, speed, 1.0)
    headings = np.where(known, np.arctan2(means[:, 3], means[:, 2]), np.nan)
    return headings, np.where(known, np.maximum(LEAST_HEADING_STD, relative), np.inf)
