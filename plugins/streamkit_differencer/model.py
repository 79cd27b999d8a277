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
    logical_matrix,
    quiet_mask,
    threshold_mask,
    update_background,
)
from streamkit_differencer.illumination import exposure_step

if TYPE_CHECKING:
    from numpy.typing import NDArray

    ByteImage = NDArray[np.uint8]
    FloatImage = NDArray[np.float32]
    Matrix = NDArray[np.float64]
    Region = tuple[slice, slice]

Image = TypeVar("Image", "NDArray[np.uint8]", "NDArray[np.float32]")

# What foreground that is quiet is marked with; other foreground has 255.
FOREGROUND_QUIET = 128


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
        foreground_threshold: T_F of equation 4, grey levels.
        coefficient: alpha of equation 3, per frame.
        tolerance: error of registration to bear, canvas px.
        gradient_gain: share of the local range that raises both thresholds.
        frame_threshold: share of changed pixels from which the whole model is begun anew.
        absorb_frames: frames after which a thing that stands still becomes background, 0 to 255.
        three_frame: whether pixels without background are judged by the difference of three frames; it finds
            more in the first half second, but large things in fragments.
    """

    interval: int = 3
    quiet_frames: int = 12
    change_threshold: float = 18.0
    foreground_threshold: float = 22.0
    coefficient: float = 0.08
    tolerance: int = 1
    gradient_gain: float = 0.3
    frame_threshold: float = 0.6
    absorb_frames: int = 60
    three_frame: bool = False


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
        valid: uint8[h, w], mask of the pixels whose background is known.
        dynamic: uint8[h, w], D, frames still to wait until a pixel is quiet.
        standing: uint8[h, w], frames that a pixel was foreground and quiet.
    """

    size: tuple[int, int]
    settings: ModelSettings
    background: FloatImage = field(init=False)
    valid: ByteImage = field(init=False)
    dynamic: ByteImage = field(init=False)
    standing: ByteImage = field(init=False)
    _history: list[Remembered] = field(init=False)

    def __post_init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forgets everything."""
        shape = self.size[1], self.size[0]
        self.background = np.zeros(shape, np.float32)
        self.valid = np.zeros(shape, np.uint8)
        self.dynamic = np.full(shape, self.settings.quiet_frames, np.uint8)
        self.standing = np.zeros(shape, np.uint8)
        self._history = []

    def scroll(self, dx: int, dy: int) -> None:
        """Moves everything by whole pixels: what was at (x, y) is then at (x + dx, y + dy)."""
        self.background = scrolled(self.background, dx, dy, 0)
        self.valid = scrolled(self.valid, dx, dy, 0)
        self.dynamic = scrolled(self.dynamic, dx, dy, self.settings.quiet_frames)
        self.standing = scrolled(self.standing, dx, dy, 0)
        for earlier in self._history:
            earlier.image = scrolled(earlier.image, dx, dy, 0)
            earlier.seen = scrolled(earlier.seen, dx, dy, 0)

    def warp(self, change: Matrix) -> None:
        """Resamples everything onto another canvas: float64[3, 3] maps this canvas to that one."""
        self.background = self._warped(self.background, change, cv2.INTER_CUBIC, 0)
        self.valid = self._warped(self.valid, change, cv2.INTER_NEAREST, 0)
        self.dynamic = self._warped(self.dynamic, change, cv2.INTER_NEAREST, self.settings.quiet_frames)
        self.standing = self._warped(self.standing, change, cv2.INTER_NEAREST, 0)
        # Cubic resampling of the background mixes pixels across the border of what is known.
        self.valid = cast("ByteImage", cv2.erode(self.valid, np.ones((3, 3), np.uint8)))
        for earlier in self._history:
            earlier.image = self._warped(earlier.image, change, cv2.INTER_CUBIC, 0)
            earlier.seen = self._warped(earlier.seen, change, cv2.INTER_NEAREST, 0)

    def _warped(self, image: Image, change: Matrix, interpolation: int, border: int) -> Image:
        warped = cv2.warpPerspective(image, change, self.size, flags=interpolation, borderValue=border)
        return cast("Image", warped)

    def update(self, image: ByteImage, seen: ByteImage, region: Region) -> tuple[ByteImage, Event]:
        """Takes in one frame.

        Args:
            image: uint8[h, w], the frame on the canvas within `region`.
            seen: uint8[h, w], mask of the pixels that the frame covers.
            region: rows and columns of the canvas.

        Returns:
            Foreground, uint8[h, w] of the region: 0 background, 128 foreground that is quiet, 255
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
        mask = self._foreground(image, self.background[region]) & seen & self.valid[region]
        self._learn(image, seen, mask, still & seen, region)
        if self.settings.three_frame:
            mask |= self._three_frame(image, seen, region)
        self.valid[region] |= still & seen
        self._remember(image, seen, region)
        mask -= mask & still & np.uint8(255 - FOREGROUND_QUIET)
        return mask, event

    def _foreground(self, image: ByteImage, background: FloatImage | ByteImage) -> ByteImage:
        settings = self.settings
        return foreground(
            image,
            background,
            settings.foreground_threshold,
            tolerance=settings.tolerance,
            gradient_gain=settings.gradient_gain,
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
            mask &= earlier.seen[region] & self._foreground(image, earlier.image[region])
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
        unknown = seen & ~self.valid[region]
        cv2.copyTo(image.astype(np.float32), unknown | absorbed, background)
        update_background(background, image, quiet & ~mask, self.settings.coefficient)

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
        length = self.settings.interval * (2 if self.settings.three_frame else 1)
        if len(self._history) < length:
            shape = self.valid.shape
            oldest = Remembered(np.zeros(shape, np.uint8), np.zeros(shape, np.uint8))
        else:
            oldest = self._history.pop(0)
        oldest.seen[:] = 0
        oldest.image[region], oldest.seen[region] = image, seen
        self._history.append(oldest)


def scrolled(image: Image, dx: int, dy: int, fill: int) -> Image:
    """The image moved by whole pixels, with `fill` where nothing came in."""
    result = np.full_like(image, fill)
    height, width = image.shape[:2]
    if abs(dx) < width and abs(dy) < height:
        rows, columns = max(0, dy), max(0, dx)
        source = image[max(0, -dy) : height - rows, max(0, -dx) : width - columns]
        result[rows : rows + source.shape[0], columns : columns + source.shape[1]] = source
    return result
