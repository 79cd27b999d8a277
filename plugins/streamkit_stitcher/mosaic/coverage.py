"""The ground that the frames of a plane cover, from their outlines."""

import cv2
import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import IDENTITY, FloatArray, corners, inverse, normalised, project
from streamkit_stitcher.mosaic.frame_drawing import MAX_DISTANCE, is_paintable

# Rows and columns of the points of a frame that are looked up.
_GRID = 18, 32


class Coverage:
    """The outlines of frames on a plane.

    Attributes:
        covered_px: covered area, px of the first plane.
    """

    def __init__(self) -> None:
        self._to_first = IDENTITY
        self._from_first: list[FloatArray] = []
        self._shapes: list[tuple[int, int]] = []
        self._boxes = np.empty((0, 4))
        self.covered_px = 0.0

    @property
    def is_empty(self) -> bool:
        """Whether no frame was added."""
        return not self._shapes

    def add(self, shape: tuple[int, int], to_plane: FloatArray) -> bool:
        """Adds a frame's outline; False where a mosaic would refuse the frame, see `Mosaic.add`."""
        matrix = np.asarray(self._to_first @ to_plane)
        if not is_paintable(matrix, shape):
            return False
        outline = project(matrix, corners(shape))
        if float(np.abs(outline).max()) > MAX_DISTANCE:
            return False
        area = float(cv2.contourArea(outline.astype(np.float32)))
        self.covered_px += area * self.uncovered(shape, to_plane)
        self._from_first.append(inverse(matrix))
        self._shapes.append(shape)
        self._boxes = np.vstack([self._boxes, [*outline.min(axis=0), *outline.max(axis=0)]])
        return True

    def uncovered(self, shape: tuple[int, int], to_plane: FloatArray) -> float:
        """Part of a frame that shows new ground, 0 to 1."""
        rows, columns = (
            (np.arange(count) + 0.5) * side / count - 0.5 for count, side in zip(_GRID, shape, strict=True)
        )
        grid = np.stack(np.meshgrid(columns, rows), axis=2).reshape(-1, 2)
        points = project(normalised(self._to_first @ to_plane), grid)
        low, high = points.min(axis=0), points.max(axis=0)
        near = ((self._boxes[:, 2:] >= low) & (self._boxes[:, :2] <= high)).all(axis=1)
        for number in np.flatnonzero(near)[::-1]:
            points = points[~_inside(project(self._from_first[number], points), self._shapes[number])]
            if not len(points):
                break
        return len(points) / len(grid)

    def move_plane(self, change: FloatArray) -> None:
        """Follows a change of the plane, float64[3, 3] old to new."""
        self._to_first = normalised(self._to_first @ inverse(change))


def _inside(points: FloatArray, shape: tuple[int, int]) -> npt.NDArray[np.bool_]:
    """Points of a frame within its border."""
    return np.asarray(
        (np.abs(points + 0.5 - np.array(shape[::-1]) / 2) <= np.array(shape[::-1]) / 2).all(axis=1)
    )
