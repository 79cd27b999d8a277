"""The background model: equations 1 to 4 on the canvas, made fit for a camera that moves.

What is added to the equations: a pixel of the frame that is new to the canvas has no background until it was
quiet; comparison bears an error of registration; a thing that stands still stays foreground for a while and
then becomes background; a change of exposure is taken over instead of seen as motion.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeVar, cast

import cv2
import numpy as np

from streamkit_differencer.equations import (
    dynamic_matrix,
    foreground,
    local_bounds,
    logical_matrix,
    quiet_mask,
    threshold_mask,
    update_background,
)
from streamkit_differencer.filters.flicker import update_flicker
from streamkit_differencer.filters.ghost import ghost_mask
from streamkit_differencer.filters.shadow import shadow_mask
from streamkit_differencer.illumination import exposure_step
from streamkit_differencer.noise import thresholds, update_spread

if TYPE_CHECKING:
    from numpy.typing import NDArray

    ByteImage = NDArray[np.uint8]
    FloatImage = NDArray[np.float32]
    Matrix = NDArray[np.float64]
    Points = NDArray[np.float64]
    Region = tuple[slice, slice]

Image = TypeVar("Image", "NDArray[np.uint8]", "NDArray[np.float32]")

# What foreground that is quiet is marked with, and what is shadow; other foreground has 255.
FOREGROUND_QUIET = 128
SHADOW = 50
# Standard deviation that a pixel is given before its own is known, and the weight of a frame in learning it.
FIRST_SPREAD = 6.0
SPREAD_COEFFICIENT = 0.02
HIGHEST_THRESHOLD = 60.0
WITHOUT_BACKGROUND = 22.0
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
    foreground_threshold: float = 10.0
    noise_gain: float = 4.0
    coefficient: float = 0.08
    tolerance: int = -1
    gradient_gain: float = 0.3
    frame_threshold: float = 0.6
    absorb_frames: int = 60
    three_frame: bool = False
    shadow: bool = False
    flicker: bool = False
    ghost: bool = True


@dataclass(slots=True)
class Remembered:
    """An earlier frame on the canvas and where it covered it."""

    image: ByteImage
    seen: ByteImage


@dataclass(slots=True)
class BackgroundModel:
    """The state of every pixel of a canvas.

    Attributes:
        size: width and height of the canvas, px.
        settings: what to do.
        background: float32[h, w], B; where it is not valid it follows the frames.
        spread: float32[h, w], standard deviation of the background, grey levels.
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
    _history: list[Remembered] = field(init=False)

    def __post_init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forgets everything."""
        shape = self.size[1], self.size[0]
        self.background = np.zeros(shape, np.float32)
        self.spread = np.full(shape, FIRST_SPREAD, np.float32)
        self.valid = np.zeros(shape, np.uint8)
        self.dynamic = np.full(shape, self.settings.quiet_frames, np.uint8)
        self.standing = np.zeros(shape, np.uint8)
        self.restless = np.zeros(shape, np.uint8)
        self._foreground_before = np.zeros(shape, np.uint8)
        self._history = []

    def scroll(self, dx: int, dy: int) -> None:
        """Moves everything by whole pixels: what was at (x, y) is then at (x + dx, y + dy)."""
        self.background = scrolled(self.background, dx, dy, 0)
        self.spread = scrolled(self.spread, dx, dy, FIRST_SPREAD)
        self.valid = scrolled(self.valid, dx, dy, 0)
        self.dynamic = scrolled(self.dynamic, dx, dy, self.settings.quiet_frames)
        self.standing = scrolled(self.standing, dx, dy, 0)
        self.restless = scrolled(self.restless, dx, dy, 0)
        self._foreground_before = scrolled(self._foreground_before, dx, dy, 0)
        for earlier in self._history:
            earlier.image = scrolled(earlier.image, dx, dy, 0)
            earlier.seen = scrolled(earlier.seen, dx, dy, 0)

    def warp(self, change: Matrix) -> None:
        """Resamples everything onto another canvas: float64[3, 3] maps this canvas to that one."""
        self.background = self._warped(self.background, change, cv2.INTER_CUBIC, 0)
        self.spread = self._warped(self.spread, change, cv2.INTER_NEAREST, FIRST_SPREAD)
        self.valid = self._warped(self.valid, change, cv2.INTER_NEAREST, 0)
        self.dynamic = self._warped(self.dynamic, change, cv2.INTER_NEAREST, self.settings.quiet_frames)
        self.standing = self._warped(self.standing, change, cv2.INTER_NEAREST, 0)
        self.restless = self._warped(self.restless, change, cv2.INTER_NEAREST, 0)
        self._foreground_before = self._warped(self._foreground_before, change, cv2.INTER_NEAREST, 0)
        # Cubic resampling of the background mixes pixels across the border of what is known.
        self.valid = cast("ByteImage", cv2.erode(self.valid, np.ones((3, 3), np.uint8)))
        for earlier in self._history:
            earlier.image = self._warped(earlier.image, change, cv2.INTER_CUBIC, 0)
            earlier.seen = self._warped(earlier.seen, change, cv2.INTER_NEAREST, 0)

    def _warped(self, image: Image, change: Matrix, interpolation: int, border: float) -> Image:
        warped = cv2.warpPerspective(image, change, self.size, flags=interpolation, borderValue=border)
        return cast("Image", warped)

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
            self._remember(image, seen, region)
            return np.zeros_like(image), Event.RESET
        dynamic = self.dynamic[region]
        cv2.copyTo(dynamic_matrix(dynamic, changed, self.settings.quiet_frames), seen, dynamic)
        still = quiet_mask(dynamic)
        mask = self._foreground(image, self.background[region], self._thresholds(region))
        mask &= seen & self.valid[region]
        # They stay where they are, so not every frame has to be searched.
        if self.settings.ghost and self._frames % GHOST_INTERVAL == 0:
            mask = self._without_ghosts(image, mask, region)
        shadow = shadow_mask(image, self.background[region], mask) if self.settings.shadow else None
        self._learn(image, seen, mask, still & seen, region)
        if self.settings.three_frame:
            mask |= self._three_frame(image, seen, region)
        self._accept(still & seen, region)
        self._remember(image, seen, region)
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
        needed = np.clip(self.settings.noise_gain * self.spread[rows, columns], lowest, HIGHEST_THRESHOLD)
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

    def _without_ghosts(self, image: ByteImage, mask: ByteImage, region: Region) -> ByteImage:
        background = self.background[region]
        rounded = cast("ByteImage", cv2.convertScaleAbs(background))
        ghosts = ghost_mask(image, rounded, mask, self.valid[region])
        if cv2.countNonZero(ghosts):
            cv2.copyTo(image.astype(np.float32), ghosts, background)
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
        if len(self._history) < settings.interval:
            return seen, 0.0
        earlier = self._history[-settings.interval]
        known = earlier.seen[region] & seen
        logical = logical_matrix(
            image, earlier.image[region], settings.change_threshold, gradient_gain=settings.gradient_gain
        )
        count = cv2.countNonZero(known)
        share = cv2.countNonZero(logical & known) / count if count else 0.0
        # A pixel that was not in view tau frames ago is not known to be quiet.
        return logical | ~known, share

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
        self._frames += 1
        # Every other frame with twice the weight: noise does not change from one to the next.
        if self.settings.noise_gain and self._frames % 2 == 0:
            known = quiet & ~mask & self.valid[region]
            update_spread(self.spread[region], background, image, known, 2 * SPREAD_COEFFICIENT)
        taken = (seen & ~self.valid[region]) | absorbed
        if cv2.countNonZero(taken):
            cv2.copyTo(image.astype(np.float32), taken, background)
        update_background(background, image, quiet & ~mask, self.settings.coefficient)

    def _accept(self, quiet: ByteImage, region: Region) -> None:
        """Makes the background of quiet pixels valid; new ones get the noise that edges may have."""
        valid = self.valid[region]
        new = quiet & ~valid
        if self.settings.noise_gain and self.settings.gradient_gain and cv2.countNonZero(new):
            known = cast("ByteImage", cv2.convertScaleAbs(self.background[region]))
            lowest, highest = local_bounds(known, 1)
            edges = (highest - lowest).astype(np.float32)
            expected = self.settings.gradient_gain * edges + np.float32(FIRST_SPREAD)
            cv2.copyTo(expected, new, self.spread[region])
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
            for earlier in self._history:
                earlier.image = cast(
                    "ByteImage",
                    cv2.addWeighted(earlier.image, step.gain, earlier.image, 0.0, step.offset),
                )
        # Exposure that creeps leaves the last frame alone, but not a background that learns slowly.
        creep = exposure_step(self.background[region], image, self.valid[region] & seen)
        if creep is not None:
            event = Event.GAIN
            self.background = np.clip(creep.gain * self.background + creep.offset, 0.0, 255.0)
        return event

    def _remember(self, image: ByteImage, seen: ByteImage, region: Region) -> None:
        """Puts the frame into the ring of the last frames, in the arrays of the oldest."""
        # One more than equation 2 looks back: the newest and the one of tau before it, for `frames_apart`.
        length = self.settings.interval * (2 if self.settings.three_frame else 1) + 1
        if len(self._history) < length:
            shape = self.valid.shape
            oldest = Remembered(np.zeros(shape, np.uint8), np.zeros(shape, np.uint8))
        else:
            oldest = self._history.pop(0)
        oldest.seen[:] = 0
        oldest.image[region], oldest.seen[region] = image, seen
        self._history.append(oldest)


def scrolled(image: Image, dx: int, dy: int, fill: float) -> Image:
    """The image moved by whole pixels, with `fill` where nothing came in."""
    result = np.full_like(image, fill)
    height, width = image.shape[:2]
    if abs(dx) < width and abs(dy) < height:
        rows, columns = max(0, dy), max(0, dx)
        source = image[max(0, -dy) : height - rows, max(0, -dx) : width - columns]
        result[rows : rows + source.shape[0], columns : columns + source.shape[1]] = source
    return result
