"""Corner points spread evenly over an image."""

from typing import Final

import cv2
import numpy as np

from streamkit_stitcher.homographies import FloatArray, GreyArray

_COLUMNS: Final = 16
_ROWS: Final = 9
_LOWEST_THRESHOLD: Final = 3.0
_HIGHEST_THRESHOLD: Final = 60.0
_CANDIDATES_PER_POINT: Final = 4
_MARGIN: Final = 8


class CornerDetector:
    """FAST corners, the strongest few of each cell of a 16 x 9 grid.

    The FAST threshold follows the picture's contrast: it is kept from call to call and lowered while the grid
    stays half empty, so a hazy picture gives corners and a busy one does not give thousands.

    Source: Rosten and Drummond, Machine learning for high-speed corner detection, ECCV 2006.
    """

    def __init__(self) -> None:
        self._threshold = 20.0

    def detect(self, grey: GreyArray, max_points: int) -> FloatArray:
        """Finds at most `max_points` corners.

        Args:
            grey: uint8[h, w].
            max_points: upper limit of points over the whole image.

        Returns:
            float64[n, 2], x y, ordered by cell, strongest first within a cell; n is 0 for a flat image.
        """
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
    # Responses of FAST are whole numbers below 256, so one key sorts by cell and falling strength.
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
