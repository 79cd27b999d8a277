"""Scaled, cropped and flipped images: points, rotated boxes and homographies."""

from __future__ import annotations

import numpy as np

from streamkit.geometry.homography import FloatArray, normalised


def scaling_homography(before: tuple[int, int], after: tuple[int, int]) -> FloatArray:
    """Maps pixels of an image to pixels of the scaled image; the borders coincide.

    Args:
        before: width and height, px.
        after: width and height of the scaled image, px.

    Returns:
        float64[3, 3], axis-parallel.
    """
    across, down = after[0] / before[0], after[1] / before[1]
    return np.array([[across, 0.0, (across - 1.0) / 2.0], [0.0, down, (down - 1.0) / 2.0], [0.0, 0.0, 1.0]])


def scale_points(scaling: FloatArray, points: FloatArray) -> FloatArray:
    """Points, float64[n, 2] x y, of an image in pixels of the one that an affine map makes of it."""
    return scale_vectors(scaling, points) + scaling[:2, 2]


def scale_vectors(scaling: FloatArray, vectors: FloatArray) -> FloatArray:
    """Differences of points, float64[n, 2] x y, of an image in pixels of the mapped one."""
    return vectors[:, :1] * scaling[:2, 0] + vectors[:, 1:] * scaling[:2, 1]


def scale_boxes(
    scaling: FloatArray, lengths: FloatArray, widths: FloatArray, angles: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Lengths, widths and angles of rotated boxes, float64[n] each, in the mapped image."""
    cos, sin = np.cos(angles), np.sin(angles)
    along = scale_vectors(scaling, np.column_stack([cos, sin]))
    across = scale_vectors(scaling, np.column_stack([-sin, cos]))
    return (
        lengths * np.hypot(along[:, 0], along[:, 1]),
        widths * np.hypot(across[:, 0], across[:, 1]),
        np.arctan2(along[:, 1], along[:, 0]),
    )


def scale_homographies(
    scaling: FloatArray, previous_scaling: FloatArray, to_previous: FloatArray, to_reference: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Homographies of a frame in pixels of the scaled frames; non-finite ones are unchanged.

    Args:
        scaling: float64[3, 3], maps pixels of the frame to the scaled, cropped or flipped frame.
        previous_scaling: the same for the previous frame.
        to_previous: float64[3, 3], maps pixels of the frame to the previous frame.
        to_reference: float64[3, 3], maps pixels of the frame to a plane that is not scaled.

    Returns:
        The same two for the scaled frames, each with 1 as its last element.
    """
    inverse = np.linalg.inv(scaling)
    found = previous_scaling @ to_previous @ inverse, to_reference @ inverse
    first, second = (normalised(matrix) if np.isfinite(matrix).all() else matrix for matrix in found)
    return first, second
