"""The background model: equations 1 to 4 of the paper on the canvas, extended for a camera that moves.

The extensions: a pixel that is new to the canvas has no background until it was quiet; the comparison
tolerates a registration error; a stationary object becomes background after a while; a change of exposure is
followed instead of detected as motion.
"""

from __future__ import annotations

import enum
from collections import deque
from dataclasses import dataclass, field
from typing import cast

import cv2
import numpy as np

from streamkit_differencer.arrays import ByteImage, FloatArray, Slices, local_range
from streamkit_differencer.equations import (
    LONGEST_WAIT,
    changed_mask,
    count_down,
    quiet_mask,
    update_background,
)
from streamkit_differencer.filters.components import components_of, remove_components
from streamkit_differencer.filters.flicker import update_flicker
from streamkit_differencer.filters.ghost import find_ghosts
from streamkit_differencer.filters.parallax import find_parallax
from streamkit_differencer.filters.shadow import shadow_mask
from streamkit_differencer.foreground import find_foreground
from streamkit_differencer.ground import PROVISIONAL, UNKNOWN, CanvasFrame, Ground, scrolled, warped
from streamkit_differencer.illumination import exposure_change
from streamkit_differencer.learning import choose_values
from streamkit_differencer.mask_values import MOVING, SHADOW, STOPPED
from streamkit_differencer.noise import (
    first_deviation,
    learn_noise,
    thresholds_of,
)
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


class ModelChange(enum.StrEnum):
    """What happened to the model at a frame, besides learning."""

    NONE = "none"
    GAIN = "gain"
    RESET = "reset"


@dataclass(slots=True)
class BackgroundModel:
    """The background of a canvas.

    Attributes:
        size: width and height of the canvas, px.
        settings: may be replaced between frames.
        scale: frame pixels per canvas pixel.
        begins_at_once: whether what differs from the first frames is foreground. Things in them leave ghosts
            for `quiet_frames`; without it nothing is foreground until those are gone.
        ground: the state of every pixel.
        background: uint8[h, w], the background that the last frame was compared with, in its region.
        thresholds: uint8[h, w], T_F of each pixel of it: a multiple of the deviation, within limits.
        compared: the last frame in its region, `background`, `thresholds`, and the mask of what is known.
    """

    size: tuple[int, int]
    settings: BackgroundSettings
    scale: int = 1
    begins_at_once: bool = True
    ground: Ground = field(init=False)
    background: ByteImage = field(init=False)
    thresholds: ByteImage = field(init=False)
    compared: tuple[ByteImage, ByteImage, ByteImage, ByteImage] = field(init=False)
    _frames: int = 0
    _history: deque[CanvasFrame] = field(default_factory=deque)
    _next: CanvasFrame | None = None

    def __post_init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Discards everything learnt."""
        self._frames = 0
        self.ground = Ground.unknown(self.size)
        self._history.clear()

    @property
    def tolerance(self) -> int:
        """Registration error that the comparison tolerates, canvas px."""
        return self.settings.tolerance if self.settings.tolerance >= 0 else int(self.scale > 1)

    def scroll(self, dx: int, dy: int) -> None:
        """Moves everything by whole pixels: what was at (x, y) is then at (x + dx, y + dy)."""
        self.ground.scroll(dx, dy)
        for index, frame in enumerate(self._history):
            self._history[index] = CanvasFrame(*(scrolled(image, dx, dy, 0) for image in frame))

    def warp(self, change: FloatArray) -> None:
        """Resamples everything onto another canvas: float64[3, 3] maps this canvas to that one."""
        self.ground.warp(change)
        for index, frame in enumerate(self._history):
            image = warped(frame.image, change, 0, cv2.INTER_LINEAR)
            self._history[index] = CanvasFrame(image, warped(frame.seen, change, 0))

    def next_frame(self) -> CanvasFrame:
        """Buffer in which the next frame is drawn on the canvas, with an empty mask, for `update`."""
        if self._next is None:
            shape = self.size[1], self.size[0]
            self._next = CanvasFrame(np.zeros(shape, np.uint8), np.zeros(shape, np.uint8))
        self._next.seen.fill(0)
        return self._next

    def update(
        self, region: Slices, parallax: FloatArray | None = None, is_resampled: bool = True
    ) -> tuple[ByteImage, ModelChange]:
        """Processes the frame that was drawn in `next_frame`.

        Args:
            region: rows and columns of the canvas that the frame covers.
            parallax: float64[2], px, shift of tall objects, see `filters.parallax`; None for none.
            is_resampled: whether the frame was resampled, so that edges may be misplaced.

        Returns:
            uint8[h, w] of the region, see `mask_values`; and what happened to the model as a whole.
        """
        assert self._next is not None
        settings, whole = self.settings, self._next
        event = self._follow_exposure(whole, region)
        frame, ground = whole.part(region), self.ground.part(region)
        interval = min(settings.frame_interval, len(self._history))
        # A model that is younger than the interval compares with its first frame.
        earlier = self._history[-interval].part(region) if interval else None
        self._frames += 1
        quiet = self._wait(ground, frame, earlier, settings.gradient_gain if is_resampled else 0.0)
        mask = self._foreground(ground, frame)
        self._filter_components(ground, frame, earlier, mask, quiet, parallax)
        shadow = shadow_mask(frame.image, self.background, mask) if settings.shadow else None
        self._learn(ground, frame, mask, quiet)
        self._history.append(whole)
        self._next = self._history.popleft() if len(self._history) > settings.frame_interval else None
        if settings.flicker:
            flickers = update_flicker(ground.flicker, ground.foreground_before, mask)
            ground.foreground_before[:] = mask
            cv2.subtract(mask, flickers, dst=mask)
        values = cast("ByteImage", cv2.subtract(mask, quiet & np.uint8(MOVING - STOPPED)))
        if not self.begins_at_once and self._frames <= 2 * settings.quiet_frames + settings.frame_interval:
            values[ground.valid == PROVISIONAL] = 0
        if shadow is not None:
            values[(shadow & mask) > 0] = SHADOW
        return values, event

    def _wait(
        self, ground: Ground, frame: CanvasFrame, earlier: CanvasFrame | None, gradient_gain: float
    ) -> ByteImage:
        """Equations 1 and 2; ground that was never quiet yet gets a provisional background."""
        settings = self.settings
        if earlier is None:
            # Without an earlier frame no pixel counts as quiet.
            ground.waiting[frame.seen > 0] = LONGEST_WAIT
            return np.zeros_like(frame.image)
        ranges = local_range(earlier.image)
        images = frame.image, earlier.image, settings.change_threshold, ranges
        changed = changed_mask(*images, gradient_gain)
        # What is not in both frames counts as changed.
        unseen = cv2.bitwise_and(frame.seen, earlier.seen)
        cv2.bitwise_not(unseen, dst=unseen)
        cv2.bitwise_or(changed, unseen, dst=changed)
        count_down(ground.waiting, changed)
        cv2.bitwise_or(ground.valid, changed, dst=unseen)
        unknown = cv2.threshold(unseen, UNKNOWN, 255, cv2.THRESH_BINARY_INV)[1]
        if cv2.countNonZero(unknown):
            columns, rows = cv2.findNonZero(unknown).reshape(-1, 2).T
            new = rows, columns
            ground.background[new], ground.valid[new] = earlier.image[new], PROVISIONAL
            ground.deviation[new] = first_deviation(ranges[new])
        return quiet_mask(ground.waiting, settings.quiet_frames)

    def _foreground(self, ground: Ground, frame: CanvasFrame) -> ByteImage:
        """Equation 4 with hysteresis."""
        settings = self.settings
        self.background = cast("ByteImage", cv2.convertScaleAbs(ground.background))
        self.thresholds = thresholds_of(ground.deviation, settings.noise_gain, settings.foreground_threshold)
        known = cast("ByteImage", cv2.threshold(ground.valid, UNKNOWN, 255, cv2.THRESH_BINARY)[1])
        cv2.bitwise_and(known, frame.seen, dst=known)
        self.compared = frame.image, self.background, self.thresholds, known
        return find_foreground(*self.compared, self.tolerance, settings.hysteresis_ratio)

    def _filter_components(
        self,
        ground: Ground,
        frame: CanvasFrame,
        earlier: CanvasFrame | None,
        mask: ByteImage,
        quiet: ByteImage,
        parallax: FloatArray | None,
    ) -> None:
        """Removes ghosts and parallax from the foreground."""
        # Ghosts stay in place, so every third frame is enough.
        finds_ghosts = self.settings.ghost and self._frames % GHOST_INTERVAL == 0
        if not finds_ghosts and (parallax is None or earlier is None):
            return
        blocks, count = components_of(mask)
        ghosts = shifted = np.zeros(count, np.bool_)
        images = frame.image, self.background, ground.valid
        if finds_ghosts:
            ghosts = find_ghosts(*images, ground.waiting, mask, blocks, count)
        if parallax is not None and earlier is not None:
            radius, (x, y) = max(self.tolerance, 1), parallax.tolist()
            shifted = find_parallax(*images, *earlier, self.thresholds, mask, blocks, count, radius, x, y)
        remove_components(blocks, ghosts, shifted, mask, quiet, frame.image, ground.background)

    def _learn(
        self,
        ground: Ground,
        frame: CanvasFrame,
        mask: ByteImage,
        quiet: ByteImage,
    ) -> None:
        """Equation 3, stationary objects, new pixels, and the noise."""
        settings = self.settings
        # Not known, or foreground.
        undecided = cast("ByteImage", cv2.threshold(ground.valid, PROVISIONAL, 255, cv2.THRESH_BINARY_INV)[1])
        cv2.bitwise_or(undecided, mask, dst=undecided)
        averaged = cast("ByteImage", cv2.subtract(quiet, undecided))
        cv2.bitwise_and(undecided, frame.seen, dst=undecided)
        # A flight comes to new ground all the time, with vehicles on it that are as even as ground.
        fewest = FEWEST_FRAMES if self.begins_at_once else settings.quiet_frames
        limits = settings.quiet_frames, settings.absorb_frames, int(settings.foreground_threshold), fewest
        images = frame.image, mask, quiet, self.background, self.thresholds
        states = ground.background, ground.valid, ground.known_frames, ground.other, ground.other_frames
        choose_values(undecided, *images, *states, *limits)
        update_background(ground.background, frame.image, averaged, settings.learning_rate)
        cv2.add(ground.known_frames, averaged & np.uint8(1), dst=ground.known_frames)
        # Not every frame, but with more weight: noise changes slowly.
        if self._frames % NOISE_INTERVAL == 0:
            self._learn_noise(ground, frame, mask, averaged)

    def _learn_noise(self, ground: Ground, frame: CanvasFrame, mask: ByteImage, averaged: ByteImage) -> None:
        # The threshold limits what a missed object adds.
        difference = cast("ByteImage", cv2.min(cv2.absdiff(frame.image, self.background), self.thresholds))
        learn_noise(ground, difference, averaged, NOISE_INTERVAL * NOISE_LEARNING_RATE)
        if cv2.countNonZero(mask) < MOST_FOREGROUND * mask.size:
            restless = ((ground.valid == PROVISIONAL) & (mask == 0)).view(np.uint8)
            learn_noise(ground, difference, restless, NOISE_INTERVAL * RESTLESS_LEARNING_RATE)

    def _follow_exposure(self, frame: CanvasFrame, region: Slices) -> ModelChange:
        """Adapts the model's brightness to the frame's."""
        if not self._history:
            return ModelChange.NONE
        ground, last, (image, seen) = self.ground, self._history[-1].part(region), frame.part(region)
        step = exposure_change(last.image, image, last.seen, seen)
        if step is not None:
            ground.background[:] = np.clip(step.gain * ground.background + step.offset, 0.0, 255.0)
            for earlier in self._history:
                earlier.image[:] = cv2.addWeighted(earlier.image, step.gain, earlier.image, 0.0, step.offset)
        # A slow drift shows in the background, which learns slowly, before it shows between two frames.
        drift = exposure_change(ground.background[region], image, ground.valid[region], seen)
        if drift is not None:
            ground.background[:] = np.clip(drift.gain * ground.background + drift.offset, 0.0, 255.0)
        return ModelChange.NONE if step is None and drift is None else ModelChange.GAIN
