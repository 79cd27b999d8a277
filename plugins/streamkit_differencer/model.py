"""The background model: equations 1 to 4 of the paper on the canvas, extended for a camera that moves.

The extensions: a pixel that is new to the canvas has no background until it was quiet; the comparison
tolerates a registration error; a stationary object becomes background after a while; a change of exposure is
followed instead of detected as motion.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import cv2
import numpy as np

from streamkit_differencer.arrays import ByteImage, FloatArray
from streamkit_differencer.comparison import Comparison, find_quiet_ground
from streamkit_differencer.filters.components import components_of, remove_blocks
from streamkit_differencer.filters.parallax import find_parallax
from streamkit_differencer.filters.view_motion import ViewMotion
from streamkit_differencer.foreground import find_foreground
from streamkit_differencer.ground import BLACK, PROVISIONAL, UNSEEN, CanvasFrame, Ground, moved
from streamkit_differencer.illumination import exposure_change
from streamkit_differencer.learning import Limits, Rates, learn
from streamkit_differencer.noise import LEARNING_RATE, MAX_FOREGROUND, RESTLESS_RATE
from streamkit_differencer.settings import BackgroundSettings

# Frames in which a value must be seen to replace a provisional background.
MIN_FRAMES = 3


@dataclass(slots=True)
class BackgroundModel:
    """The background of a canvas.

    Attributes:
        size: width and height of the canvas, px.
        settings: may be replaced between frames; a tolerance below 0 is none.
        flies: whether the camera flies over new ground.
        ground: the state of every pixel.
    """

    size: tuple[int, int]
    settings: BackgroundSettings
    flies: bool = False
    ground: Ground = field(init=False)
    _frames: int = 0
    # The frame `frame_interval` before, or the first one, and those since.
    _history: deque[ByteImage] = field(init=False)

    def __post_init__(self) -> None:
        self.ground = Ground.unknown(self.size)
        self._history = deque(maxlen=self.settings.frame_interval)

    def move(self, change: FloatArray, is_scroll: bool) -> None:
        """Moves everything onto another canvas, see `Ground.moved`."""
        self.ground = self.ground.moved(change, is_scroll)
        history = (moved(frame, change, is_scroll) for frame in self._history)
        self._history = deque(history, self._history.maxlen)

    def update(self, frame: CanvasFrame, view: ViewMotion | None = None) -> Comparison:
        """Processes a frame.

        Args:
            frame: on the canvas; its image is kept.
            view: how it has moved, of a camera that flies; None for another one.
        """
        settings, ground = self.settings, self.ground
        follows_exposure = self._follow_exposure(frame)
        self._frames += 1
        # Without an earlier frame no pixel counts as quiet.
        history = self._history or (np.full_like(frame.image, UNSEEN),)
        gradient_gain = settings.gradient_gain if self.flies else 0.0
        threshold, quiet_frames = settings.change_threshold, settings.quiet_frames
        quiet = find_quiet_ground(frame, history[0], ground, threshold, gradient_gain, quiet_frames)
        background, thresholds, mask = find_foreground(frame, ground, settings)
        found = Comparison(background, thresholds, quiet, mask, follows_exposure)
        if view is not None and self._history:
            self.flies |= view.is_flight
            if view.height > 0.0:
                self._remove_parallax(frame, found, view)
        self._learn(frame, history[-1], found)
        self._history.append(frame.image)
        if self.flies and self._frames <= 2 * settings.quiet_frames + settings.frame_interval:
            # A flight comes to new ground all the time: its first second is not worth the ghosts.
            mask[ground.valid[frame.region] == PROVISIONAL] = 0
        return found

    def _remove_parallax(self, frame: CanvasFrame, found: Comparison, view: ViewMotion) -> None:
        """Removes the parallax of tall objects from the foreground, and learns it as background."""
        blocks, count = components_of(found.mask)
        if not count:
            return
        ground, region, image = self.ground, frame.region, frame.covered
        earlier = self._history[0][region]
        frames = image, found.background, ground.valid[region], earlier, found.thresholds
        top, _, left, _ = frame.bounds
        points = np.asarray(blocks[:, 1::-1] + (left, top), np.float64)
        shifts = view.shifts(points)
        shifted = find_parallax(frames, found.mask, blocks, count, shifts)
        if shifted.any():
            remove_blocks(blocks[shifted], found.mask, found.quiet, image, ground.background[region])

    def _learn(self, frame: CanvasFrame, last: ByteImage, found: Comparison) -> None:
        """Equation 3, stationary objects, new pixels, and the noise; `last` is f(t - 1)."""
        settings = self.settings
        # On new ground there are vehicles that are as even as ground.
        min_frames = settings.quiet_frames if self.flies else MIN_FRAMES
        same = int(settings.foreground_threshold)
        limits = Limits(settings.quiet_frames, settings.absorb_frames, same, min_frames)
        is_calm = cv2.countNonZero(found.mask) < MAX_FOREGROUND * found.mask.size
        rates = Rates(settings.learning_rate, LEARNING_RATE, RESTLESS_RATE if is_calm else 0.0)
        learn(frame, last, found, self.ground, rates, limits)

    def _follow_exposure(self, frame: CanvasFrame) -> bool:
        """Adapts the brightness of the model and of the last frames to the frame's."""
        background, region = self.ground.background, frame.region
        change = exposure_change(background[region], frame.image[region], self.ground.valid[region])
        if change is None:
            return False
        gain, offset = change
        background[:] = np.clip(gain * background + offset, 0.0, 255.0)
        for earlier in self._history:
            adapted = cv2.addWeighted(earlier, gain, earlier, 0.0, offset)
            cv2.copyTo(np.maximum(adapted, BLACK), earlier, earlier)
        return True
