"""Noise of each pixel of the background: what equation 4's threshold is measured in.

A road is quiet, leaves are not, and an edge that is registered a third of a pixel off flickers: one threshold
for all is too high for the first or too low for the others.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import cv2
import numpy as np

from streamkit_differencer.resampling import scrolled, warped
from streamkit_differencer.scratch import Scratch

if TYPE_CHECKING:
    from numpy.typing import NDArray

    ByteImage = NDArray[np.uint8]
    FloatImage = NDArray[np.float32]
    IntArray = NDArray[np.intp]
    Matrix = NDArray[np.float64]
    Region = tuple[slice, slice]

SAMPLE_STEP = 8
MOST_DEVIATIONS = 3.0
LEAST_FIRST = 1.5
HIGHEST_THRESHOLD = 60.0
# Of a normal distribution: standard deviation over mean absolute deviation.
DEVIATION_RATIO = 1.2533
# Mean deviation of a pixel where nothing is known of it, and what the local range adds to that of its first
# frames.
FIRST_SPREAD = 5.0
EDGE_SPREAD = 0.08


@dataclass(slots=True)
class NoiseMap:
    """The noise of every pixel of a canvas, and the threshold that follows from it.

    Attributes:
        shape: rows and columns of the canvas.
        spread: float32[h, w], mean absolute deviation of the background, grey levels.
        needed: uint8[h, w], T_F of each pixel.
    """

    shape: tuple[int, int]
    spread: FloatImage = field(init=False)
    needed: ByteImage = field(init=False)
    _limits: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        self.spread = np.full(self.shape, FIRST_SPREAD, np.float32)
        self.needed = np.full(self.shape, HIGHEST_THRESHOLD, np.uint8)

    def set_limits(self, gain: float, lowest: float) -> None:
        """Deviations that the threshold is, and its smallest value, grey levels."""
        if self._limits != (gain, lowest):
            self._limits = gain, lowest
            thresholds(self.spread, gain, lowest, out=self.needed)

    def learn(
        self,
        region: Region,
        background: ByteImage,
        current: ByteImage,
        mask: ByteImage,
        coefficient: float,
        scratch: Scratch,
    ) -> None:
        """Takes in a frame, see `update_spread`; the pictures are of the region's shape."""
        spread, needed = self.spread[region], self.needed[region]
        update_spread(spread, background, current, mask, needed, coefficient, scratch)
        if self._limits is not None:
            thresholds(spread, *self._limits, out=needed)

    def begin(
        self, region: Region, rows: IntArray, columns: IntArray, ranges: ByteImage, first: float
    ) -> None:
        """Gives pixels of the region that have just got a background the noise that edges may have.

        Args:
            region: rows and columns of the canvas.
            rows: intp[n], within the region.
            columns: intp[n].
            ranges: uint8[n], local range around each.
            first: deviation of a pixel whose background is a single frame, see `first_spread`.
        """
        rough = EDGE_SPREAD * ranges + np.float32(first)
        self.spread[region][rows, columns] = rough
        if self._limits is not None:
            gain, lowest = self._limits
            needed = np.minimum(rough * np.float32(gain * DEVIATION_RATIO), max(lowest, HIGHEST_THRESHOLD))
            self.needed[region][rows, columns] = np.rint(np.maximum(needed, min(lowest, 255.0)))

    def scroll(self, dx: int, dy: int) -> None:
        """Moves all by whole pixels."""
        self.spread = scrolled(self.spread, dx, dy, FIRST_SPREAD)
        self.needed = scrolled(self.needed, dx, dy, HIGHEST_THRESHOLD)

    def warp(self, change: Matrix) -> None:
        """Resamples all onto another canvas."""
        self.spread = warped(self.spread, change, FIRST_SPREAD)
        self.needed = warped(self.needed, change, HIGHEST_THRESHOLD)


def thresholds(
    spread: FloatImage,
    gain: float,
    lowest: float,
    highest: float = HIGHEST_THRESHOLD,
    *,
    out: ByteImage | None = None,
) -> ByteImage:
    """T_F of each pixel, uint8[h, w]: `gain` standard deviations, within bounds.

    Args:
        spread: float32[h, w], mean absolute deviation of the background, grey levels.
        gain: standard deviations that are not foreground yet.
        lowest: smallest threshold, grey levels.
        highest: largest threshold, grey levels; no less than the smallest.
        out: uint8[h, w], where the result goes; None for an array of its own.
    """
    needed = np.empty(spread.shape, np.uint8) if out is None else out
    cv2.convertScaleAbs(spread, dst=needed, alpha=gain * DEVIATION_RATIO)
    lowest = min(lowest, 255.0)
    cv2.threshold(needed, max(lowest, highest), 0, cv2.THRESH_TRUNC, dst=needed)
    cv2.max(needed, np.full(needed.shape, lowest, np.uint8), dst=needed)
    return needed


def first_spread(earlier: ByteImage, current: ByteImage) -> float:
    """What a pixel whose background is a single frame differs from it by: the mean difference of two frames.

    Every eighth pixel of every eighth row tells; movers lose their say.

    Args:
        earlier: uint8[h, w], a frame on the canvas.
        current: uint8[h, w], a later one.
    """
    grid = np.s_[SAMPLE_STEP // 2 :: SAMPLE_STEP, SAMPLE_STEP // 2 :: SAMPLE_STEP]
    difference = np.abs(earlier[grid].astype(np.float32) - current[grid])
    if not difference.size:
        return LEAST_FIRST
    usual = difference[difference <= MOST_DEVIATIONS * np.median(difference) + 1.0]
    return max(float(usual.mean()), LEAST_FIRST)


def update_spread(
    spread: FloatImage,
    background: ByteImage,
    current: ByteImage,
    mask: ByteImage,
    most: ByteImage,
    coefficient: float,
    scratch: Scratch | None = None,
) -> None:
    """Learns the mean absolute deviation of the pixels in `mask`, in place, as a running mean.

    Args:
        spread: float32[h, w], grey levels.
        background: uint8[h, w], B(t - 1), rounded.
        current: uint8[h, w], f(t).
        mask: uint8[h, w], quiet pixels that show the background.
        most: uint8[h, w], what a difference counts as at most: a mover that was missed teaches little.
        coefficient: weight of this frame, 0 to 1.
        scratch: planes to work in.
    """
    deviation = (scratch or Scratch()).plane("deviation", current.shape)
    cv2.absdiff(background, current, dst=deviation)
    cv2.min(deviation, most, dst=deviation)
    cv2.accumulateWeighted(deviation, spread, coefficient, mask=mask)
