"""One frame through the differencer: reduce, place, update the model, find objects, judge them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TYPE_CHECKING, cast

import cv2
import numpy as np

from streamkit_differencer.anchor import (
    Anchor,
    Change,
    Motion,
    Place,
    map_points,
    translation,
    working_to_frame,
)
from streamkit_differencer.camera_motion import CameraMotion
from streamkit_differencer.cleaning import cleaned
from streamkit_differencer.confidence import Persistence, confidence
from streamkit_differencer.filters.parallax import slide
from streamkit_differencer.model import BackgroundModel
from streamkit_differencer.model_settings import Event, ModelSettings
from streamkit_differencer.movers import show_movers
from streamkit_differencer.objects import Objects, ObjectSettings, find_objects, surest
from streamkit_differencer.refinement import refined
from streamkit_differencer.resampling import bounds_of
from streamkit_differencer.sampling import drawn, fetch

if TYPE_CHECKING:
    from numpy.typing import NDArray

    ByteImage = NDArray[np.uint8]
    Matrix = NDArray[np.float64]
    Slices = tuple[slice, slice]

# The outermost pixels of a warped frame mix with the border.
BORDER_PX = 2
# Smaller frames, in working pixels, are worked on at full resolution.
SMALLEST_WORKING = 8
# A place within this distance of whole pixels needs no interpolation.
WHOLE_PIXEL_PX = 0.02
AUTOMATIC_SCALE = 0
# Widest frames worked on at full resolution, and at half of it, px.
WIDEST_FULL, WIDEST_HALF = 640, 2048
# Objects of a frame that are judged at all; a flood has more.
MOST_JUDGED = 400


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """What one frame gave.

    Attributes:
        objects: what moves, in frame pixels.
        foreground: uint8[h, w] at working resolution in the frame's own grid: 0 for ground, 50 for shadow,
            128 for what has stopped, 255 for what moves.
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
        scale: frame pixels per working pixel: 1, 2, 4, or 0 to choose by the frame's width.
        model_settings: see `ModelSettings`; may be replaced between frames, but for the interval, the number
            of quiet frames and `three_frame`, which hold until the next reset.
        object_settings: see `ObjectSettings`; may be replaced between frames.
        own_motion: whether the camera's motion is measured here where a frame has no registration; else such
            frames are taken for those of a fixed camera.
        region: uint8[h, w], 255 where objects are looked for, of the frames' size; None for everywhere.
    """

    scale: int = AUTOMATIC_SCALE
    model_settings: ModelSettings = field(default_factory=ModelSettings)
    object_settings: ObjectSettings = field(default_factory=ObjectSettings)
    own_motion: bool = False
    region: ByteImage | None = None
    _shape: tuple[int, int] | None = None
    _grid: int = 1
    _anchor: Anchor | None = None
    _model: BackgroundModel | None = None
    _camera: CameraMotion = field(default_factory=CameraMotion)
    _persistence: Persistence = field(default_factory=Persistence)
    _places: list[Matrix] = field(default_factory=list)
    _pairs: NDArray[np.uint16] = field(default_factory=lambda: np.empty((0, 0), np.uint16))
    _mask: ByteImage = field(default_factory=lambda: np.empty((0, 0), np.uint8))

    def reset(self) -> None:
        """Forgets the scene: the next frame begins a new model."""
        self._anchor = self._model = None
        self._camera.reset()

    def miss(self) -> None:
        """Leaves a frame out: the model is held as it is."""
        if self._anchor is not None:
            self._anchor.miss()

    def update(self, image: ByteImage, motion: Motion | None, registration: float = 1.0) -> Result | None:
        """Takes in one frame.

        Args:
            image: uint8[h, w], brightness at full resolution.
            motion: how the frame was registered, or None.
            registration: how well that is known, 0 to 1.

        Returns:
            None if the frame could not be placed; the model is then held.
        """
        if image.shape != self._shape:
            self.reset()
            self._shape = cast("tuple[int, int]", image.shape)
            wanted = self.scale or automatic_scale(image.shape[1])
            self._grid = wanted if min(image.shape) >= SMALLEST_WORKING * wanted else 1
        working = reduced(image, self._grid)
        if self._model is not None:
            self._model.settings = self._settings
        if motion is None and self.own_motion:
            motion = self._measured(working)
            if motion is None:
                self.miss()
                return None
        if motion is None:
            return self._fixed(image, working, registration)
        return self._moving(image, working, motion, registration)

    def _measured(self, working: ByteImage) -> Motion | None:
        place = self._camera.place(working)
        if place is None:
            return None
        grid = working_to_frame(self._grid)
        # Planes counted downwards are never taken for those of a registration.
        return Motion(grid @ place @ np.linalg.inv(grid), reference=-1 - self._camera.plane)

    def _fixed(self, image: ByteImage, working: ByteImage, registration: float) -> Result:
        if self._anchor is not None or self._model is None:
            self._anchor, self._model = None, self._new_model(size_of(working))
        everything = np.s_[0 : working.shape[0], 0 : working.shape[1]]
        mask, event = self._model.update(working, np.full_like(working, 255), everything)
        return self._judged(
            image, working, mask, Place(Change.NONE, np.eye(3), np.eye(3)), event, registration
        )

    def _moving(
        self, image: ByteImage, working: ByteImage, motion: Motion, registration: float
    ) -> Result | None:
        if self._anchor is None or self._model is None:
            self._anchor = Anchor(size_of(working), self._grid)
            self._model = self._new_model(self._anchor.canvas_size)
        place = self._anchor.place(motion)
        if place is None:
            self.miss()
            return None
        self._follow(self._model, place)
        if self._pairs.shape != working.shape:
            self._pairs, self._mask = np.empty(working.shape, np.uint16), np.empty(working.shape, np.uint8)
        to_canvas = place.working_to_canvas
        to_working = inverse(to_canvas)
        warped, seen, region = on_canvas(working, to_canvas, to_working, self._model, self._pairs)
        _, event = self._model.update(warped, seen, region, self._way(to_canvas))
        bounds = bounds_of(region, self._model.size)
        fetch(self._model.marks, bounds, to_canvas, to_working, self._mask)
        return self._judged(image, working, self._mask, place, event, registration)

    def _new_model(self, size: tuple[int, int]) -> BackgroundModel:
        self._persistence, self._places = Persistence(), []
        return BackgroundModel(size, self._settings)

    @property
    def _settings(self) -> ModelSettings:
        """The model's settings with the tolerance chosen where that was left open."""
        return with_tolerance(self.model_settings, self._grid)

    def _judged(
        self,
        image: ByteImage,
        working: ByteImage,
        mask: ByteImage,
        place: Place,
        event: Event,
        registration: float,
    ) -> Result:
        """The objects of a frame, without those that are parallax, each with how sure it is."""
        settings = self.object_settings
        assert self._model is not None
        mask = cleaned(mask, settings.median_px // self._grid, settings.fill_holes)
        if self.region is not None:
            inside = cv2.resize(self.region, size_of(mask), interpolation=cv2.INTER_NEAREST)
            mask = mask & cast("ByteImage", inside)
        objects = find_objects(mask, self._grid, for_judging(settings))
        to_canvas = place.working_to_canvas @ frame_to_working(self._grid)
        boxes = mapped_boxes(to_canvas, objects.boxes)
        ages = self._persistence.update(boxes)
        contrast = self._model.contrast(objects.boxes, to_canvas)
        objects = replace(objects, confidences=confidence(contrast, ages, registration))
        objects = surest(objects, settings.max_objects)
        ground, (rows, columns) = self._model.ground
        to_ground = translation(-columns.start, -rows.start) @ to_canvas
        better = refined(objects, image, ground, to_ground, mask, self._grid)
        has_halo = self._model.settings.tolerance > 0
        from_working = to_ground @ working_to_frame(self._grid)
        show_movers(mask, objects, working, ground, from_working, self._grid, has_halo)
        return Result(better, mask, place.change, event)

    def _way(self, working_to_canvas: Matrix) -> Matrix | None:
        """Along which, on the canvas, tall things may have slid lately, px."""
        assert self._anchor is not None
        middle = np.array([self._anchor.working_size]) / 2
        self._places.append(map_points(working_to_canvas, middle)[0])
        del self._places[: -self.model_settings.interval - 1]
        return slide(self._places[-1] - self._places[0], self.object_settings.parallax)

    def _follow(self, model: BackgroundModel, place: Place) -> None:
        match place.change:
            case Change.NEW:
                model.reset()
                self._persistence, self._places = Persistence(), []
            case Change.SCROLL:
                model.scroll(round(place.canvas_change[0, 2]), round(place.canvas_change[1, 2]))
            case Change.REANCHOR:
                model.warp(place.canvas_change)
            case Change.NONE:
                return
        self._persistence.follow(lambda boxes: mapped_boxes(place.canvas_change, boxes))
        self._places = [map_points(place.canvas_change, centre[None])[0] for centre in self._places]


def automatic_scale(width: int) -> int:
    """The working scale for frames of a width: small ones keep their detail, large ones stay quick."""
    if width <= WIDEST_FULL:
        return 1
    return 2 if width <= WIDEST_HALF else 4


# Settings are the same for many frames, and a copy costs more than the frame's arithmetic on objects.
@lru_cache(maxsize=4)
def with_tolerance(settings: ModelSettings, scale: int) -> ModelSettings:
    """The settings with the tolerance chosen by the working scale where that was left open."""
    return replace(settings, tolerance=0 if scale == 1 else 1) if settings.tolerance < 0 else settings


@lru_cache(maxsize=4)
def for_judging(settings: ObjectSettings) -> ObjectSettings:
    """The settings under which no object is left out that may be among the surest."""
    return replace(settings, max_objects=max(settings.max_objects, MOST_JUDGED))


@lru_cache(maxsize=4)
def frame_to_working(scale: int) -> Matrix:
    """float64[3, 3]: frame pixels to working pixels; it is not to be written to."""
    return inverse(working_to_frame(scale))


def mapped_boxes(matrix: Matrix, boxes: Matrix) -> Matrix:
    """Boxes around boxes under a homography, float64[n, 4] x0 y0 x1 y1."""
    if not len(boxes):
        return boxes
    corners = boxes[:, [0, 1, 2, 1, 2, 3, 0, 3]].reshape(-1, 2)
    placed = map_points(matrix, corners).reshape(len(boxes), 4, 2)
    return np.hstack([placed.min(axis=1), placed.max(axis=1)])


def inverse(homography: Matrix) -> Matrix:
    """float64[3, 3]."""
    return np.asarray(np.linalg.inv(homography), np.float64)


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
    working: ByteImage, place: Matrix, to_working: Matrix, model: BackgroundModel, pairs: NDArray[np.uint16]
) -> tuple[ByteImage, ByteImage, Slices]:
    """Resamples a frame onto the part of the canvas that it covers.

    Args:
        working: uint8[h, w], the frame at working resolution.
        place: float64[3, 3], working pixels to canvas.
        to_working: float64[3, 3], its inverse.
        model: whose canvas it is; the frame is drawn in the room that it has for the next one.
        pairs: uint16[h, w], room to work in.

    Returns:
        The frame on the canvas, the mask of what it covers, both uint8 of the region's shape, and the region.
    """
    width, height = size_of(working)
    outline = np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], np.float64)
    corners = map_points(place, outline)
    left, top, right, bottom = around(corners, model.size)
    region = np.s_[top:bottom, left:right]
    shifted = corners - [left, top]
    if (right - left, bottom - top) == (width, height) and np.abs(shifted - outline).max() <= WHOLE_PIXEL_PX:
        return working, np.full_like(working, 255), region
    frame = model.room()
    drawn(np.ascontiguousarray(working), pairs, to_working, frame.image, (top, bottom, left, right))
    # What `seen` leaves out is wider than what the frame's border reaches.
    inner = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]], np.float64) * BORDER_PX
    cv2.fillConvexPoly(frame.seen, np.round(map_points(place, outline + inner)).astype(np.int32), 255)
    return frame.image[region], frame.seen[region], region


def around(points: Matrix, size: tuple[int, int]) -> tuple[int, int, int, int]:
    """Left, top, right and bottom of the whole pixels around some points, within a picture of a size."""
    (left, top), (right, bottom) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    width, height = size
    return (
        min(max(math.floor(left), 0), width),
        min(max(math.floor(top), 0), height),
        min(max(math.ceil(right) + 1, 0), width),
        min(max(math.ceil(bottom) + 1, 0), height),
    )
