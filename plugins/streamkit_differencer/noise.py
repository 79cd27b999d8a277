"""Noise of each pixel of the background: what equation 4's threshold is measured in.

A road is quiet, leaves are not, and an edge that is registered a third of a pixel off flickers: one threshold
for all is too high for the first or too low for the others.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from streamkit_differencer.learning import begin_noise, learn_noise, set_thresholds
from streamkit_differencer.new_ground import look_first
from streamkit_differencer.resampling import filled, scrolled, warped

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from streamkit_differencer.canvas_region import Region
    from streamkit_differencer.resampling import Remembered

    ByteImage = NDArray[np.uint8]
    FloatImage = NDArray[np.float32]
    Matrix = NDArray[np.float64]

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
        needed: uint8[h, w], T_F of each pixel: so many deviations, within bounds.
    """

    shape: tuple[int, int]
    spread: FloatImage = field(init=False)
    needed: ByteImage = field(init=False)
    _limits: tuple[float, int, int] | None = None

    def __post_init__(self) -> None:
        self.spread = filled(self.shape, FIRST_SPREAD, np.float32)
        self.needed = filled(self.shape, HIGHEST_THRESHOLD, np.uint8)

    def set_limits(self, gain: float, lowest: float) -> None:
        """Standard deviations that the threshold is, 0 for one threshold, and its smallest value."""
        least = int(min(lowest, 255.0))
        limits = gain * DEVIATION_RATIO, least, max(least, int(HIGHEST_THRESHOLD))
        if self._limits != limits:
            self._limits = limits
            set_thresholds(self.spread, self.needed, (0, self.shape[0], 0, self.shape[1]), *limits)

    def learn(
        self, image: ByteImage, background: ByteImage, lessons: ByteImage, region: Region, coefficient: float
    ) -> None:
        """Takes in a frame, see `learning.learn_noise`; `set_limits` came before."""
        assert self._limits is not None
        learn_noise(image, background, lessons, self.spread, self.needed, region, coefficient, *self._limits)

    def begin(self, earlier: ByteImage, lessons: ByteImage, region: Region, first: float) -> None:
        """Gives new pixels the noise that edges may have, see `learning.begin_noise`."""
        assert self._limits is not None
        begin_noise(earlier, lessons, self.spread, self.needed, region, first, EDGE_SPREAD, *self._limits)

    def look_first(
        self,
        seen: ByteImage,
        earlier: Remembered,
        waiting: ByteImage,
        background: FloatImage,
        valid: ByteImage,
        region: Region,
        first: float,
    ) -> None:
        """Gives new ground a first background, see `new_ground.look_first`; `set_limits` came before."""
        assert self._limits is not None
        look_first(
            seen,
            earlier.image,
            earlier.seen,
            waiting,
            background,
            valid,
            self.spread,
            self.needed,
            region,
            first,
            EDGE_SPREAD,
            *self._limits,
        )

    def scroll(self, dx: int, dy: int) -> None:
        """Moves all by whole pixels."""
        self.spread = scrolled(self.spread, dx, dy, FIRST_SPREAD)
        self.needed = scrolled(self.needed, dx, dy, HIGHEST_THRESHOLD)

    def warp(self, change: Matrix) -> None:
        """Resamples all onto another canvas."""
        self.spread[:] = warped(self.spread, change, FIRST_SPREAD)
        self.needed[:] = warped(self.needed, change, HIGHEST_THRESHOLD)


def first_spread(earlier: ByteImage, current: ByteImage, *known: ByteImage) -> float:
    """What a pixel whose background is a single frame differs from it by: the mean difference of two frames.

    Every eighth pixel of every eighth row tells; movers lose their say.

    Args:
        earlier: uint8[h, w], a frame on the canvas.
        current: uint8[h, w], a later one.
        known: uint8[h, w] each, masks of what they cover; all must be set.
    """
    grid = np.s_[SAMPLE_STEP // 2 :: SAMPLE_STEP, SAMPLE_STEP // 2 :: SAMPLE_STEP]
    difference = np.abs(earlier[grid].astype(np.float32) - current[grid])
    for mask in known:
        difference[mask[grid] == 0] = -1.0
    difference = difference[difference >= 0.0]
    if not difference.size:
        return LEAST_FIRST
    usual = difference[difference <= MOST_DEVIATIONS * np.median(difference) + 1.0]
    return max(float(usual.mean()), LEAST_FIRST)
