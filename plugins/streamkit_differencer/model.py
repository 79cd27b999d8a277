"""The background model: equations 1 to 4 of the paper on the canvas, extended for a camera that moves.

The extensions: a pixel that is new to the canvas has no background until it was quiet; the comparison
tolerates a registration error; a stationary object becomes background after a while; a change of exposure is
followed instead of detected as motion.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import cast

import cv2
import numpy as np

from streamkit_differencer.arrays import ByteImage, FloatArray, Slices, above, local_range, set_pixels
from streamkit_differencer.equations import (
    LONGEST_WAIT,
    changed_mask,
    count_down,
    quiet_mask,
    update_background,
)
from streamkit_differencer.filters.components import components_of, remove_blocks
from streamkit_differencer.filters.flicker import update_flicker
from streamkit_differencer.filters.ghost import find_ghosts
from streamkit_differencer.filters.parallax import find_parallax
from streamkit_differencer.foreground import find_foreground
from streamkit_differencer.ground import PROVISIONAL, UNKNOWN, CanvasFrame, Ground
from streamkit_differencer.illumination import exposure_change
from streamkit_differencer.learning import choose_values
from streamkit_differencer.noise import (
    EDGE_SHARE,
    FIRST_DEVIATION,
    NOISE_INTERVAL,
    learn_noise,
    thresholds_of,
)
from streamkit_differencer.settings import BackgroundSettings

# Frames in which a value must be seen to replace a provisional background.
MIN_FRAMES = 3
GHOST_INTERVAL = 3


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """A frame and the background, on the part of the canvas that the frame covers; uint8[h, w] each.

    Attributes:
        image: f(t).
        background: B(t - 1), rounded.
        thresholds: T_F of each pixel: a multiple of its deviation, within limits.
        known: mask of what the frame covers and whose background is known.
        quiet: mask of the pixels that did not change within `quiet_frames`.
        mask: foreground.
        follows_exposure: whether the background was adapted to a change of brightness.
    """

    image: ByteImage
    background: ByteImage
    thresholds: ByteImage
    known: ByteImage
    quiet: ByteImage
    mask: ByteImage
    follows_exposure: bool


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
    """

    size: tuple[int, int]
    settings: BackgroundSettings
    scale: int = 1
    begins_at_once: bool = True
    ground: Ground = field(init=False)
    _frames: int = 0
    # The frame `frame_interval` before, or the first one, and those since.
    _history: deque[CanvasFrame] = field(init=False)

    def __post_init__(self) -> None:
        self.ground = Ground.unknown(self.size)
        self._history = deque(maxlen=self.settings.frame_interval)

    @property
    def tolerance(self) -> int:
        """Registration error that the comparison tolerates, canvas px."""
        return self.settings.tolerance if self.settings.tolerance >= 0 else int(self.scale > 1)

    def move(self, change: FloatArray, is_scroll: bool) -> None:
        """Moves everything onto another canvas, see `Ground.move`."""
        self.ground.move(change, is_scroll)
        history = (frame.moved(change, is_scroll) for frame in self._history)
        self._history = deque(history, self._history.maxlen)

    def update(
        self,
        whole: CanvasFrame,
        region: Slices,
        parallax: FloatArray | None = None,
        is_resampled: bool = True,
    ) -> Comparison:
        """Processes a frame.

        Args:
            whole: the frame on the canvas; kept.
            region: rows and columns of the canvas that the frame covers.
            parallax: float64[2], px, shift of tall objects, see `filters.parallax`; None for none.
            is_resampled: whether the frame was resampled, so that edges may be misplaced.
        """
        settings, ground, frame = self.settings, self.ground.part(region), whole.part(region)
        follows_exposure = self._follow_exposure(frame, ground)
        earlier = self._history[0].part(region) if self._history else None
        self._frames += 1
        quiet = self._wait(ground, frame, earlier, settings.gradient_gain if is_resampled else 0.0)
        background = cast("ByteImage", cv2.convertScaleAbs(ground.background))
        thresholds = thresholds_of(ground.deviation, settings.noise_gain, settings.foreground_threshold)
        known = cast("ByteImage", cv2.bitwise_and(above(ground.valid, UNKNOWN), frame.seen))
        compared = frame.image, background, thresholds, known
        mask = find_foreground(*compared, self.tolerance, settings.hysteresis_ratio)
        found = Comparison(*compared, quiet, mask, follows_exposure)
        self._filter_components(ground, found, earlier, parallax)
        self._learn(ground, frame, found)
        self._history.append(whole)
        if settings.flicker:
            mask &= ~update_flicker(ground.flicker, ground.foreground_before, mask)
        if not self.begins_at_once and self._frames <= 2 * settings.quiet_frames + settings.frame_interval:
            mask[ground.valid == PROVISIONAL] = 0
        return found

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
        changed = changed_mask(frame.image, earlier.image, settings.change_threshold, ranges, gradient_gain)
        # What is not in both frames counts as changed.
        unseen = cv2.bitwise_not(cv2.bitwise_and(frame.seen, earlier.seen))
        changed = cast("ByteImage", cv2.bitwise_or(changed, unseen))
        count_down(ground.waiting, changed)
        new = set_pixels(~above(cast("ByteImage", cv2.bitwise_or(ground.valid, changed)), UNKNOWN))
        ground.background[new], ground.valid[new] = earlier.image[new], PROVISIONAL
        ground.deviation[new] = FIRST_DEVIATION + EDGE_SHARE * ranges[new]
        return quiet_mask(ground.waiting, settings.quiet_frames)

    def _filter_components(
        self,
        ground: Ground,
        found: Comparison,
        earlier: CanvasFrame | None,
        parallax: FloatArray | None,
    ) -> None:
        """Removes ghosts and parallax from the foreground, and learns them as background."""
        # Ghosts stay in place, so every third frame is enough.
        finds_ghosts = self.settings.ghost and self._frames % GHOST_INTERVAL == 0
        if not finds_ghosts and (parallax is None or earlier is None):
            return
        blocks, count = components_of(found.mask)
        ghosts = shifted = np.zeros(len(blocks), np.bool_)
        images = found.image, found.background, ground.valid
        if finds_ghosts:
            ghosts = find_ghosts(*images, ground.waiting, found.mask, blocks, count)[blocks[:, 2]]
        if parallax is not None and earlier is not None:
            radius, (x, y) = max(self.tolerance, 1), parallax.tolist()
            frames = *images, *earlier, found.thresholds
            shifted = find_parallax(frames, found.mask, blocks, count, radius, (x, y))
        if ghosts.any() or shifted.any():
            masks = found.mask, found.quiet
            remove_blocks(blocks, ghosts, shifted, *masks, found.image, ground.background)

    def _learn(self, ground: Ground, frame: CanvasFrame, found: Comparison) -> None:
        """Equation 3, stationary objects, new pixels, and the noise."""
        settings = self.settings
        undecided = ~above(ground.valid, PROVISIONAL) | found.mask
        averaged = cast("ByteImage", cv2.subtract(found.quiet, undecided))
        # A flight comes to new ground all the time, with vehicles on it that are as even as ground.
        min_frames = MIN_FRAMES if self.begins_at_once else settings.quiet_frames
        same = int(settings.foreground_threshold)
        limits = settings.quiet_frames, settings.absorb_frames, same, min_frames
        images = frame.image, found.mask, found.quiet, found.background, found.thresholds
        states = ground.background, ground.valid, ground.known_frames, ground.other, ground.other_frames
        # Few pixels are undecided: a search and a loop over them take half the time of a loop over all.
        pixels = np.flatnonzero(cv2.bitwise_and(undecided, frame.seen) > 0)
        choose_values(pixels, *images, *states, *limits)
        update_background(ground.background, frame.image, averaged, settings.learning_rate)
        cv2.add(ground.known_frames, (averaged & np.uint8(1)).astype(np.uint16), dst=ground.known_frames)
        if self._frames % NOISE_INTERVAL:
            return
        # The threshold limits what a missed object adds.
        difference = cast("ByteImage", cv2.min(cv2.absdiff(frame.image, found.background), found.thresholds))
        learn_noise(ground, difference, found.mask, averaged)

    def _follow_exposure(self, frame: CanvasFrame, ground: Ground) -> bool:
        """Adapts the brightness of the model and of the last frames to the frame's."""
        change = exposure_change(ground.background, frame.image, ground.valid & frame.seen)
        if change is None:
            return False
        gain, offset = change
        background = self.ground.background
        background[:] = np.clip(gain * background + offset, 0.0, 255.0)
        for earlier in self._history:
            earlier.image[:] = cv2.addWeighted(earlier.image, gain, earlier.image, 0.0, offset)
        return True
