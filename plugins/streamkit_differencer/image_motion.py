"""Points, patches and motions of images, from which the camera's motion is measured."""

from __future__ import annotations

import math
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from streamkit_differencer.arrays import ByteImage, Flags, FloatArray, FloatImage

PointArray = NDArray[np.float32]

MOST_POINTS = 160
GRID = (12, 8)
MARGIN_PX = 10
FEWEST_POINTS = 16
CORNER_THRESHOLD = 8
WINDOW_PX = 17
# Smaller eigenvalue of the gradients in a window, as OpenCV scales it, at which noise of 3 grey levels
# moves a point by a sixth of a pixel.
LEAST_TEXTURE = 1.7e-4
# Cells of a 4 by 4 grid that points must lie in: a single moving object is no camera motion.
SPREAD_CELLS = 6
INLIER_PX = 1.0
# No homography is fitted where this share of the points are inliers of a similarity.
ENOUGH_SHARE = 0.8
# Patches of an image, and the least gradient in the middle of one, grey levels per px.
MOST_PATCHES = 300
PATCH_PX = 9
LEAST_GRADIENT = 4.0


def textured_patches(image: ByteImage) -> PointArray:
    """Pixels around the strongest gradient in each cell of a grid, float32[n, PATCH_PX**2, 2]."""
    smooth = cv2.GaussianBlur(image, (5, 5), 1.0)
    gradient = np.hypot(*(cv2.Sobel(smooth, cv2.CV_32F, x, 1 - x, scale=0.125) for x in (0, 1)))
    size = max(PATCH_PX, round(math.sqrt(image.size / MOST_PATCHES)))
    rows, columns = (length // size for length in image.shape)
    grid = gradient[: rows * size, : columns * size].reshape(rows, size, columns, size)
    cells = grid.swapaxes(1, 2).reshape(rows * columns, size * size)
    best = cells.argmax(axis=1)
    number = np.flatnonzero(cells.max(axis=1, initial=0.0) > LEAST_GRADIENT)
    x, y = number % columns * size + best[number] % size, number // columns * size + best[number] // size
    around = np.stack(np.meshgrid(*[np.arange(PATCH_PX) - PATCH_PX // 2] * 2), axis=-1).reshape(1, -1, 2)
    return (np.column_stack([x, y])[:, None] + around).astype(np.float32)


def normalised(patches: PointArray, image: ByteImage) -> FloatImage:
    """The image in patches, float32[n, PATCH_PX**2], each with mean 0 and sum of squares 1."""
    if not len(patches):
        return np.zeros((0, PATCH_PX**2), np.float32)
    across, down = cv2.split(patches)
    values = np.asarray(cv2.remap(image, across, down, cv2.INTER_LINEAR), np.float32)
    values -= values.mean(axis=1, keepdims=True)
    return cast("FloatImage", values / np.maximum(np.linalg.norm(values, axis=1, keepdims=True), PATCH_PX))


def corners(image: ByteImage) -> PointArray:
    """Corners spread over the image, float32[n, 2]; none where it has too little texture."""
    # Smoothed: corners of noise do not repeat.
    smooth = cv2.GaussianBlur(image, (5, 5), 1.0)
    keypoints = cv2.FastFeatureDetector.create(CORNER_THRESHOLD).detect(smooth)
    if len(keypoints) < FEWEST_POINTS:
        return np.zeros((0, 2), np.float32)
    points = np.asarray(cv2.KeyPoint.convert(keypoints), np.float32)
    strengths = np.array([keypoint.response for keypoint in keypoints])
    height, width = image.shape
    texture = cv2.cornerMinEigenVal(smooth, WINDOW_PX)
    columns, rows = np.round(points).astype(np.intp).T
    inside = texture[rows, columns] > LEAST_TEXTURE
    inside &= ((points >= MARGIN_PX) & (points < (width - MARGIN_PX, height - MARGIN_PX))).all(axis=1)
    points, strengths = points[inside], strengths[inside]
    columns, rows = GRID
    cell = (points[:, 0] * columns // width + columns * (points[:, 1] * rows // height)).astype(np.intp)
    order = np.lexsort((-strengths, cell))
    members = np.bincount(cell, minlength=columns * rows)
    rank = np.arange(len(order)) - (np.cumsum(members) - members)[cell[order]]
    kept = order[rank < max(1, MOST_POINTS // max(1, int(np.count_nonzero(members))))]
    chosen = points[kept]
    return chosen if is_spread(chosen, image.shape) else np.zeros((0, 2), np.float32)


def is_spread(points: PointArray, shape: tuple[int, ...]) -> bool:
    """Whether there are enough points in enough parts of the image."""
    if len(points) < FEWEST_POINTS:
        return False
    cells = np.floor(points * 4 / (shape[1], shape[0])).astype(int)
    return len(np.unique(cells[:, 0] + 4 * cells[:, 1])) >= SPREAD_CELLS


def similarity_or_homography(source: PointArray, target: PointArray) -> tuple[FloatArray | None, Flags]:
    """The motion with the most inliers: a homography only where it has clearly more than a similarity.

    A similarity is robust to few or unevenly spread points; a camera that tilts needs eight parameters.

    Returns:
        float64[3, 3], source to target, or None; and bool[n], its inliers.
    """
    best: FloatArray | None = None
    inliers: Flags = np.zeros(len(source), bool)
    score = 0.0
    for is_similarity in (True, False):
        if is_similarity:
            candidate, _ = cv2.estimateAffinePartial2D(
                source, target, ransacReprojThreshold=INLIER_PX, maxIters=200
            )
        else:
            candidate, _ = cv2.findHomography(source, target, cv2.RANSAC, INLIER_PX, maxIters=200)
        if candidate is None or not np.isfinite(candidate).all():
            continue
        matrix = np.eye(3)
        matrix[: candidate.shape[0]] = candidate
        error = np.linalg.norm(transformed(matrix, source) - target, axis=1)
        # Half the threshold: residuals of the wrong model often stay below the whole of it.
        near = np.count_nonzero(error <= 0.5 * INLIER_PX)
        if near > score:
            best, inliers, score = matrix, error <= INLIER_PX, 1.1 * near
        if score > ENOUGH_SHARE * len(source):
            break
    return best, inliers


def transformed(matrix: FloatArray, points: PointArray) -> PointArray:
    """float32[n, 2] points under a homography."""
    return cast("PointArray", cv2.perspectiveTransform(points[None], matrix)[0])


def corner_distance(first: FloatArray, second: FloatArray, shape: tuple[int, ...]) -> float:
    """Largest distance, along an axis, of an image corner under two homographies, px."""
    height, width = shape[:2]
    outline = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
    return float(np.abs(transformed(first, outline) - transformed(second, outline)).max())
