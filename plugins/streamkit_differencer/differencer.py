"""One frame through the differencer: reduce, place on the canvas, update the model, find objects."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, cast

import cv2
import numpy as np

from streamkit_differencer.anchor import Anchor, Change, Motion, Place, map_points, translation
from streamkit_differencer.model import BackgroundModel, Event, ModelSettings
from streamkit_differencer.objects import NOTHING, Objects, ObjectSettings, find_objects

if TYPE_CHECKING:
    from numpy.typing import NDArray

    ByteImage = NDArray[np.uint8]
    Matrix = NDArray[np.float64]
    Region = tuple[slice, slice]

# The outermost pixels of a warped frame mix with the border.
BORDER_PX = 2
# Smaller frames, in working pixels, are worked on at full resolution.
SMALLEST_WORKING = 8
# A place within this distance of whole pixels needs no interpolation.
WHOLE_PIXEL_PX = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """What one frame gave.

    Attributes:
        objects: what moves, in frame pixels.
        foreground: uint8[h, w] at working resolution in the frame's own grid: 0, 128 or 255.
        change: what happened to the canvas.
        event: what happened to the model.
    """

    objects: Objects
    foreground: ByteImage
    change: Change = Change.NONE
    event: Event = Event.NONE


@dataclass(slots=True)
class Differencer:
    """Finds what moves in a sequence of frames of one size.

    Attributes:
        scale: frame pixels per working pixel: 1, 2 or 4.
        model_settings: see `ModelSettings`; may be replaced between frames, but for the interval, the number
            of quiet frames and `three_frame`, which hold until the next reset.
        object_settings: see `ObjectSettings`; may be replaced between frames.
    """

    scale: int = 2
    model_settings: ModelSettings = field(default_factory=ModelSettings)
    object_settings: ObjectSettings = field(default_factory=ObjectSettings)
    _shape: tuple[int, int] | None = None
    _grid: int = 1
    _anchor: Anchor | None = None
    _model: BackgroundModel | None = None

    def reset(self) -> None:
        """Forgets the scene: the next frame begins a new model."""
        self._anchor = self._model = None

    def miss(self) -> None:
        """Leaves a frame out: the model is held as it is."""
        if self._anchor is not None:
            self._anchor.miss()

    def update(self, image: ByteImage, motion: Motion | None) -> Result | None:
        """Takes in one frame.

        Args:
            image: uint8[h, w], brightness at full resolution.
            motion: how the frame was registered; None for a camera that does not move.

        Returns:
            None if the frame could not be placed; the model is then held.
        """
        if image.shape != self._shape:
            self.reset()
            self._shape = cast("tuple[int, int]", image.shape)
            self._grid = self.scale if min(image.shape) >= SMALLEST_WORKING * self.scale else 1
        working = reduced(image, self._grid)
        if self._model is not None:
            self._model.settings = self.model_settings
        if motion is None:
            return self._fixed(working)
        return self._moving(working, motion)

    def _fixed(self, working: ByteImage) -> Result:
        if self._anchor is not None or self._model is None:
            self._anchor, self._model = None, BackgroundModel(size_of(working), self.model_settings)
        everything = np.s_[: working.shape[0], : working.shape[1]]
        mask, event = self._model.update(working, np.full_like(working, 255), everything)
        return Result(find_objects(mask, self._grid, self.object_settings), mask, event=event)

    def _moving(self, working: ByteImage, motion: Motion) -> Result | None:
        if self._anchor is None or self._model is None:
            self._anchor = Anchor(size_of(working), self._grid)
            self._model = BackgroundModel(self._anchor.canvas_size, self.model_settings)
        place = self._anchor.place(motion)
        if place is None:
            self.miss()
            return None
        self._follow(self._model, place)
        warped, seen, region = on_canvas(working, place.working_to_canvas, self._model.size)
        mask, event = self._model.update(warped, seen, region)
        if not cv2.countNonZero(mask):
            return Result(NOTHING, np.zeros_like(working), place.change, event)
        mask = in_frame(mask, region, place.working_to_canvas, size_of(working))
        return Result(find_objects(mask, self._grid, self.object_settings), mask, place.change, event)

    @staticmethod
    def _follow(model: BackgroundModel, place: Place) -> None:
        match place.change:
            case Change.NEW:
                model.reset()
            case Change.SCROLL:
                model.scroll(round(place.canvas_change[0, 2]), round(place.canvas_change[1, 2]))
            case Change.REANCHOR:
                model.warp(place.canvas_change)
            case Change.NONE:
                pass


def size_of(image: ByteImage) -> tuple[int, int]:
    """Width and height."""
    return image.shape[1], image.shape[0]


def reduced(image: ByteImage, scale: int) -> ByteImage:
    """Averages squares of `scale` by `scale` pixels; what is left over at the right and below is cut off."""
    while scale > 1:
        height, width = image.shape[0] // 2, image.shape[1] // 2
        whole = image[: 2 * height, : 2 * width]
        image = cast("ByteImage", cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA))
        scale //= 2
    return image


def on_canvas(
    working: ByteImage, place: Matrix, canvas_size: tuple[int, int]
) -> tuple[ByteImage, ByteImage, Region]:
    """Resamples a frame onto the part of the canvas that it covers.

    Args:
        working: uint8[h, w], the frame at working resolution.
        place: float64[3, 3], working pixels to canvas.
        canvas_size: width and height, px.

    Returns:
        The frame on the canvas, the mask of what it covers, both uint8 of the region's shape, and the region.
    """
    width, height = size_of(working)
    outline = np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], np.float64)
    corners = map_points(place, outline)
    left, top = np.clip(np.floor(corners.min(axis=0)).astype(int), 0, canvas_size)
    right, bottom = np.clip(np.ceil(corners.max(axis=0)).astype(int) + 1, 0, canvas_size)
    region = np.s_[top:bottom, left:right]
    local = translation(-left, -top) @ place
    size = int(right - left), int(bottom - top)
    shifted = corners - [left, top]
    if size == (width, height) and np.abs(shifted - outline).max() <= WHOLE_PIXEL_PX:
        seen = np.full_like(working, 255)
        return working, seen, region
    warped = cv2.warpPerspective(
        working, local, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    inner = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]], np.float64) * BORDER_PX
    seen = np.zeros((size[1], size[0]), np.uint8)
    cv2.fillConvexPoly(seen, np.round(map_points(local, outline + inner)).astype(np.int32), 255)
    return cast("ByteImage", warped), seen, region


def in_frame(mask: ByteImage, region: Region, place: Matrix, size: tuple[int, int]) -> ByteImage:
    """The canvas's foreground in the frame's own grid, by nearest neighbour: uint8 of the frame's shape."""
    local = translation(-region[1].start, -region[0].start) @ place
    flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
    return cast("ByteImage", cv2.warpPerspective(mask, local, size, flags=flags))
