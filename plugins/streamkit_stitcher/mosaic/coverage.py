"""The ground that the frames of a plane cover, from their outlines."""

from typing import Final

import cv2
import numpy as np

from streamkit.geometry.homography import FloatArray, corners, normalised, project, to_reduced
from streamkit_stitcher.mosaic.mosaic import Mosaic, is_paintable

_FACTOR: Final = 4
_LEAST_SIDE: Final = 256


class Coverage:
    """The outlines of frames on a plane reduced by four: a sixteenth of a mosaic's work.

    Frames lower or narrower than 256 px are not reduced.

    Args:
        max_px: most px of the plane in memory.
    """

    def __init__(self, max_px: int) -> None:
        self._max_px = max_px
        self._factor = _FACTOR
        self._outlines = Mosaic(max_px // _FACTOR**2, _FACTOR)

    @property
    def is_empty(self) -> bool:
        """Whether no frame was added."""
        return self._outlines.canvas.is_empty

    @property
    def covered_px(self) -> float:
        """Covered area, px of the plane."""
        return self._outlines.covered_px * self._factor**2

    def add(self, shape: tuple[int, int], to_plane: FloatArray) -> bool:
        """Adds a frame's outline; False where a mosaic would refuse the frame, see `Mosaic.add`.

        Raises:
            OSError: a temporary file is full.
        """
        if self.is_empty and min(shape) < _LEAST_SIDE:
            self._factor = 1
            self._outlines = Mosaic(self._max_px)
        outline, matrix = self._reduced(shape), self._on_grid(shape, to_plane)
        canvas = self._outlines.canvas
        if not (is_paintable(matrix, outline) and is_paintable(canvas.from_frame(matrix), outline)):
            return False
        if not canvas.make_room(canvas.at_scale_one(project(matrix, corners(outline))), 1):
            return False
        points = project(normalised(canvas.from_plane @ matrix), corners(outline))
        left, top = np.floor(points.min(axis=0)).astype(int).tolist()
        right, bottom = (np.ceil(points.max(axis=0)).astype(int) + 1).tolist()
        inside = np.zeros((bottom - top, right - left), dtype=np.uint8)
        cv2.fillConvexPoly(inside, np.rint((points - (left, top)) * 16).astype(np.int32), 255, cv2.LINE_8, 4)
        pixels, depth = canvas.read(left, top, right - left, bottom - top)
        canvas.write(left, top, pixels, np.maximum(depth, inside))
        return True

    def uncovered(self, shape: tuple[int, int], to_plane: FloatArray) -> float:
        """Part of a frame that shows new ground, 0 to 1."""
        return self._outlines.uncovered(self._reduced(shape), self._on_grid(shape, to_plane))

    def move_plane(self, change: FloatArray) -> None:
        """Follows a change of the plane, float64[3, 3] old to new."""
        self._outlines.canvas.move_plane(to_reduced(change, self._factor))

    def close(self) -> None:
        """Releases the canvas."""
        self._outlines.canvas.close()

    def _reduced(self, shape: tuple[int, int]) -> tuple[int, int]:
        """Rows and columns of a reduced frame."""
        return max(1, shape[0] // self._factor), max(1, shape[1] // self._factor)

    def _on_grid(self, shape: tuple[int, int], to_plane: FloatArray) -> FloatArray:
        """float64[3, 3] from the reduced frame to the reduced plane."""
        height, width = self._reduced(shape)
        across, down = shape[1] / width, shape[0] / height
        enlarged = np.array([[across, 0, (across - 1) / 2], [0, down, (down - 1) / 2], [0, 0, 1]])
        offset = (1 - self._factor) / 2
        reduced_for = np.array([[1, 0, offset], [0, 1, offset], [0, 0, self._factor]])
        return np.asarray(reduced_for @ to_plane @ enlarged, dtype=np.float64)
