"""The background model: equations 1 to 4 on the canvas, made fit for a camera that moves.

What is added to the equations: a pixel of the frame that is new to the canvas has no background until it was
quiet; comparison bears an error of registration; a thing that stands still stays foreground for a while and
then becomes background; a change of exposure is taken over instead of seen as motion.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, cast

import cv2
import numpy as np

from streamkit_differencer.equations import (
    dynamic_matrix,
    foreground,
    grown,
    logical_matrix,
    quiet_mask,
    threshold_mask,
    update_background,
)
from streamkit_differencer.filters.flicker import update_flicker
from streamkit_differencer.filters.ghost import ghost_mask
from streamkit_differencer.filters.shadow import shadow_mask
from streamkit_differencer.illumination import exposure_step, is_another_scene
from streamkit_differencer.noise import DEVIATION_RATIO, first_spread, thresholds, update_spread
from streamkit_differencer.resampling import LastFrames, Remembered, scrolled, warped

if TYPE_CHECKING:
    from numpy.typing import NDArray

    ByteImage = NDArray[np.uint8]
    FloatImage = NDArray[np.float32]
    Matrix = NDArray[np.float64]
    Points = NDArray[np.float64]
    Region = tuple[slice, slice]

# What foreground that is quiet is marked with, and what is shadow; other foreground has 255.
FOREGROUND_QUIET = 128
SHADOW = 50
# Mean deviation of a pixel where nothing is known of it, what the local range adds to that of its first
# frames, and the weight of a frame in learning it: under a camera that flies ground is in view for seconds.
FIRST_SPREAD = 5.0
EDGE_SPREAD = 0.08
SPREAD_COEFFICIENT = 0.05
HIGHEST_THRESHOLD = 60.0
WITHOUT_BACKGROUND = 22.0
# Of a frame that may be of another scene, so much changed.
LEAST_CUT_SHARE = 0.25
GHOST_INTERVAL = 3


class Event(enum.StrEnum):
    """What the model did at a frame, beyond learning."""

    NONE = "none"
    GAIN = "gain"
    RESET = "reset"


@dataclass(frozen=True, slots=True)
class ModelSettings:
    """What the model is to do.

    Attributes:
        interval: tau of equation 2, frames.
        quiet_frames: lambda of equation 1, frames, 1 to 255.
        change_threshold: T_s of equation 2, grey levels.
        foreground_threshold: smallest T_F of equation 4, grey levels.
        noise_gain: standard deviations of a pixel's own noise that raise its T_F; 0 is one T_F for all.
        coefficient: alpha of equation 3, per frame.
        tolerance: error of registration to bear, canvas px; the differencer chooses where it is negative.
        weak: share of its threshold from which a pixel beside foreground is foreground too, so that the
            tolerance hides no grey part of a thing; 1 is none, and without tolerance there is none.
        gradient_gain: share of the local range that raises T_s, and T_F until a pixel's noise is known.
        frame_threshold: share of changed pixels from which the whole model is begun anew.
        absorb_frames: frames after which a thing that stands still becomes background, 0 to 255.
        three_frame: whether pixels without background are judged by the difference of three frames; it finds
            more in the first half second, but large things in fragments.
        shadow: whether shadows are told from things.
        flicker: whether what turns to foreground and back all the time is left out.
        ghost: whether things that were learnt as ground and have left are noticed.
    """

    interval: int = 3
    quiet_frames: int = 12
    change_threshold: float = 18.0
    foreground_threshold: float = 7.0
    noise_gain: float = 4.0
    coefficient: float = 0.08
    tolerance: int = -1
    weak: float = 0.5
    gradient_gain: float = 0.3
    frame_threshold: float = 0.6
    absorb_frames: int = 60
    three_frame: bool = False
    shadow: bool = False
    flicker: bool = False
    ghost: bool = True


@dataclass(slots=True)
class BackgroundModel:
    """The state of every pixel of a canvas.

    Attributes:
        size: width and height of the canvas, px.
        settings: what to do.
        background: float32[h, w], B; where it is not valid it follows the frames.
        spread: float32[h, w], mean absolute deviation of the background, grey levels.
        valid: uint8[h, w], mask of the pixels whose background is known.
        dynamic: uint8[h, w], D, frames still to wait until a pixel is quiet.
        standing: uint8[h, w], frames that a pixel was foreground and quiet.
        restless: uint8[h, w], how often a pixel turned lately, see `filters.flicker`.
    """

    size: tuple[int, int]
    settings: ModelSettings
    background: FloatImage = field(init=False)
    spread: FloatImage = field(init=False)
    valid: ByteImage = field(init=False)
    dynamic: ByteImage = field(init=False)
    standing: ByteImage = field(init=False)
    restless: ByteImage = field(init=False)
    _foreground_before: ByteImage = field(init=False)
    _frames: int = 0
    _history: LastFrames = field(init=False)

    def __post_init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forgets everything."""
        shape = self.size[1], self.size[0]
        for name, fill in self._fills().items():
            setattr(self, name, np.full(shape, fill, np.uint8))
        self.background = np.zeros(shape, np.float32)
        self.spread = np.full(shape, FIRST_SPREAD, np.float32)
        # One more than equation 2 looks back: the newest and the one of tau before it, for `frames_apart`.
        length = self.settings.interval * (2 if self.settings.three_frame else 1) + 1
        self._history = LastFrames(shape, length)

    def _fills(self) -> dict[str, int]:
        """The byte images of the canvas, and what each is where nothing is known."""
        empty = ("valid", "standing", "restless", "_foreground_before")
        return {"dynamic": self.settings.quiet_frames} | dict.fromkeys(empty, 0)

    def scroll(self, dx: int, dy: int) -> None:
        """Moves everything by whole pixels: what was at (x, y) is then at (x + dx, y + dy)."""
        for name, fill in self._fills().items():
            setattr(self, name, scrolled(getattr(self, name), dx, dy, fill))
        self.background = scrolled(self.background, dx, dy, 0)
        self.spread = scrolled(self.spread, dx, dy, FIRST_SPREAD)
        self._history.scroll(dx, dy)

    def warp(self, change: Matrix) -> None:
        """Resamples everything onto another canvas: float64[3, 3] maps this canvas to that one."""
        for name, fill in self._fills().items():
            setattr(self, name, warped(getattr(self, name), change, fill))
        self.background = warped(self.background, change, 0, cv2.INTER_CUBIC)
        self.spread = warped(self.spread, change, FIRST_SPREAD)
        # Cubic resampling of the background mixes pixels across the border of what is known.
        self.valid = cast("ByteImage", cv2.erode(self.valid, np.ones((3, 3), np.uint8)))
        self._history.warp(change)

    def update(self, image: ByteImage, seen: ByteImage, region: Region) -> tuple[ByteImage, Event]:
        """Takes in one frame.

        Args:
            image: uint8[h, w], the frame on the canvas within `region`.
            seen: uint8[h, w], mask of the pixels that the frame covers.
            region: rows and columns of the canvas.

        Returns:
            Foreground, uint8[h, w] of the region: 0 background, 50 shadow, 128 foreground that is quiet, 255
            foreground that changed within `quiet_frames`; and what happened to the model as a whole.
        """
        event = self._follow_brightness(image, seen, region)
        changed, share = self._changed(image, seen, region)
        if share > self.settings.frame_threshold:
            self.reset()
            self._history.append(image, seen, region)
            return np.zeros_like(image), Event.RESET
        dynamic = self.dynamic[region]
        cv2.copyTo(dynamic_matrix(dynamic, changed, self.settings.quiet_frames), seen, dynamic)
        still = quiet_mask(dynamic)
        needed = self._thresholds(region)
        rounded = cast("ByteImage", cv2.convertScaleAbs(self.background[region]))
        mask = self._foreground(
            image, rounded if isinstance(needed, np.ndarray) else self.background[region], needed
        )
        known = seen & self.valid[region]
        mask &= known
        self._frames += 1
        if self.settings.tolerance > 0 and self.settings.weak < 1.0:
            mask = grown(mask, image, rounded, needed, self.settings.weak) & known
        # They stay where they are, so not every frame has to be searched.
        if self.settings.ghost and self._frames % GHOST_INTERVAL == 0:
            mask = self._without_ghosts(image, mask, rounded, region)
        shadow = shadow_mask(image, self.background[region], mask) if self.settings.shadow else None
        if isinstance(needed, np.ndarray):
            self._learn_noise(image, rounded, known & still & ~mask, needed, region)
        self._learn(image, seen, mask, still & seen, region)
        if self.settings.three_frame:
            mask |= self._three_frame(image, seen, region)
        self._accept(image, still & seen, region)
        self._history.append(image, seen, region)
        if self.settings.flicker:
            mask = self._without_flicker(mask, region)
        mask -= mask & still & np.uint8(255 - FOREGROUND_QUIET)
        if shadow is not None:
            cv2.copyTo(np.full_like(mask, SHADOW), shadow & mask, mask)
        return mask, event

    def contrast(self, points: Points) -> Points:
        """How far the last frame differs from the background, in multiples of the threshold.

        Args:
            points: float64[n, k, 2], x y on the canvas, k points in each of n objects.

        Returns:
            float64[n], the mean over those points of an object that exceed their threshold; 0 if none does.
        """
        if not self._history:
            return np.zeros(len(points))
        columns, rows = np.round(points).astype(np.intp).transpose(2, 0, 1)
        columns, rows = np.clip(columns, 0, self.size[0] - 1), np.clip(rows, 0, self.size[1] - 1)
        lowest = max(self.settings.foreground_threshold, 1.0)
        deviation = DEVIATION_RATIO * self.spread[rows, columns]
        needed = np.clip(self.settings.noise_gain * deviation, lowest, HIGHEST_THRESHOLD)
        excess = np.abs(self._history[-1].image[rows, columns] - self.background[rows, columns]) / needed
        counted = excess > 1.0
        total = np.where(counted, excess, 0.0).sum(axis=1)
        return np.asarray(total / np.maximum(counted.sum(axis=1), 1), np.float64)

    def frames_apart(self) -> tuple[ByteImage, ByteImage] | None:
        """The frames of `interval` frames ago and of now on the canvas, uint8[h, w]; None if too few came."""
        interval = self.settings.interval
        if len(self._history) <= interval:
            return None
        return self._history[-1 - interval].image, self._history[-1].image

    def _without_ghosts(
        self, image: ByteImage, mask: ByteImage, rounded: ByteImage, region: Region
    ) -> ByteImage:
        ghosts = ghost_mask(image, rounded, mask, self.valid[region])
        if cv2.countNonZero(ghosts):
            update_background(self.background[region], image, ghosts, 1.0)
        return mask & ~ghosts

    def _without_flicker(self, mask: ByteImage, region: Region) -> ByteImage:
        restless, before = self.restless[region], self._foreground_before[region]
        flickers = update_flicker(restless, before, mask)
        before[:] = mask
        return mask & ~flickers

    def _thresholds(self, region: Region) -> float | ByteImage:
        settings = self.settings
        lowest = settings.foreground_threshold
        if settings.noise_gain == 0.0:
            return lowest
        return thresholds(
            self.spread[region],
            settings.noise_gain,
            min(lowest, 255.0),
            max(min(lowest, 255.0), HIGHEST_THRESHOLD),
        )

    def _foreground(
        self, image: ByteImage, background: FloatImage | ByteImage, threshold: float | ByteImage
    ) -> ByteImage:
        settings = self.settings
        return foreground(
            image,
            background,
            threshold,
            tolerance=max(settings.tolerance, 0),
            # Where the noise of each pixel is known it tells of the edges, too.
            gradient_gain=0.0 if isinstance(threshold, np.ndarray) else settings.gradient_gain,
        )

    def _changed(self, image: ByteImage, seen: ByteImage, region: Region) -> tuple[ByteImage, float]:
        """Equation 2, and the share of the pixels seen both times that changed."""
        settings = self.settings
        if not self._history:
            return seen, 0.0
        earlier = self._earlier
        known = earlier.seen[region] & seen
        logical = logical_matrix(
            image, earlier.image[region], settings.change_threshold, gradient_gain=settings.gradient_gain
        )
        count = cv2.countNonZero(known)
        share = cv2.countNonZero(logical & known) / count if count else 0.0
        # Noise changes pixels and not the scene, a cut between like scenes the scene and not all pixels.
        if share > min(LEAST_CUT_SHARE, settings.frame_threshold):
            is_new = is_another_scene(earlier.image[region], image, known, settings.frame_threshold)
            share = 1.0 if is_new else min(share, settings.frame_threshold)
        # A pixel that was not in view tau frames ago is not known to be quiet.
        return logical | ~known, share

    @property
    def _earlier(self) -> Remembered:
        """The frame of tau before; a model that has just begun is sooner done when it takes its first one."""
        return self._history[-min(self.settings.interval, len(self._history))]

    def _three_frame(self, image: ByteImage, seen: ByteImage, region: Region) -> ByteImage:
        """Where there is no background: what differs both from tau and from twice tau frames before."""
        interval = self.settings.interval
        if len(self._history) < 2 * interval:
            return np.zeros_like(image)
        mask = seen & ~self.valid[region]
        for earlier in (self._history[-interval], self._history[-2 * interval]):
            mask &= earlier.seen[region] & self._foreground(image, earlier.image[region], WITHOUT_BACKGROUND)
        return mask

    def _learn(
        self, image: ByteImage, seen: ByteImage, mask: ByteImage, quiet: ByteImage, region: Region
    ) -> None:
        """Equation 3, for the pixels that are quiet and show the ground or something that stays."""
        background, standing = self.background[region], self.standing[region]
        still = quiet & mask
        cv2.add(standing, still & np.uint8(1), dst=standing)
        standing &= mask | ~seen
        absorbed = still & threshold_mask(standing, self.settings.absorb_frames - 1)
        taken = (seen & ~self.valid[region]) | absorbed
        if cv2.countNonZero(taken):
            update_background(background, image, taken, 1.0)
        update_background(background, image, quiet & ~mask, self.settings.coefficient)

    def _learn_noise(
        self, image: ByteImage, rounded: ByteImage, known: ByteImage, needed: ByteImage, region: Region
    ) -> None:
        """The noise of the pixels that show quiet ground."""
        # Every other frame with twice the weight: noise does not change from one to the next.
        if self._frames % 2 == 0:
            update_spread(self.spread[region], rounded, image, known, needed, 2 * SPREAD_COEFFICIENT)

    def _accept(self, image: ByteImage, quiet: ByteImage, region: Region) -> None:
        """Makes the background of quiet pixels valid; new ones get the noise that edges may have."""
        valid = self.valid[region]
        points = cv2.findNonZero(quiet & ~valid) if self.settings.noise_gain else None
        if points is not None:
            columns, rows = points.reshape(-1, 2).T
            edges = cv2.morphologyEx(image, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8))
            first = first_spread(self._earlier.image[region], image)
            self.spread[region][rows, columns] = first + EDGE_SPREAD * edges[rows, columns]
        valid |= quiet

    def _follow_brightness(self, image: ByteImage, seen: ByteImage, region: Region) -> Event:
        """Makes the model as bright as the frame."""
        if not self._history:
            return Event.NONE
        last, event = self._history[-1], Event.NONE
        step = exposure_step(last.image[region], image, last.seen[region] & seen)
        if step is not None:
            event = Event.GAIN
            self.background = np.clip(step.gain * self.background + step.offset, 0.0, 255.0)
            self._history.follow(step.gain, step.offset)
        # Exposure that creeps leaves the last frame alone, but not a background that learns slowly.
        creep = exposure_step(self.background[region], image, self.valid[region] & seen)
        if creep is not None:
            event = Event.GAIN
            self.background = np.clip(creep.gain * self.background + creep.offset, 0.0, 255.0)
        return event
