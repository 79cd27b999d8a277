"""The background model: equations 1 to 4 of the paper on the canvas, extended for a camera that moves.

The extensions: a pixel that is new to the canvas has no background until it was quiet; the comparison
tolerates a registration error; a stationary object becomes background after a while; a change of exposure is
followed instead of detected as motion.

Source: Zhang, Liu, Qu, "Research on Feature Extraction Method of UAV Video Image Based on Target Tracking",
section 2.2; the method is that of Collins et al., "A System for Video Surveillance and Monitoring", 2000.
Equation 1 of the paper omits a pixel that stays quiet (its counter stays 0), equation 3 applies to quiet
pixels only, and equation 4 is printed with its cases swapped: foreground is what differs from the background
as it was before this frame.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, field

import cv2
import numpy as np

from streamkit_differencer.arrays import ByteImage, FloatArray, FloatImage, Region, Slices
from streamkit_differencer.canvas_images import (
    CanvasFrame,
    FrameHistory,
    Scratch,
    allocated,
    region_of,
    scrolled,
    warped,
)
from streamkit_differencer.changes import LONGEST_WAIT, update_waiting
from streamkit_differencer.confidence import contrasts
from streamkit_differencer.filters.components import components_of, remove_components
from streamkit_differencer.filters.flicker import update_flicker
from streamkit_differencer.filters.ghost import find_ghosts
from streamkit_differencer.filters.parallax import find_parallax
from streamkit_differencer.filters.shadow import shadow_mask
from streamkit_differencer.hysteresis import hysteresis_mask, strong_mask
from streamkit_differencer.illumination import exposure_change
from streamkit_differencer.learning import learn
from streamkit_differencer.mask_values import SHADOW, set_mask_values
from streamkit_differencer.noise import LEAST_FIRST_DEVIATION, NoiseMap, first_deviation
from streamkit_differencer.noise_learning import PROVISIONAL
from streamkit_differencer.pixel_classes import classify
from streamkit_differencer.settings import BackgroundSettings

# Weight of a frame in a pixel's noise; under a camera that flies, ground is in view for seconds.
NOISE_LEARNING_RATE = 0.05
NOISE_INTERVAL = 4
# The same for pixels that were never quiet; not where more of a frame is foreground: what passes for
# background may then be part of what moves.
RESTLESS_LEARNING_RATE = 0.1
MOST_FOREGROUND = 0.3
GHOST_INTERVAL = 3
# New ground gets a provisional background every other frame: one frame later at most, for half the time.
PROVISIONAL_INTERVAL = 2
# Frames for which the noise of new ground is assumed constant.
FIRST_DEVIATION_FRAMES = 8


class Event(enum.StrEnum):
    """What happened to the model at a frame, besides learning."""

    NONE = "none"
    GAIN = "gain"
    RESET = "reset"


@dataclass(slots=True)
class BackgroundModel:
    """The state of every pixel of a canvas.

    Attributes:
        size: width and height of the canvas, px.
        settings: may be replaced between frames.
        scale: frame pixels per canvas pixel.
        begins_at_once: whether what differs from the first frames is foreground. Things in them leave ghosts
            for `quiet_frames`; without it nothing is foreground until those are gone.
        background: float32[h, w], B; undefined where it is not valid.
        noise: of each pixel of the background.
        valid: uint8[h, w], mask of the pixels whose background is known.
        standing: uint8[h, w], frames that a pixel was foreground and quiet.
        flicker: uint8[h, w], see `filters.flicker`.
        compared_background: uint8[h, w], the background that the last frame was compared with, and its region
            of the canvas.
    """

    size: tuple[int, int]
    settings: BackgroundSettings
    scale: int = 1
    begins_at_once: bool = True
    background: FloatImage = field(init=False)
    noise: NoiseMap = field(init=False)
    valid: ByteImage = field(init=False)
    standing: ByteImage = field(init=False)
    flicker: ByteImage = field(init=False)
    compared_background: tuple[ByteImage, Slices] = field(init=False)
    _waiting: ByteImage = field(init=False)
    _foreground_before: ByteImage = field(init=False)
    _frames: int = 0
    _history: FrameHistory = field(init=False)
    _scratch: Scratch = field(init=False)
    _first_deviation: float = LEAST_FIRST_DEVIATION

    def __post_init__(self) -> None:
        self._scratch = Scratch((self.size[1], self.size[0]))
        self.reset()

    def reset(self) -> None:
        """Discards everything learnt."""
        shape = self.size[1], self.size[0]
        settings = self.settings
        self._first_deviation, self._frames = LEAST_FIRST_DEVIATION, 0
        self.compared_background = self._scratch.rounded, np.s_[0 : shape[0], 0 : shape[1]]
        for name, fill in self._fills().items():
            setattr(self, name, allocated(shape, fill, np.uint8))
        self.background, self.noise = allocated(shape, 0, np.float32), NoiseMap(shape)
        self._history = FrameHistory(shape, settings.frame_interval)

    @property
    def mask(self) -> ByteImage:
        """uint8[h, w], the last frame's foreground: 255 moving, 128 stopped, 50 shadow.

        Valid until the next frame, within that frame's region.
        """
        return self._scratch.levels

    @property
    def tolerance(self) -> int:
        """Registration error that the comparison tolerates, canvas px."""
        return self.settings.tolerance if self.settings.tolerance >= 0 else int(self.scale > 1)

    def _fills(self) -> dict[str, int]:
        """The byte images of the canvas, and the value of each where nothing is known."""
        empty = ("valid", "standing", "flicker", "_foreground_before")
        return {"_waiting": LONGEST_WAIT} | dict.fromkeys(empty, 0)

    def _used(self) -> dict[str, int]:
        """Those of them that may hold anything else."""
        unused = set() if self.settings.flicker else {"flicker", "_foreground_before"}
        if not cv2.countNonZero(self.standing):
            unused.add("standing")
        return {name: fill for name, fill in self._fills().items() if name not in unused}

    def scroll(self, dx: int, dy: int) -> None:
        """Moves everything by whole pixels: what was at (x, y) is then at (x + dx, y + dy)."""
        for name, fill in self._used().items():
            setattr(self, name, scrolled(getattr(self, name), dx, dy, fill))
        self.background = scrolled(self.background, dx, dy, 0)
        self.noise.scroll(dx, dy)
        self._history.scroll(dx, dy)

    def warp(self, change: FloatArray) -> None:
        """Resamples everything onto another canvas: float64[3, 3] maps this canvas to that one."""
        # In place: allocating memory takes as long as filling it.
        for name, fill in self._used().items():
            image = getattr(self, name)
            image[:] = warped(image, change, fill)
        self.background[:] = warped(self.background, change, 0, cv2.INTER_CUBIC)
        self.noise.warp(change)
        # Cubic resampling of the background mixes pixels across the border of what is known.
        self.valid[:] = cv2.erode(self.valid, np.ones((3, 3), np.uint8))
        self._history.warp(change)

    def next_frame(self) -> CanvasFrame:
        """Buffer in which the next frame may be drawn on the canvas, so that `update` need not copy it."""
        return self._history.next_frame()

    def update(
        self, image: ByteImage, seen: ByteImage, region: Slices, parallax: FloatArray | None = None
    ) -> tuple[ByteImage, Event]:
        """Processes one frame.

        Args:
            image: uint8[h, w], the frame on the canvas within `region`.
            seen: uint8[h, w], mask of the pixels that the frame covers.
            region: rows and columns of the canvas.
            parallax: float64[2], px, shift of tall objects, see `filters.parallax`; None for none.

        Returns:
            uint8[h, w] of the region, see `mask`; and what happened to the model as a whole.
        """
        event = self._follow_exposure(image, seen, region)
        frame, scratch = self._history.place(image, seen, region), self._scratch
        values, mask = self.mask[region], scratch.mask[region]
        earlier = self._earlier
        bounds = region_of(region, self.size)
        self._update_waiting(frame, earlier, bounds)
        self._frames += 1
        self._set_provisional(frame, earlier, bounds)
        self._classify(frame, bounds)
        self.compared_background = scratch.rounded[region], region
        self._filter_components(frame, earlier, bounds, parallax)
        shadow = shadow_mask(image, self.background[region], mask) if self.settings.shadow else None
        self._learn(frame, earlier, bounds)
        self._history.append(frame)
        if self.settings.flicker:
            before = self._foreground_before[region]
            flickers = update_flicker(self.flicker[region], before, mask)
            before[:] = mask
            cv2.subtract(mask, flickers, dst=mask)
        set_mask_values(scratch.mask, scratch.quiet, scratch.levels, bounds)
        ghosts_end = 2 * self.settings.quiet_frames + self.settings.frame_interval
        if not self.begins_at_once and self._frames <= ghosts_end:
            values[self.valid[region] == PROVISIONAL] = 0
        if shadow is not None:
            values[(shadow & mask) > 0] = SHADOW
        return values, event

    def _update_waiting(self, frame: CanvasFrame, earlier: CanvasFrame | None, bounds: Region) -> None:
        """Equations 1 and 2."""
        settings = self.settings
        # Without an earlier frame no pixel counts as quiet.
        before = earlier or CanvasFrame(frame.image, np.zeros_like(frame.seen))
        images = *frame, *before, self._waiting, self._scratch.quiet
        thresholds = settings.change_threshold, settings.gradient_gain
        update_waiting(*images, bounds, *thresholds, settings.quiet_frames)

    def _set_provisional(self, frame: CanvasFrame, earlier: CanvasFrame | None, bounds: Region) -> None:
        """Gives ground that was never quiet yet a provisional background."""
        settings = self.settings
        if earlier is None or self._frames % PROVISIONAL_INTERVAL:
            return
        if self._frames <= PROVISIONAL_INTERVAL:
            self._measure_first_deviation(frame, earlier, bounds)
        self.noise.set_limits(settings.noise_gain, settings.foreground_threshold)
        images = self._waiting, self.background, self.valid
        self.noise.set_provisional(frame.seen, earlier, *images, bounds, self._first_deviation)

    def _measure_first_deviation(self, frame: CanvasFrame, earlier: CanvasFrame, bounds: Region) -> None:
        part = np.s_[bounds[0] : bounds[1], bounds[2] : bounds[3]]
        pair = earlier.image, frame.image, earlier.seen, frame.seen
        self._first_deviation = first_deviation(*(image[part] for image in pair))

    def _classify(self, frame: CanvasFrame, bounds: Region) -> None:
        """Equation 4 with hysteresis."""
        settings, scratch, tolerance = self.settings, self._scratch, self.tolerance
        self.noise.set_limits(settings.noise_gain, settings.foreground_threshold)
        # The noise of a pixel accounts for edges, too.
        gradient_gain = 0.0 if settings.noise_gain else settings.gradient_gain
        known = self.background, self.valid, self.noise.thresholds
        images = *frame, *known, scratch.rounded, scratch.levels
        classify(*images, bounds, tolerance, gradient_gain, settings.hysteresis_ratio)
        if tolerance > 0 and settings.hysteresis_ratio < 1.0:
            hysteresis_mask(scratch.levels, scratch.updates, scratch.mask, bounds)
        else:
            strong_mask(scratch.levels, scratch.mask, bounds)

    def _filter_components(
        self, frame: CanvasFrame, earlier: CanvasFrame | None, bounds: Region, parallax: FloatArray | None
    ) -> None:
        """Removes ghosts and parallax from the foreground."""
        # Ghosts stay in place, so every third frame is enough.
        finds_ghosts = self.settings.ghost and self._frames % GHOST_INTERVAL == 0
        finds_parallax = parallax is not None and earlier is not None
        if not (finds_ghosts or finds_parallax):
            return
        scratch = self._scratch
        blocks, count = components_of(scratch.mask, bounds)
        components = scratch.mask, blocks, count, bounds
        ghosts = shifted = np.zeros(count, np.bool_)
        images = frame.image, scratch.rounded, self.valid
        if finds_ghosts:
            ghosts = find_ghosts(*(*images, *components))
        if parallax is not None and earlier is not None:
            shift = max(self.tolerance, 1), float(parallax[0]), float(parallax[1])
            images_before = *earlier, self.noise.thresholds
            shifted = find_parallax(*(*images, *images_before, *components, *shift))
        learnt = scratch.mask, scratch.quiet, frame.image, self.background
        remove_components(blocks, ghosts, shifted, *learnt)

    def _learn(self, frame: CanvasFrame, earlier: CanvasFrame | None, bounds: Region) -> None:
        """Equation 3, stationary objects, new pixels, and the noise."""
        settings, scratch = self.settings, self._scratch
        images = scratch.mask, scratch.quiet, self.background, self.valid, self.standing, scratch.updates
        added = learn(frame.image, *images, bounds, settings.learning_rate, settings.absorb_frames)
        if not settings.noise_gain:
            return
        # Not every frame, but with more weight: noise changes slowly.
        if self._frames % NOISE_INTERVAL == 0:
            self._learn_noise(frame, bounds)
        if added and earlier is not None:
            if self._frames % FIRST_DEVIATION_FRAMES == 0:
                self._measure_first_deviation(frame, earlier, bounds)
            self.noise.begin(earlier.image, scratch.updates, bounds, self._first_deviation)

    def _learn_noise(self, frame: CanvasFrame, bounds: Region) -> None:
        scratch = self._scratch
        foreground = scratch.mask[bounds[0] : bounds[1], bounds[2] : bounds[3]]
        is_calm = cv2.countNonZero(foreground) < MOST_FOREGROUND * foreground.size
        restless_rate = NOISE_INTERVAL * RESTLESS_LEARNING_RATE if is_calm else 0.0
        images = frame.image, scratch.rounded, scratch.updates, scratch.mask, self.valid
        self.noise.learn(*images, bounds, NOISE_INTERVAL * NOISE_LEARNING_RATE, restless_rate)

    def contrast(self, boxes: FloatArray, to_canvas: FloatArray) -> FloatArray:
        """Contrast of the last frame to the background in boxes, see `confidence.contrasts`.

        Args:
            boxes: float64[n, 4], x0 y0 x1 y1.
            to_canvas: float64[3, 3], from the boxes' pixels to the canvas.
        """
        if not self._history:
            return np.zeros(len(boxes))
        limits = self.settings.noise_gain, self.settings.foreground_threshold
        known = self.background, self.valid, self.noise.deviation
        return contrasts(boxes, to_canvas, self._history[-1].image, *known, *limits)

    @property
    def _earlier(self) -> CanvasFrame | None:
        """The frame `frame_interval` before, or the first one of a model that is younger."""
        count = len(self._history)
        return self._history[-min(self.settings.frame_interval, count)] if count else None

    def _follow_exposure(self, image: ByteImage, seen: ByteImage, region: Slices) -> Event:
        """Adapts the model's brightness to the frame's."""
        if not self._history:
            return Event.NONE
        last = self._history[-1]
        step = exposure_change(last.image[region], image, last.seen[region], seen)
        if step is not None:
            self.background[:] = np.clip(step.gain * self.background + step.offset, 0.0, 255.0)
            self._history.adapt(step.gain, step.offset)
        # A slow drift shows in the background, which learns slowly, before it shows between two frames.
        drift = exposure_change(self.background[region], image, self.valid[region], seen)
        if drift is not None:
            self.background[:] = np.clip(drift.gain * self.background + drift.offset, 0.0, 255.0)
        return Event.NONE if step is None and drift is None else Event.GAIN
