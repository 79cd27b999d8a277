"""Where each frame lies on the canvas that the background model is drawn on.

The model stays put and only the current frame is resampled onto it: a model warped from frame to frame blurs
away within a second. The canvas is the picture of one frame, the anchor, with a margin around it. When a
frame leaves the margin, the canvas scrolls by whole pixels, which loses nothing; when the scale or the shape
changed too much for that, the model is warped once onto the canvas of a new anchor.

Coordinates: frame pixels at full resolution; working pixels, `scale` times coarser; canvas pixels. In each,
(0, 0) is the centre of the top-left pixel. Homographies are float64[3, 3].
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Matrix = NDArray[np.float64]

MARGIN_RATIO = 0.12
AREA_RATIO_LIMITS = (0.8, 1.25)
# A plane that is adjusted (bundle adjustment) moves old frames by a pixel or more between two frames; chained
# registration of neighbours does not. A larger step than this, in working pixels, is taken for an adjustment.
ADJUSTMENT_PX = 0.25
# Between a plane in kilometres per pixel and one in hundredths of a pixel; beyond lies a degenerate matrix.
DETERMINANT_LIMITS = (1e-8, 1e8)


class Change(enum.StrEnum):
    """What happens to the canvas at a frame."""

    NONE = "none"
    NEW = "new"
    SCROLL = "scroll"
    REANCHOR = "reanchor"


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """How a frame was registered, in pixels of frames at full resolution.

    Attributes:
        to_reference: float64[3, 3], this frame to the reference plane.
        to_previous: float64[3, 3], this frame to the one before it; None if that one was not seen here.
        reference: number of the plane.
        reference_change: float64[3, 3], old plane to new, where the plane changes at this frame, else None.
    """

    to_reference: Matrix
    to_previous: Matrix | None = None
    reference: int = 0
    reference_change: Matrix | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """Where a frame lies on the canvas.

    Attributes:
        change: what happened to the canvas for this frame's sake, before it was placed.
        canvas_change: float64[3, 3], canvas before to canvas after; a translation by whole pixels for a
            scroll, the identity for none and new.
        working_to_canvas: float64[3, 3], the frame's working pixels to the canvas.
    """

    change: Change
    canvas_change: Matrix
    working_to_canvas: Matrix


def working_to_frame(scale: int) -> Matrix:
    """float64[3, 3]: working pixels to frame pixels; averaging 2 by 2 moves the centres by half a pixel."""
    offset = (scale - 1) / 2
    return np.array([[scale, 0.0, offset], [0.0, scale, offset], [0.0, 0.0, 1.0]])


def translation(dx: float, dy: float) -> Matrix:
    """float64[3, 3]: the homography of a shift."""
    return np.array([[1.0, 0.0, dx], [0.0, 1.0, dy], [0.0, 0.0, 1.0]])


def is_sane(homography: Matrix) -> bool:
    """Whether a matrix is a finite homography with an inverse that can be trusted."""
    if homography.shape != (3, 3):
        return False
    a, b, c, d, e, f, g, h, last = homography.ravel().tolist()
    if not all(map(math.isfinite, (a, b, c, d, e, f, g, h, last))) or last == 0.0:
        return False
    # Of the matrix whose last element is 1.
    determinant = a * (e * last - f * h) - b * (d * last - f * g) + c * (d * h - e * g)
    smallest, largest = DETERMINANT_LIMITS
    return smallest < abs(determinant / last / last / last) < largest


def map_points(homography: Matrix, points: Matrix) -> Matrix:
    """float64[n, 2] points under a homography; points on its horizon become infinite or huge."""
    projected = points @ homography[:, :2].T + homography[:, 2]
    # `all` takes ten times as long on a handful of points.
    if np.count_nonzero(projected[:, 2]) == len(projected):
        return projected[:, :2] / projected[:, 2:]
    with np.errstate(divide="ignore", invalid="ignore"):
        return projected[:, :2] / projected[:, 2:]


@dataclass(slots=True)
class Anchor:
    """Keeps the canvas under the frames.

    Attributes:
        working_size: width and height of a frame, working px.
        scale: frame pixels per working pixel.
        canvas_size: width and height of the canvas, px.
    """

    working_size: tuple[int, int]
    scale: int
    canvas_size: tuple[int, int] = field(init=False)
    _margin: tuple[int, int] = field(init=False)
    _plane_to_canvas: Matrix | None = None
    _previous: Matrix | None = None
    _reference: int = 0
    _outline: Matrix = field(init=False)
    _grid: Matrix = field(init=False)
    _from_grid: Matrix = field(init=False)

    def __post_init__(self) -> None:
        width, height = self.working_size
        self._outline = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float64) - 0.5
        self._grid = working_to_frame(self.scale)
        self._from_grid = np.asarray(np.linalg.inv(self._grid), np.float64)
        self._margin = math.ceil(width * MARGIN_RATIO), math.ceil(height * MARGIN_RATIO)
        self.canvas_size = width + 2 * self._margin[0], height + 2 * self._margin[1]

    def release(self) -> None:
        """Forgets the plane: the next frame becomes the anchor of a new canvas."""
        self._plane_to_canvas = None

    def miss(self) -> None:
        """Says that a frame was not placed, so that the next one's `to_previous` leads nowhere."""
        self._previous = None

    def place(self, motion: Motion) -> Place | None:
        """Places a frame, and scrolls or renews the canvas where it must.

        Returns:
            None if the registration cannot be used: not finite, singular, or with a horizon in the frame.
        """
        matrices = (motion.to_reference, motion.to_previous, motion.reference_change)
        if not all(matrix is None or is_sane(matrix) for matrix in matrices):
            return None
        on_plane = motion.to_reference @ self._grid
        if self._is_elsewhere(motion):
            return self._begin(motion, on_plane)
        assert self._plane_to_canvas is not None
        plane_to_canvas = self._plane_to_canvas
        if motion.reference_change is not None:
            plane_to_canvas = plane_to_canvas @ np.linalg.inv(motion.reference_change)
        place = normalised(self._without_adjustment(plane_to_canvas @ on_plane, motion.to_previous))
        corners = self._corners(place)
        if corners is None:
            return None
        change, canvas_change = self._canvas_change(place, corners)
        place = normalised(canvas_change @ place)
        self._plane_to_canvas = normalised(place @ np.linalg.inv(on_plane))
        self._previous, self._reference = place, motion.reference
        return Place(change, canvas_change, place)

    def _is_elsewhere(self, motion: Motion) -> bool:
        if self._plane_to_canvas is None:
            return True
        return motion.reference != self._reference and motion.reference_change is None

    def _begin(self, motion: Motion, on_plane: Matrix) -> Place | None:
        if self._corners(normalised(on_plane)) is None:
            return None
        place = translation(*self._margin)
        self._plane_to_canvas = place @ np.linalg.inv(on_plane)
        self._previous, self._reference = place, motion.reference
        return Place(Change.NEW, np.eye(3), place)

    def _without_adjustment(self, place: Matrix, to_previous: Matrix | None) -> Matrix:
        """The chained place where the reference plane was adjusted since the last frame, else `place`."""
        if self._previous is None or to_previous is None:
            return place
        chained = self._previous @ self._from_grid @ to_previous @ self._grid
        step = np.abs(map_points(place, self._outline) - map_points(chained, self._outline)).max()
        return chained if not step <= ADJUSTMENT_PX else place

    def _corners(self, place: Matrix) -> Matrix | None:
        """The frame's corners on the canvas, float64[4, 2]; None if they are not a convex quadrilateral."""
        depth = self._outline @ place[2, :2] + place[2, 2]
        if depth.min() * depth.max() <= 0.0:
            return None
        corners = map_points(place, self._outline)
        convex = cv2.isContourConvex(corners.astype(np.float32).reshape(-1, 1, 2))
        return corners if convex else None

    def _canvas_change(self, place: Matrix, corners: Matrix) -> tuple[Change, Matrix]:
        low, high = corners.min(axis=0), corners.max(axis=0)
        size = np.array(self.canvas_size, np.float64)
        area_ratio = float(cv2.contourArea(corners.astype(np.float32))) / math.prod(self.working_size)
        smallest, largest = AREA_RATIO_LIMITS
        if not (smallest <= area_ratio <= largest and (high - low <= size - 1.0).all()):
            return Change.REANCHOR, translation(*self._margin) @ np.linalg.inv(place)
        if (low >= -0.5).all() and (high <= size - 0.5).all():
            return Change.NONE, np.eye(3)
        dx, dy = np.round((size - 1.0 - low - high) / 2.0)
        return Change.SCROLL, translation(dx, dy)


def normalised(homography: Matrix) -> Matrix:
    """The homography scaled so that its last element is 1, where that is possible."""
    last = homography[2, 2]
    return homography / last if last else homography
