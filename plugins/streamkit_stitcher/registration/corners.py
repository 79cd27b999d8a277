"""Corner points spread evenly over an image."""

from typing import Final

import cv2
import numpy as np

from streamkit.geometry.homography import FloatArray, GreyArray

_MARGIN: Final = 8
_BLOCK: Final = 7
_MIN_CELL: Final = 4
_NOISE_FACTOR: Final = 2.5
_MIN_SHARE: Final = 0.35
_MIN_STRENGTH: Final = 1e-6
_LAPLACIAN: Final = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], dtype=np.float32)


def even_corners(grey: GreyArray, columns: int, rows: int) -> FloatArray:
    """The best corner of each cell of a grid, ordered by cell; none for a flat or tiny image.

    Source: Shi and Tomasi, Good features to track, CVPR 1994.
    """
    height, width = grey.shape[0] - 2 * _MARGIN, grey.shape[1] - 2 * _MARGIN
    columns, rows = min(columns, width // _MIN_CELL), min(rows, height // _MIN_CELL)
    if columns < 1 or rows < 1:
        return np.empty((0, 2))
    strength = cv2.cornerMinEigenVal(grey, _BLOCK, ksize=3)
    down, across = height // rows, width // columns
    top, left = (grey.shape[0] - rows * down) // 2, (grey.shape[1] - columns * across) // 2
    cells = strength[top : top + rows * down, left : left + columns * across]
    cells = cells.reshape(rows, down, columns, across).transpose(0, 2, 1, 3).reshape(rows * columns, -1)
    best = cells.argmax(axis=1)
    strongest = cells[np.arange(len(cells)), best]
    number = np.arange(rows * columns)
    points: FloatArray = np.stack(
        [left + number % columns * across + best % across, top + number // columns * down + best // across],
        axis=1,
    ).astype(np.float64)
    threshold = _NOISE_FACTOR * _noise_strength(grey)
    if np.count_nonzero(strongest > threshold) < _MIN_SHARE * len(strongest):
        # Fine texture everywhere raises the noise estimate.
        threshold = float(np.quantile(strongest, 1 - _MIN_SHARE))
    return np.asarray(points[strongest > max(_MIN_STRENGTH, threshold)])


def _noise_strength(grey: GreyArray) -> float:
    """The corner strength that the image noise alone would have.

    Source: Immerkaer, Fast noise variance estimation, CVIU 1996, with the median for the mean.
    """
    laplacian = cv2.filter2D(grey, cv2.CV_16S, _LAPLACIAN)[1:-1, 1:-1]
    typical = float(np.median(np.abs(laplacian)))
    # The median of Gaussian noise is 0.6745 deviations, the kernel's norm 6; gradients keep 0.75.
    return 0.75 * (typical / (0.6745 * 6)) ** 2 / 255**2
