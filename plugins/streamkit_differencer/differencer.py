"""Processing of one frame: downsample, place, update the model, extract objects, score and refine them."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field, replace
from typing import NamedTuple, cast

import cv2
import numpy as np

from streamkit.geometry.homography import inverse, translation
from streamkit_differencer.arrays import ByteImage, FloatArray
from streamkit_differencer.camera_motion import CameraMotion
from streamkit_differencer.canvas import FIXED, Canvas, CanvasChange, FramePosition, Motion, working_to_frame
from streamkit_differencer.comparison import Comparison
from streamkit_differencer.confidence import Persistence, confidence, contrasts, mapped_boxes
from streamkit_differencer.cuts import Cut, CutDetector
from streamkit_differencer.filters.components import components_of
from streamkit_differencer.filters.shadow import shadow_mask
from streamkit_differencer.filters.view_motion import ViewMotionEstimator
from streamkit_differencer.foreground import SHADOW, cleaned
from streamkit_differencer.ground import UNSEEN, CanvasFrame
from streamkit_differencer.model import BackgroundModel
from streamkit_differencer.objects import Objects, find_objects, mark_moving, most_confident
from streamkit_differencer.refinement import FrameImages, refine_objects
from streamkit_differencer.sampling import downsampled, draw_on_canvas, without_hidden
from streamkit_differencer.settings import DifferencerSettings
from streamkit_differencer.splitting import split_objects
from streamkit_differencer.trimming import HALO_SHARE, SHADOW_SHARE, object_contrasts, trim
from streamkit_differencer.warping import fetch
from streamkit_kernels import prepare

# Smaller frames, in working pixels, are processed at full resolution.
MIN_WORKING_PX = 8
# Widest frames processed at full resolution, and at half of it, px.
WIDEST_FULL, WIDEST_HALF = 640, 2048
# Objects of a frame that get a confidence; a flood of noise has more.
MAX_SCORED = 400


class ModelChange(enum.StrEnum):
    """What happened to the model at a frame, besides learning."""

    NONE = "none"
    GAIN = "gain"
    RESET = "reset"


class PlacedFrame(NamedTuple):
    """A frame at both resolutions, and on the canvas.

    Attributes:
        image: uint8[h, w], luma at full resolution.
        working: uint8[h, w], at working resolution.
        on_canvas: the same on the canvas.
        to_canvas: float64[3, 3], working pixels to the canvas.
        to_region: float64[3, 3], working pixels to the part of the canvas that the frame covers.
        quality: of its registration, 0 to 1.
    """

    image: ByteImage
    working: ByteImage
    on_canvas: CanvasFrame
    to_canvas: FloatArray
    to_region: FloatArray
    quality: float


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
    change: CanvasChange
    event: ModelChange


@dataclass(slots=True)
class Differencer:
    """Detects moving objects in a sequence of frames.

    Attributes:
        settings: may be replaced between frames; working_scale, frame_interval and quiet_frames take
            effect at the next reset.
        own_motion: whether the camera motion is measured here for frames without registration; else they
            count as those of a fixed camera.
        region: uint8[h, w] of the frames' size, 255 where objects are searched; None for everywhere.
        hidden: uint8[h, w] of the frames' size, 255 where they do not show the scene; None for nowhere.
    """

    settings: DifferencerSettings = field(default_factory=DifferencerSettings)
    own_motion: bool = False
    region: ByteImage | None = None
    hidden: ByteImage | None = None
    _shape: tuple[int, int] | None = None
    _scale: int = 1
    _frame_to_working: FloatArray = field(init=False)
    _canvas: Canvas | None = None
    _model: BackgroundModel = field(init=False)
    _camera: CameraMotion = field(default_factory=CameraMotion)
    _cuts: CutDetector = field(default_factory=CutDetector)
    _persistence: Persistence = field(init=False)
    _view: ViewMotionEstimator = field(default_factory=ViewMotionEstimator)

    def reset(self) -> None:
        """Discards the model: the next frame starts a new one."""
        self._forget()
        self._cuts.reset()

    def _forget(self) -> None:
        self._canvas = None
        self._camera.reset()
        self._view = ViewMotionEstimator()

    def update(self, image: ByteImage, motion: Motion | None) -> Result | None:
        """Processes one frame.

        Args:
            image: uint8[h, w], luma at full resolution.
            motion: registration of the frame, or None.

        Returns:
            None if the frame could not be placed; the model then stays as it is.
        """
        if image.shape != self._shape:
            self._set_shape(image.shape[0], image.shape[1])
        working = downsampled(image, self._scale)
        scene = working if motion or self.hidden is None else without_hidden(working, self.hidden)
        # An element that registers frames reports cuts, too.
        cut = Cut.NONE if motion else self._cuts.update(scene, self.settings.background.frame_threshold)
        if cut is Cut.CONFIRMED:
            self._forget()
        camera_motion = None if cut is Cut.SUSPECTED else motion or self._measured(scene)
        if camera_motion is None:
            return None
        if self._canvas is None:
            self._canvas = Canvas((working.shape[1], working.shape[0]), self._scale)
        position = self._canvas.place(camera_motion)
        if position is None:
            return None
        if position.change is not CanvasChange.NONE:
            self._change_canvas(position, self._canvas.size)
        frame = self._drawn(image, working, position, motion.quality if motion else 1.0)
        background, view = self.settings.background, None
        if background.tolerance < 0:
            background = replace(background, tolerance=int(self._scale > 1))
        self._model.settings = background
        if motion:
            # A camera that is fixed, shakes or turns has no parallax; one that flies has a registration.
            interval, height = background.frame_interval, self.settings.objects.parallax
            view = self._view.update(frame.to_canvas, (working.shape[0], working.shape[1]), interval, height)
        found = self._model.update(frame.on_canvas, view)
        objects, mask = self._objects(frame, found)
        event = ModelChange.GAIN if found.follows_exposure else ModelChange.NONE
        if cut is Cut.CONFIRMED:
            event = ModelChange.RESET
        return Result(objects, mask, position.change, event)

    def _set_shape(self, height: int, width: int) -> None:
        """Takes the size of the next frames, px, and begins a new model."""
        self.reset()
        self._shape = height, width
        wanted = self.settings.working_scale or automatic_scale(width)
        self._scale = wanted if min(height, width) >= MIN_WORKING_PX * wanted else 1
        self._frame_to_working = inverse(working_to_frame(self._scale))

    def _measured(self, working: ByteImage) -> Motion | None:
        """The motion of a frame without registration; None if it is unknown."""
        if not self.own_motion:
            return FIXED
        placed = self._camera.place(working)
        if placed is None:
            return None
        to_reference = working_to_frame(self._scale) @ placed @ self._frame_to_working
        # Negative numbers keep these planes apart from those of a registration.
        return Motion(to_reference, reference=-1 - self._camera.plane)

    def _change_canvas(self, position: FramePosition, size: tuple[int, int]) -> None:
        """Begins anew on another canvas of this width and height, or moves what is kept along with it."""
        if position.change is CanvasChange.NEW:
            self._model = BackgroundModel(size, self.settings.background)
            self._persistence = Persistence()
            self._view.restart()
            return
        change = position.canvas_change
        self._model.move(change, is_scroll=position.change is CanvasChange.SCROLL)
        self._persistence.boxes = mapped_boxes(change, self._persistence.boxes)
        self._view.move(change)

    def _drawn(
        self, image: ByteImage, working: ByteImage, position: FramePosition, quality: float
    ) -> PlacedFrame:
        """The frame with its drawing on the canvas, where what is hidden is not seen."""
        to_canvas, size = position.working_to_canvas, self._model.size
        on_canvas = draw_on_canvas(working, to_canvas, size)
        if self.hidden is not None:
            hidden = cv2.warpPerspective(self.hidden, to_canvas @ self._frame_to_working, size)
            on_canvas.image[hidden > 0] = UNSEEN
        top, _, left, _ = on_canvas.bounds
        to_region = translation(np.array([-left, -top])) @ to_canvas
        return PlacedFrame(image, working, on_canvas, to_canvas, to_region, quality)

    def _objects(self, frame: PlacedFrame, found: Comparison) -> tuple[Objects, ByteImage]:
        """The objects of a frame with confidences, refined at full resolution, and the finished mask."""
        settings, scale = self.settings.objects, self._scale
        mask = self._mask(frame, found)
        blocks, count = components_of(mask)
        contrast = object_contrasts(mask, frame.working, found.background, frame.to_region, blocks, count)
        trim(mask, frame.working, blocks, *contrast, 0.0, SHADOW_SHARE)
        objects = find_objects(mask, scale, settings, max(settings.max_objects, MAX_SCORED))
        to_canvas, to_background = (
            matrix @ self._frame_to_working for matrix in (frame.to_canvas, frame.to_region)
        )
        images = FrameImages(frame.image, found.background, to_background, mask, scale)
        if scale > 1 and settings.merge_gap < 0:
            objects = split_objects(objects, images)
        ages = self._persistence.update(mapped_boxes(to_canvas, objects.boxes))
        compared = frame.on_canvas.covered, found.background, found.thresholds
        clearness = contrasts(objects.boxes, to_background, *compared)
        objects = replace(objects, confidences=confidence(clearness, ages, frame.quality))
        if len(objects) > settings.max_objects:
            objects = most_confident(objects, settings.max_objects)
        refined = refine_objects(objects, images)
        if self._model.settings.tolerance > 0:
            # Small objects are found with their halo.
            trim(mask, frame.working, blocks, *contrast, HALO_SHARE, 0.0)
        mark_moving(mask, objects, scale)
        return refined, mask

    def _mask(self, frame: PlacedFrame, found: Comparison) -> ByteImage:
        """The foreground in the frame's own grid, cleaned, with shadows, within the region of interest."""
        mask = found.mask
        if self.settings.background.shadow:
            mask[shadow_mask(frame.on_canvas.covered, found.background, mask) > 0] = SHADOW
        if frame.on_canvas.is_resampled:
            mask = fetch(mask, frame.to_region, *frame.working.shape)
        settings = self.settings.objects
        mask = cleaned(mask, settings.median // self._scale, settings.fill_holes)
        if self.region is not None:
            size = mask.shape[1], mask.shape[0]
            mask &= cast("ByteImage", cv2.resize(self.region, size, interpolation=cv2.INTER_NEAREST))
        return mask


def automatic_scale(width: int) -> int:
    """The working scale for frames of a width, px."""
    if width <= WIDEST_FULL:
        return 1
    return 2 if width <= WIDEST_HALF else 4


def warm_up() -> None:
    """Compiles the kernels, or loads them from the cache, so that no frame waits for the compiler."""
    prepare("streamkit_differencer")
