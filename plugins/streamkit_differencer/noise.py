"""Noise of each pixel of the background, the unit of equation 4's threshold.

A road is quiet, leaves are not, and an edge with a registration error flickers: one threshold for all pixels
is too high for the first or too low for the others.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from streamkit_differencer.arrays import ByteImage, FloatArray, FloatImage, Region
from streamkit_differencer.canvas_images import CanvasFrame, allocated, scrolled, warped
from streamkit_differencer.noise_learning import begin_noise, learn_noise, set_provisional, set_thresholds

SAMPLE_STEP = 8
MOST_DEVIATIONS = 3.0
# Tiles along each side of the frame, and the share of them where nothing may be moving.
TILES, QUIET_SHARE = 4, 0.1
LEAST_FIRST_DEVIATION = 1.5
HIGHEST_THRESHOLD = 60.0
# Of a normal distribution: standard deviation over mean absolute deviation.
DEVIATION_RATIO = 1.2533
# Mean deviation of an unknown pixel, and the share of the local range added to that of its first frames.
UNKNOWN_DEVIATION = 5.0
EDGE_SHARE = 0.08


@dataclass(slots=True)
class NoiseMap:
    """The noise of every pixel of a canvas, and the threshold that follows from it.

    Attributes:
        shape: rows and columns of the canvas.
        deviation: float32[h, w], mean absolute deviation of the background, grey levels.
        thresholds: uint8[h, w], T_F of each pixel: a multiple of the deviation, within limits.
    """

    shape: tuple[int, int]
    deviation: FloatImage = field(init=False)
    thresholds: ByteImage = field(init=False)
    _limits: tuple[float, int, int] | None = None

    def __post_init__(self) -> None:
        self.deviation = allocated(self.shape, UNKNOWN_DEVIATION, np.float32)
        self.thresholds = allocated(self.shape, HIGHEST_THRESHOLD, np.uint8)

    def set_limits(self, gain: float, lowest: float) -> None:
        """Sets the threshold in standard deviations, 0 for the same everywhere, and its smallest value."""
        least = int(min(lowest, 255.0))
        limits = gain * DEVIATION_RATIO, least, max(least, int(HIGHEST_THRESHOLD))
        if self._limits != limits:
            self._limits = limits
            set_thresholds(self.deviation, self.thresholds, (0, self.shape[0], 0, self.shape[1]), *limits)

    def learn(
        self,
        image: ByteImage,
        background: ByteImage,
        updates: ByteImage,
        mask: ByteImage,
        valid: ByteImage,
        region: Region,
        rate: float,
        restless_rate: float,
    ) -> None:
        """Learns from a frame, see `noise_learning.learn_noise`; call `set_limits` before."""
        assert self._limits is not None
        images = image, background, updates, mask, valid, self.deviation, self.thresholds
        learn_noise(*images, region, rate, restless_rate, *self._limits)

    def begin(self, earlier: ByteImage, updates: ByteImage, region: Region, first: float) -> None:
        """Initialises new pixels, see `noise_learning.begin_noise`."""
        assert self._limits is not None
        begin_noise(
            earlier, updates, self.deviation, self.thresholds, region, first, EDGE_SHARE, *self._limits
        )

    def set_provisional(
        self,
        seen: ByteImage,
        earlier: CanvasFrame,
        waiting: ByteImage,
        background: FloatImage,
        valid: ByteImage,
        region: Region,
        first: float,
    ) -> None:
        """Gives new ground a background, see `noise_learning.set_provisional`; call `set_limits` before."""
        assert self._limits is not None
        images = *earlier, waiting, background, valid, self.deviation, self.thresholds
        set_provisional(seen, *images, region, first, EDGE_SHARE, *self._limits)

    def scroll(self, dx: int, dy: int) -> None:
        """Moves everything by whole pixels."""
        self.deviation = scrolled(self.deviation, dx, dy, UNKNOWN_DEVIATION)
        self.thresholds = scrolled(self.thresholds, dx, dy, HIGHEST_THRESHOLD)

    def warp(self, change: FloatArray) -> None:
        """Resamples everything onto another canvas."""
        self.deviation[:] = warped(self.deviation, change, UNKNOWN_DEVIATION)
        self.thresholds[:] = warped(self.thresholds, change, HIGHEST_THRESHOLD)


def first_deviation(earlier: ByteImage, current: ByteImage, *known: ByteImage) -> float:
    """Mean deviation of pixels whose background is a single frame: that of two frames where less moves.

    Args:
        earlier: uint8[h, w], a frame on the canvas, sampled at every eighth pixel of every eighth row.
        current: uint8[h, w], a later one.
        known: uint8[h, w] each, masks of what they cover; all must be set.
    """
    grid = np.s_[SAMPLE_STEP // 2 :: SAMPLE_STEP, SAMPLE_STEP // 2 :: SAMPLE_STEP]
    difference = np.abs(earlier[grid].astype(np.float32) - current[grid])
    for mask in known:
        difference[mask[grid] == 0] = -1.0
    means = []
    for rows in np.array_split(difference, TILES):
        for tile in np.array_split(rows, TILES, axis=1):
            values = tile[tile >= 0.0]
            if values.size:
                means.append(values[values <= MOST_DEVIATIONS * np.median(values) + 1.0].mean())
    return max(float(np.quantile(means, QUIET_SHARE)) if means else 0.0, LEAST_FIRST_DEVIATION)
