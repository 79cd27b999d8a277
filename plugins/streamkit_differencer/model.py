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
from collections import deque
from dataclasses import dataclass, field

import cv2
import numpy as np

from streamkit.geometry.homography import inverse
from streamkit_differencer.arrays import ByteImage, FloatArray, FloatImage, Region, Slices
from streamkit_differencer.canvas_images import CanvasFrame, Scratch, allocated, scrolled, warped
from streamkit_differencer.changes import LONGEST_WAIT, update_waiting
from streamkit_differencer.confidence import contrasts
from streamkit_differencer.filters.components import components_of, remove_components
from streamkit_differencer.filters.flicker import update_flicker
from streamkit_differencer.filters.ghost import find_ghosts
from streamkit_differencer.filters.parallax import find_parallax
from streamkit_differencer.filters.shadow import shadow_mask
from streamkit_differencer.hysteresis import hysteresis_mask, strong_mask
from streamkit_differencer.illumination import exposure_change
from streamkit_differencer.learning import PROVISIONAL, learn
from streamkit_differencer.mask_values import SHADOW, set_mask_values
from streamkit_differencer.noise import (
    DEVIATION_RATIO,
    EDGE_SHARE,
    HIGHEST_THRESHOLD,
    LEAST_FIRST_DEVIATION,
    UNKNOWN_DEVIATION,
    first_deviation,
)
from streamkit_differencer.noise_learning import begin_noise, learn_noise, set_provisional, set_thresholds
from streamkit_differencer.pixel_classes import classify
from streamkit_differencer.sampling import warp_frame
from streamkit_differencer.settings import BackgroundSettings

# Weight of a frame in a pixel's noise; under a camera that flies, ground is in view for seconds.
NOISE_LEARNING_RATE = 0.05
NOISE_INTERVAL = 4
# The same for pixels that were never quiet; not where more of a frame is foreground: what passes for
# background may then be part of what moves.
RESTLESS_LEARNING_RATE = 0.1
MOST_FOREGROUND = 0.3
GHOST_INTERVAL = 3
# Frames in which a value must be seen to replace a provisional background.
FEWEST_FRAMES = 3
# New ground gets a provisional background every other frame: one frame later at most, for half the time.
PROVISIONAL_INTERVAL = 2
# Frames for which the noise of new ground is assumed constant.
FIRST_DEVIATION_FRAMES = 8
# Each image of the canvas, and its value where nothing is known.
FLOAT_IMAGES: dict[str, float] = {"background": 0.0, "deviation": UNKNOWN_DEVIATION}
BYTE_IMAGES: dict[str, float] = {
    "_waiting": LONGEST_WAIT,
    "thresholds": HIGHEST_THRESHOLD,
    "valid": 0,
    "known_frames": 0,
    "_other": 0,
    "other_frames": 0,
    "flicker": 0,
    "_foreground_before": 0,
}


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
        deviation: float32[h, w], mean absolute deviation of the background, grey levels.
        thresholds: uint8[h, w], T_F of each pixel: a multiple of the deviation, within limits.
        valid: uint8[h, w], mask of the pixels whose background is known.
        known_frames: uint8[h, w], frames that the background was seen at rest.
        other_frames: uint8[h, w], frames that the other value of a pixel was seen at rest, see `learning`.
        flicker: uint8[h, w], see `filters.flicker`.
        mask: uint8[h, w], the last frame's foreground within its region: 255 moving, 128 stopped, 50 shadow.
            Valid until the next frame.
        tolerance: registration error that the comparison of the last frame tolerated, canvas px.
        compared_background: uint8[h, w], the background that the last frame was compared with, and its region
            of the canvas.
    """

    size: tuple[int, int]
    settings: BackgroundSettings
    scale: int = 1
    begins_at_once: bool = True
    background: FloatImage = field(init=False)
    deviation: FloatImage = field(init=False)
    thresholds: ByteImage = field(init=False)
    valid: ByteImage = field(init=False)
    known_frames: ByteImage = field(init=False)
    other_frames: ByteImage = field(init=False)
    flicker: ByteImage = field(init=False)
    mask: ByteImage = field(init=False)
    tolerance: int = 0
    compared_background: tuple[ByteImage, Slices] = field(init=False)
    _waiting: ByteImage = field(init=False)
    _other: ByteImage = field(init=False)
    _foreground_before: ByteImage = field(init=False)
    _frames: int = 0
    _history: deque[CanvasFrame] = field(default_factory=deque)
    _next: CanvasFrame | None = None
    _scratch: Scratch = field(init=False)
    _first_deviation: float = LEAST_FIRST_DEVIATION
    # Threshold over mean deviation, smallest and largest threshold.
    _limits: tuple[float, int, int] = (0.0, 0, 0)

    def __post_init__(self) -> None:
        self._scratch = Scratch((self.size[1], self.size[0]))
        self.mask = self._scratch.levels
        self.reset()

    def reset(self) -> None:
        """Discards everything learnt."""
        shape = self.size[1], self.size[0]
        self._first_deviation, self._frames, self._limits = LEAST_FIRST_DEVIATION, 0, (0.0, 0, 0)
        self.compared_background = self._scratch.rounded, np.s_[0 : shape[0], 0 : shape[1]]
        for name, fill in FLOAT_IMAGES.items():
            setattr(self, name, allocated(shape, fill, np.float32))
        for name, fill in BYTE_IMAGES.items():
            setattr(self, name, allocated(shape, fill, np.uint8))
        self._history.clear()

    def _used(self) -> dict[str, float]:
        """The images that may hold anything but their fill value."""
        unused = set() if self.settings.flicker else {"flicker", "_foreground_before"}
        if not cv2.countNonZero(self.other_frames):
            unused.add("other_frames")
        return {name: fill for name, fill in (FLOAT_IMAGES | BYTE_IMAGES).items() if name not in unused}

    def scroll(self, dx: int, dy: int) -> None:
        """Moves everything by whole pixels: what was at (x, y) is then at (x + dx, y + dy)."""
        for name, fill in self._used().items():
            setattr(self, name, scrolled(getattr(self, name), dx, dy, fill))
        for index, frame in enumerate(self._history):
            self._history[index] = CanvasFrame(*(scrolled(image, dx, dy, 0) for image in frame))

    def warp(self, change: FloatArray) -> None:
        """Resamples everything onto another canvas: float64[3, 3] maps this canvas to that one."""
        # In place: allocating memory takes as long as filling it.
        for name, fill in self._used().items():
            image = getattr(self, name)
            interpolation = cv2.INTER_CUBIC if name == "background" else cv2.INTER_NEAREST
            image[:] = warped(image, change, fill, interpolation)
        # Cubic resampling of the background mixes pixels across the border of what is known.
        self.valid[:] = cv2.erode(self.valid, np.ones((3, 3), np.uint8))
        to_before, pairs = inverse(change), np.empty(self.valid.shape, np.uint16)
        for frame in self._history:
            image = np.zeros(self.valid.shape, np.uint8)
            # Less than half of OpenCV's time.
            warp_frame(frame.image, pairs, to_before, image, (0, self.size[1], 0, self.size[0]))
            frame.image[:], frame.seen[:] = image, warped(frame.seen, change, 0)

    def next_frame(self) -> CanvasFrame:
        """Buffer in which the next frame is drawn on the canvas, with an empty mask, for `update`."""
        if self._next is None:
            shape = self.size[1], self.size[0]
            self._next = CanvasFrame(allocated(shape, 0, np.uint8), allocated(shape, 0, np.uint8))
        self._next.seen.fill(0)
        return self._next

    def update(self, region: Slices, parallax: FloatArray | None = None) -> tuple[ByteImage, Event]:
        """Processes the frame that was drawn in `next_frame`.

        Args:
            region: rows and columns of the canvas that the frame covers.
            parallax: float64[2], px, shift of tall objects, see `filters.parallax`; None for none.

        Returns:
            uint8[h, w] of the region, see `mask`; and what happened to the model as a whole.
        """
        assert self._next is not None
        settings, frame, scratch = self.settings, self._next, self._scratch
        event = self._follow_exposure(frame, region)
        interval = min(settings.frame_interval, len(self._history))
        # A model that is younger than the interval compares with its first frame.
        earlier = self._history[-interval] if interval else None
        bounds = region[0].start, region[0].stop, region[1].start, region[1].stop
        values, mask = self.mask[region], scratch.mask[region]
        self._frames += 1
        self._wait(frame, earlier, bounds)
        self._classify(frame, bounds)
        self.compared_background = scratch.rounded[region], region
        self._filter_components(frame, earlier, bounds, parallax)
        shadow = shadow_mask(frame.image[region], self.background[region], mask) if settings.shadow else None
        self._learn(frame, earlier, bounds)
        self._history.append(frame)
        self._next = self._history.popleft() if len(self._history) > settings.frame_interval else None
        if settings.flicker:
            before = self._foreground_before[region]
            flickers = update_flicker(self.flicker[region], before, mask)
            before[:] = mask
            cv2.subtract(mask, flickers, dst=mask)
        set_mask_values(scratch.mask, scratch.quiet, scratch.levels, bounds)
        if not self.begins_at_once and self._frames <= 2 * settings.quiet_frames + settings.frame_interval:
            values[self.valid[region] == PROVISIONAL] = 0
        if shadow is not None:
            values[(shadow & mask) > 0] = SHADOW
        return values, event

    def _wait(self, frame: CanvasFrame, earlier: CanvasFrame | None, bounds: Region) -> None:
        """Equations 1 and 2; ground that was never quiet yet gets a provisional background."""
        settings = self.settings
        least = int(min(settings.foreground_threshold, 255.0))
        limits = settings.noise_gain * DEVIATION_RATIO, least, max(least, int(HIGHEST_THRESHOLD))
        if limits != self._limits:
            self._limits = limits
            set_thresholds(self.deviation, self.thresholds, (0, self.size[1], 0, self.size[0]), *limits)
        # Without an earlier frame no pixel counts as quiet.
        before = earlier or CanvasFrame(frame.image, np.zeros_like(frame.seen))
        images = *frame, *before, self._waiting, self._scratch.quiet
        thresholds = settings.change_threshold, settings.gradient_gain
        update_waiting(*images, bounds, *thresholds, settings.quiet_frames)
        if earlier is None or self._frames % PROVISIONAL_INTERVAL:
            return
        if self._frames <= PROVISIONAL_INTERVAL:
            self._first_deviation = first_deviation(earlier, frame, bounds)
        known = self._waiting, self.background, self.valid, self.deviation, self.thresholds
        set_provisional(*(frame.seen, *earlier, *known, bounds, self._first_deviation, EDGE_SHARE, *limits))

    def _classify(self, frame: CanvasFrame, bounds: Region) -> None:
        """Equation 4 with hysteresis."""
        settings, scratch = self.settings, self._scratch
        self.tolerance = settings.tolerance if settings.tolerance >= 0 else int(self.scale > 1)
        # The noise of a pixel accounts for edges, too.
        gradient_gain = 0.0 if settings.noise_gain else settings.gradient_gain
        images = *frame, self.background, self.valid, self.thresholds, scratch.rounded, scratch.levels
        classify(*images, bounds, self.tolerance, gradient_gain, settings.hysteresis_ratio)
        if self.tolerance > 0 and settings.hysteresis_ratio < 1.0:
            hysteresis_mask(scratch.levels, scratch.mask, bounds)
        else:
            strong_mask(scratch.levels, scratch.mask, bounds)

    def _filter_components(
        self, frame: CanvasFrame, earlier: CanvasFrame | None, bounds: Region, parallax: FloatArray | None
    ) -> None:
        """Removes ghosts and parallax from the foreground."""
        # Ghosts stay in place, so every third frame is enough.
        finds_ghosts = self.settings.ghost and self._frames % GHOST_INTERVAL == 0
        if not finds_ghosts and (parallax is None or earlier is None):
            return
        scratch = self._scratch
        blocks, count = components_of(scratch.mask, bounds)
        components = scratch.mask, blocks, count, bounds
        ghosts = shifted = np.zeros(count, np.bool_)
        images = frame.image, scratch.rounded, self.valid
        if finds_ghosts:
            ghosts = find_ghosts(*(*images, self._waiting, *components))
        if parallax is not None and earlier is not None:
            shift = max(self.tolerance, 1), float(parallax[0]), float(parallax[1])
            shifted = find_parallax(*(*images, *earlier, self.thresholds, *components, *shift))
        remove_components(blocks, ghosts, shifted, scratch.mask, scratch.quiet, frame.image, self.background)

    def _learn(self, frame: CanvasFrame, earlier: CanvasFrame | None, bounds: Region) -> None:
        """Equation 3, stationary objects, new pixels, and the noise."""
        settings, scratch = self.settings, self._scratch
        images = frame.image, scratch.mask, scratch.quiet, self.background, scratch.rounded, self.thresholds
        states = self.valid, self.known_frames, self._other, self.other_frames, scratch.updates
        # A flight comes to new ground all the time, with vehicles on it that are as even as ground.
        fewest = FEWEST_FRAMES if self.begins_at_once else settings.quiet_frames
        limits = settings.quiet_frames, settings.absorb_frames, self._limits[1], fewest
        added = learn(*images, *states, bounds, settings.learning_rate, *limits)
        if not settings.noise_gain:
            return
        noise = self.deviation, self.thresholds, bounds
        # Not every frame, but with more weight: noise changes slowly.
        if self._frames % NOISE_INTERVAL == 0:
            foreground = scratch.mask[bounds[0] : bounds[1], bounds[2] : bounds[3]]
            is_calm = cv2.countNonZero(foreground) < MOST_FOREGROUND * foreground.size
            restless_rate = NOISE_INTERVAL * RESTLESS_LEARNING_RATE if is_calm else 0.0
            states = frame.image, scratch.rounded, scratch.updates, scratch.mask, self.valid
            rates = NOISE_INTERVAL * NOISE_LEARNING_RATE, restless_rate
            learn_noise(*(*states, *noise, *rates, *self._limits))
        if added and earlier is not None:
            if self._frames % FIRST_DEVIATION_FRAMES == 0:
                self._first_deviation = first_deviation(earlier, frame, bounds)
            first = self._first_deviation, EDGE_SHARE
            begin_noise(*(earlier.image, scratch.updates, *noise, *first, *self._limits))

    def contrast(self, boxes: FloatArray, to_canvas: FloatArray) -> FloatArray:
        """Contrast of the last frame to the background in boxes, see `confidence.contrasts`.

        Args:
            boxes: float64[n, 4], x0 y0 x1 y1.
            to_canvas: float64[3, 3], from the boxes' pixels to the canvas.
        """
        known = self.background, self.valid, self.deviation
        limits = self.settings.noise_gain, self.settings.foreground_threshold
        return contrasts(boxes, to_canvas, self._history[-1].image, *known, *limits)

    def _follow_exposure(self, frame: CanvasFrame, region: Slices) -> Event:
        """Adapts the model's brightness to the frame's."""
        if not self._history:
            return Event.NONE
        last, image, seen = self._history[-1], frame.image[region], frame.seen[region]
        step = exposure_change(last.image[region], image, last.seen[region], seen)
        if step is not None:
            self.background[:] = np.clip(step.gain * self.background + step.offset, 0.0, 255.0)
            for earlier in self._history:
                earlier.image[:] = cv2.addWeighted(earlier.image, step.gain, earlier.image, 0.0, step.offset)
        # A slow drift shows in the background, which learns slowly, before it shows between two frames.
        drift = exposure_change(self.background[region], image, self.valid[region], seen)
        if drift is not None:
            self.background[:] = np.clip(drift.gain * self.background + drift.offset, 0.0, 255.0)
        return Event.NONE if step is None and drift is None else Event.GAIN
