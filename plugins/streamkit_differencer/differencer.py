"""Processing of one frame: downsample, place, update the model, extract objects, score and refine them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from streamkit.geometry.homography import corners, inverse, project, translation
from streamkit_differencer.arrays import ByteImage, FloatArray, Slices
from streamkit_differencer.camera_motion import CameraMotion
from streamkit_differencer.canvas import STILL, Canvas, CanvasChange, FramePosition, Motion, working_to_frame
from streamkit_differencer.cleaning import cleaned
from streamkit_differencer.confidence import Persistence, confidence, contrasts
from streamkit_differencer.cuts import Cut, CutDetector
from streamkit_differencer.filters.parallax import SMALLEST_STEP_PX
from streamkit_differencer.model import BackgroundModel, ModelChange
from streamkit_differencer.objects import Objects, find_objects, mark_moving, most_confident
from streamkit_differencer.refinement import refine_objects
from streamkit_differencer.sampling import warp_frame, warp_mask_back
from streamkit_differencer.settings import DifferencerSettings
from streamkit_differencer.trimming import HALO_SHARE, SHADOW_SHARE, object_contrasts, trim
from streamkit_kernels import prepare

# The outermost pixels of a warped frame mix with the border.
BORDER_PX = 2
INWARDS = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]], np.float64)
# Smaller frames, in working pixels, are processed at full resolution.
SMALLEST_WORKING = 8
# A frame within this distance of whole canvas pixels is not interpolated.
WHOLE_PIXEL_PX = 0.02
# Widest frames processed at full resolution, and at half of it, px.
WIDEST_FULL, WIDEST_HALF = 640, 2048
# Objects of a frame that get a confidence; a flood of noise has more.
MOST_SCORED = 400


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """Result of one frame.

    Attributes:
        objects: moving objects, in frame pixels.
        foreground: uint8[h, w] at working resolution in the frame's own grid: 0 background, 50 shadow,
            128 stopped, 255 moving.
        change: what happened to the canvas.
        event: what happened to the model.
    """

    objects: Objects
    foreground: ByteImage
    change: CanvasChange = CanvasChange.NONE
    event: ModelChange = ModelChange.NONE


@dataclass(slots=True)
class Differencer:
    """Detects moving objects in a sequence of frames.

    Attributes:
        settings: may be replaced between frames; working_scale, frame_interval and quiet_frames take
            effect at the next reset.
        own_motion: whether the camera motion is measured here for frames without registration; else they
            count as those of a fixed camera.
        region: uint8[h, w] of the frames' size, 255 where objects are searched; None for everywhere.
    """

    settings: DifferencerSettings = field(default_factory=DifferencerSettings)
    own_motion: bool = False
    region: ByteImage | None = None
    _shape: tuple[int, int] | None = None
    _scale: int = 1
    _is_registered: bool = False
    _canvas: Canvas | None = None
    _model: BackgroundModel | None = None
    _camera: CameraMotion = field(default_factory=CameraMotion)
    _cuts: CutDetector = field(default_factory=CutDetector)
    _persistence: Persistence = field(default_factory=Persistence)
    # Centres of the last frames on the canvas, px.
    _centres: list[FloatArray] = field(default_factory=list)
    _pairs: NDArray[np.uint16] = field(default_factory=lambda: np.empty((0, 0), np.uint16))

    def reset(self) -> None:
        """Discards the model: the next frame starts a new one."""
        self._forget()
        self._cuts.reset()

    def _forget(self) -> None:
        self._canvas = self._model = None
        self._camera.reset()

    def miss(self) -> None:
        """Skips a frame: the model stays as it is."""
        if self._canvas is not None:
            self._canvas.skip()

    def update(self, image: ByteImage, motion: Motion | None) -> Result | None:
        """Processes one frame.

        Args:
            image: uint8[h, w], luma at full resolution.
            motion: registration of the frame, or None.

        Returns:
            None if the frame could not be placed; the model then stays as it is.
        """
        if image.shape != self._shape:
            self.reset()
            self._shape = cast("tuple[int, int]", image.shape)
            wanted = self.settings.working_scale or automatic_scale(image.shape[1])
            self._scale = wanted if min(image.shape) >= SMALLEST_WORKING * wanted else 1
        working = downsampled(image, self._scale)
        # An element that registers frames reports cuts, too.
        cut = Cut.NONE if motion else self._cuts.update(working, self.settings.background.frame_threshold)
        if cut is Cut.SUSPECTED:
            self.miss()
            return None
        if cut is Cut.CONFIRMED:
            self._forget()
        if self._model is not None:
            self._model.settings = self.settings.background
        self._is_registered = motion is not None
        if motion is None and self.own_motion:
            motion = self._measured(working)
            if motion is None:
                self.miss()
                return None
        result = (
            self._update_fixed(image, working)
            if motion is None
            else self._update_moving(image, working, motion)
        )
        return result if cut is Cut.NONE or result is None else replace(result, event=ModelChange.RESET)

    def _measured(self, working: ByteImage) -> Motion | None:
        placed = self._camera.place(working)
        if placed is None:
            return None
        grid = working_to_frame(self._scale)
        # Negative numbers keep these planes apart from those of a registration.
        return Motion(grid @ placed @ np.linalg.inv(grid), reference=-1 - self._camera.plane)

    def _update_fixed(self, image: ByteImage, working: ByteImage) -> Result:
        if self._canvas is not None or self._model is None:
            self._canvas, self._model = None, self._new_model((working.shape[1], working.shape[0]))
        frame = self._model.next_frame()
        frame.image[:], frame.seen[:] = working, 255
        whole = np.s_[0 : working.shape[0], 0 : working.shape[1]]
        mask, event = self._model.update(whole, is_resampled=False)
        return self._objects(image, working, mask, np.eye(3), STILL, event, 1.0)

    def _update_moving(self, image: ByteImage, working: ByteImage, motion: Motion) -> Result | None:
        if self._canvas is None or self._model is None:
            self._canvas = Canvas((working.shape[1], working.shape[0]), self._scale)
            self._model = self._new_model(self._canvas.size)
        position = self._canvas.place(motion)
        if position is None:
            self.miss()
            return None
        self._follow(self._model, position)
        to_canvas = position.working_to_canvas
        if self._pairs.shape != working.shape:
            self._pairs = np.empty(working.shape, np.uint16)
        region, is_resampled = draw_on_canvas(working, to_canvas, self._model, self._pairs)
        parallax = self._parallax(self._model, to_canvas, working.shape)
        found, event = self._model.update(region, parallax, is_resampled)
        to_region = translation(np.array([-region[1].start, -region[0].start])) @ to_canvas
        mask = np.empty_like(working)
        warp_mask_back(found, to_region, inverse(to_region), mask)
        return self._objects(image, working, mask, to_region, position, event, motion.quality)

    def _new_model(self, size: tuple[int, int]) -> BackgroundModel:
        self._persistence, self._centres = Persistence(), []
        return BackgroundModel(size, self.settings.background, self._scale)

    def _parallax(
        self, model: BackgroundModel, working_to_canvas: FloatArray, shape: tuple[int, ...]
    ) -> FloatArray | None:
        """Vector on the canvas, px, to where tall objects may have shifted from; None for no shift."""
        self._centres.append(project(working_to_canvas, np.array([[shape[1], shape[0]]]) / 2)[0])
        del self._centres[: -self.settings.background.frame_interval - 1]
        step = self._centres[-1] - self._centres[0]
        if np.hypot(*step) < SMALLEST_STEP_PX:
            return None
        if self._is_registered:
            # A flight comes to new ground all the time: its first second is not worth the ghosts.
            model.begins_at_once = False
        return step * self.settings.objects.parallax if self.settings.objects.parallax > 0.0 else None

    def _objects(
        self,
        image: ByteImage,
        working: ByteImage,
        mask: ByteImage,
        to_region: FloatArray,
        position: FramePosition,
        event: ModelChange,
        registration: float,
    ) -> Result:
        """The objects of a frame with confidences, refined at full resolution.

        `to_region`, float64[3, 3], maps working pixels to those of the model's region of the frame.
        """
        settings, scale, model = self.settings.objects, self._scale, self._model
        assert model is not None
        mask = cleaned(mask, settings.median // scale, settings.fill_holes)
        if self.region is not None:
            size = mask.shape[1], mask.shape[0]
            mask = mask & cast("ByteImage", cv2.resize(self.region, size, interpolation=cv2.INTER_NEAREST))
        contrast = object_contrasts(mask, working, model.background, to_region)
        trim(mask, working, *contrast, 0.0, SHADOW_SHARE)
        objects = find_objects(mask, scale, settings, max(settings.max_objects, MOST_SCORED))
        from_frame = np.linalg.inv(working_to_frame(scale))
        to_canvas, to_background = position.working_to_canvas @ from_frame, to_region @ from_frame
        ages = self._persistence.update(mapped_boxes(to_canvas, objects.boxes))
        clearness = contrasts(objects.boxes, to_background, *model.compared)
        objects = replace(objects, confidences=confidence(clearness, ages, registration))
        objects = most_confident(objects, settings.max_objects)
        refined = refine_objects(objects, image, model.background, to_background, mask, scale)
        if model.tolerance > 0:
            # Small objects are found with their halo.
            trim(mask, working, *contrast, HALO_SHARE, 0.0)
        mark_moving(mask, objects, scale)
        return Result(refined, mask, position.change, event)

    def _follow(self, model: BackgroundModel, position: FramePosition) -> None:
        """Moves what is kept on the canvas along with it."""
        change = position.canvas_change
        match position.change:
            case CanvasChange.NEW:
                model.reset()
                self._persistence, self._centres = Persistence(), []
            case CanvasChange.SCROLL:
                model.scroll(round(change[0, 2]), round(change[1, 2]))
            case CanvasChange.REANCHOR:
                model.warp(change)
            case CanvasChange.NONE:
                return
        self._persistence.boxes = mapped_boxes(change, self._persistence.boxes)
        self._centres = [project(change, point[None])[0] for point in self._centres]


def automatic_scale(width: int) -> int:
    """The working scale for frames of a width, px."""
    if width <= WIDEST_FULL:
        return 1
    return 2 if width <= WIDEST_HALF else 4


def mapped_boxes(matrix: FloatArray, boxes: FloatArray) -> FloatArray:
    """Bounding boxes of boxes under a homography, float64[n, 4] x0 y0 x1 y1."""
    if not len(boxes):
        return boxes
    outlines = boxes[:, [0, 1, 2, 1, 2, 3, 0, 3]].reshape(-1, 2)
    placed = project(matrix, outlines).reshape(len(boxes), 4, 2)
    return np.hstack([placed.min(axis=1), placed.max(axis=1)])


def downsampled(image: ByteImage, scale: int) -> ByteImage:
    """Means of blocks of `scale` by `scale` pixels; the remainder at the right and bottom is cut off."""
    while scale > 1:
        height, width = image.shape[0] // 2, image.shape[1] // 2
        whole = image[: 2 * height, : 2 * width]
        image = cast("ByteImage", cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA))
        scale //= 2
    return image


def draw_on_canvas(
    working: ByteImage, to_canvas: FloatArray, model: BackgroundModel, pairs: NDArray[np.uint16]
) -> tuple[Slices, bool]:
    """Resamples a frame onto the part of the canvas that it covers.

    Args:
        working: uint8[h, w], the frame at working resolution.
        to_canvas: float64[3, 3], working pixels to canvas.
        model: owner of the canvas; the frame is drawn in its buffer for the next frame.
        pairs: uint16[h, w], scratch memory.

    Returns:
        Rows and columns of the canvas; and whether the frame was resampled.
    """
    shape = working.shape[0], working.shape[1]
    outline = corners(shape)
    placed = project(to_canvas, outline)
    low, high = placed.min(axis=0) + WHOLE_PIXEL_PX, placed.max(axis=0) - WHOLE_PIXEL_PX
    left, top = np.clip(np.floor(low), 0, model.size).astype(int).tolist()
    right, bottom = np.clip(np.ceil(high) + 1, 0, model.size).astype(int).tolist()
    region = np.s_[top:bottom, left:right]
    frame = model.next_frame()
    is_whole = np.abs(placed - [left, top] - outline).max() <= WHOLE_PIXEL_PX
    if is_whole and (bottom - top, right - left) == shape:
        frame.image[region], frame.seen[region] = working, 255
        return region, False
    warp_frame(
        np.ascontiguousarray(working), pairs, inverse(to_canvas), frame.image, (top, bottom, left, right)
    )
    # A wider border than the one that interpolation mixes with.
    inner = outline + INWARDS * BORDER_PX
    cv2.fillConvexPoly(frame.seen, np.round(project(to_canvas, inner)).astype(np.int32), 255)
    return region, True


def warm_up() -> None:
    """Compiles the kernels, or loads them from the cache, so that no frame waits for the compiler."""
    prepare("streamkit_differencer")
