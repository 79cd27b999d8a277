"""Corner points spread evenly over an image."""

from typing import Final

import cv2
import numpy as np

from streamkit.geometry.homography import FloatArray, GreyArray

_COLUMNS: Final = 16
_ROWS: Final = 9
_LOWEST_THRESHOLD: Final = 3.0
_HIGHEST_THRESHOLD: Final = 60.0
_CANDIDATES_PER_POINT: Final = 4
_MARGIN: Final = 8
_BLOCK: Final = 7
_SMALLEST_CELL: Final = 4
_NOISE_FACTOR: Final = 2.5
_MIN_SHARE: Final = 0.35
_MIN_STRENGTH: Final = 1e-6
_LAPLACIAN: Final = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], dtype=np.float32)


class CornerDetector:
    """FAST corners, the strongest few of each cell of a 16 x 9 grid.

    The threshold adapts to the contrast: it is kept from call to call, lowered while half of the grid is
    empty, and raised where there are too many corners.

    Source: Rosten and Drummond, Machine learning for high-speed corner detection, ECCV 2006.
    """

    def __init__(self) -> None:
        self._threshold = 20.0

    def detect(self, grey: GreyArray, max_points: int) -> FloatArray:
        """At most `max_points` corners by cell, strongest first within a cell; none for a flat image."""
        while True:
            points, strengths = _fast(grey, round(self._threshold))
            chosen = _strongest_per_cell(points, strengths, grey.shape, max_points)
            if len(points) > _CANDIDATES_PER_POINT * max_points:
                self._threshold = min(_HIGHEST_THRESHOLD, self._threshold * 1.25)
                return chosen
            if len(chosen) >= max_points // 2 or self._threshold <= _LOWEST_THRESHOLD:
                return chosen
            self._threshold = max(_LOWEST_THRESHOLD, self._threshold * 0.6)


def _fast(grey: GreyArray, threshold: int) -> tuple[FloatArray, FloatArray]:
    keypoints = cv2.FastFeatureDetector.create(threshold).detect(grey)
    if not keypoints:
        return np.empty((0, 2)), np.empty(0)
    points = np.asarray(cv2.KeyPoint.convert(keypoints), dtype=np.float64).reshape(-1, 2)
    strengths = np.array([keypoint.response for keypoint in keypoints])
    height, width = grey.shape
    inside = (
        (points[:, 0] >= _MARGIN)
        & (points[:, 0] < width - _MARGIN)
        & (points[:, 1] >= _MARGIN)
        & (points[:, 1] < height - _MARGIN)
    )
    return points[inside], strengths[inside]


def _strongest_per_cell(
    points: FloatArray, strengths: FloatArray, shape: tuple[int, ...], max_points: int
) -> FloatArray:
    if not len(points):
        return points
    columns = (points[:, 0] * (_COLUMNS / shape[1])).astype(np.int64)
    rows = (points[:, 1] * (_ROWS / shape[0])).astype(np.int64)
    cells = rows * _COLUMNS + columns
    # Responses of FAST are integers below 256, so one key sorts by cell and descending strength.
    order = np.argsort(cells * 256 + (255 - np.minimum(strengths, 255)), kind="stable")
    members = np.bincount(cells, minlength=_COLUMNS * _ROWS)
    starts = np.cumsum(members) - members
    rank = np.arange(len(order)) - starts[cells[order]]
    quota = -(-max_points // int(np.count_nonzero(members)))
    most_per_cell = max(1, 3 * max_points // (_COLUMNS * _ROWS))
    kept = order[rank < min(quota, most_per_cell)]
    if len(kept) > max_points:
        kept = kept[np.linspace(0, len(kept) - 1, max_points).astype(np.int64)]
    return np.asarray(points[kept], dtype=np.float64)


def even_corners(grey: GreyArray, columns: int, rows: int) -> FloatArray:
    """The best corner of each cell of a grid, ordered by cell; none for a flat or tiny image.

    Source: Shi and Tomasi, Good features to track, CVPR 1994.
    """
    height, width = grey.shape[0] - 2 * _MARGIN, grey.shape[1] - 2 * _MARGIN
    columns, rows = min(columns, width // _SMALLEST_CELL), min(rows, height // _SMALLEST_CELL)
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
