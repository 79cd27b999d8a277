"""Position of each frame on the canvas, the image plane of the background model.

The model stays fixed and only the current frame is resampled onto it: a model warped from frame to frame
blurs within a second. The canvas is the image of one frame, the anchor, with a margin around it. When a frame
leaves the margin, the canvas scrolls by whole pixels, which is lossless; when scale or shape changed too much
for that, the model is warped once onto the canvas of a new anchor.

Coordinates: frame pixels at full resolution; working pixels, `scale` times coarser; canvas pixels. In each,
(0, 0) is the centre of the top-left pixel. Homographies are float64[3, 3].
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, field

import numpy as np

from streamkit.geometry.homography import (
    IDENTITY,
    inverse,
    is_convex,
    is_invertible,
    normalised,
    polygon_area,
    project,
    translation,
)
from streamkit_differencer.arrays import FloatArray

# Of a frame's longer side; as wide on all sides, so that a view that turns stays on the canvas.
MARGIN_RATIO = 0.16
AREA_RATIO_LIMITS = (0.8, 1.25)


class CanvasChange(enum.StrEnum):
    """What happens to the canvas at a frame."""

    NONE = "none"
    NEW = "new"
    SCROLL = "scroll"
    REANCHOR = "reanchor"


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Registration of a frame, in pixels at full resolution.

    Attributes:
        to_reference: float64[3, 3], this frame to the reference plane.
        reference: number of the plane.
        reference_change: float64[3, 3], old plane to new, where the plane changes at this frame, else None.
        quality: 0 to 1.
    """

    to_reference: FloatArray
    reference: int = 0
    reference_change: FloatArray | None = None
    quality: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class FramePosition:
    """Position of a frame on the canvas.

    Attributes:
        change: what happened to the canvas before the frame was placed.
        canvas_change: float64[3, 3], canvas before to canvas after; a translation by whole pixels for a
            scroll, the identity for none and new.
        working_to_canvas: float64[3, 3], the frame's working pixels to the canvas.
    """

    change: CanvasChange
    canvas_change: FloatArray
    working_to_canvas: FloatArray


# The motion of a fixed camera.
FIXED = Motion(IDENTITY)


def working_to_frame(scale: int) -> FloatArray:
    """float64[3, 3]: working pixels to frame pixels; averaging 2 by 2 moves the centres by half a pixel."""
    offset = (scale - 1) / 2
    return np.array([[scale, 0.0, offset], [0.0, scale, offset], [0.0, 0.0, 1.0]])


@dataclass(slots=True)
class Canvas:
    """Keeps the canvas under the frames.

    Attributes:
        working_size: width and height of a frame, working px.
        scale: frame pixels per working pixel.
        size: width and height of the canvas, px.
    """

    working_size: tuple[int, int]
    scale: int
    size: tuple[int, int] = field(init=False)
    # An anchor's working pixels to the canvas.
    _margin: FloatArray = field(init=False)
    _working_to_frame: FloatArray = field(init=False)
    _outline: FloatArray = field(init=False)
    _plane_to_canvas: FloatArray | None = None
    _reference: int = 0

    def __post_init__(self) -> None:
        width, height = self.working_size
        self._outline = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float64) - 0.5
        margin = math.ceil(max(width, height) * MARGIN_RATIO)
        self._margin = translation(np.array([margin, margin]))
        self.size = width + 2 * margin, height + 2 * margin
        self._working_to_frame = working_to_frame(self.scale)

    def place(self, motion: Motion) -> FramePosition | None:
        """Places a frame; scrolls or re-anchors the canvas where needed.

        Returns:
            None if the registration is unusable: not finite, singular, or with a horizon in the frame.
        """
        matrices = motion.to_reference, motion.reference_change
        if not all(matrix is None or is_invertible(matrix) for matrix in matrices):
            return None
        on_plane, known = motion.to_reference @ self._working_to_frame, self._plane_to_canvas
        if motion.reference_change is not None and known is not None:
            known = known @ inverse(motion.reference_change)
        elif motion.reference != self._reference:
            known = None
        placed = normalised(on_plane if known is None else known @ on_plane)
        corners, depths = project(placed, self._outline), self._outline @ placed[2, :2] + placed[2, 2]
        if not (depths.min() * depths.max() > 0.0 and is_convex(corners)):
            return None
        change, canvas_change = CanvasChange.NEW, IDENTITY
        if known is not None:
            change, canvas_change = self._canvas_change(placed, corners)
        if change is not CanvasChange.NONE:
            placed = self._margin if known is None else normalised(canvas_change @ placed)
            known = normalised(placed @ inverse(on_plane))
        self._plane_to_canvas, self._reference = known, motion.reference
        return FramePosition(change, canvas_change, placed)

    def _canvas_change(self, placed: FloatArray, corners: FloatArray) -> tuple[CanvasChange, FloatArray]:
        (width, height), (x, y) = self.size, corners.T.tolist()
        left, right, top, bottom = min(x), max(x), min(y), max(y)
        area_ratio = polygon_area(corners) / math.prod(self.working_size)
        smallest, largest = AREA_RATIO_LIMITS
        fits = right - left <= width - 1.0 and bottom - top <= height - 1.0
        if not (fits and smallest <= area_ratio <= largest):
            return CanvasChange.REANCHOR, self._margin @ inverse(placed)
        if min(left, top) >= -0.5 and right <= width - 0.5 and bottom <= height - 0.5:
            return CanvasChange.NONE, IDENTITY
        shift = np.array([width - 1.0 - left - right, height - 1.0 - top - bottom])
        return CanvasChange.SCROLL, translation(np.round(shift / 2.0))
