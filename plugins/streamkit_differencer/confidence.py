"""How sure a detection is: its contrast, how long it has been there, and how well the frame was placed."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from streamkit_differencer.noise import DEVIATION_RATIO, HIGHEST_THRESHOLD
from streamkit_differencer.resampling import held

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    ByteImage = NDArray[np.uint8]
    FloatImage = NDArray[np.float32]
    FloatArray = NDArray[np.float64]

# Contrast at which two thirds of the doubt is gone, in multiples of the threshold it has to exceed.
CONTRAST_SCALE = 1.0
LONG_ENOUGH_FRAMES = 4
# What an object is worth in the frame that shows it first.
FIRST_SHARE = 0.5


@dataclass(slots=True)
class Persistence:
    """Counts for how many frames each object has been there.

    Objects are taken for the same where their boxes overlap; boxes are on the canvas, so that a camera's
    motion is no motion of theirs.
    """

    _boxes: FloatArray = field(default_factory=lambda: np.zeros((0, 4)))
    _ages: FloatArray = field(default_factory=lambda: np.zeros(0))

    def update(self, boxes: FloatArray) -> FloatArray:
        """Ages of the objects of a frame, float64[n], 1 for new ones; boxes float64[n, 4] x0 y0 x1 y1."""
        ages = np.ones(len(boxes))
        if len(boxes) and len(self._boxes):
            low = np.maximum(boxes[:, None, :2], self._boxes[None, :, :2])
            high = np.minimum(boxes[:, None, 2:], self._boxes[None, :, 2:])
            overlaps = (high > low).all(axis=2)
            ages += np.where(overlaps, self._ages, 0.0).max(axis=1)
        self._boxes, self._ages = boxes, ages
        return ages

    def follow(self, change: Callable[[FloatArray], FloatArray]) -> None:
        """The canvas moved: `change` maps boxes on the old one to the new one."""
        self._boxes = change(self._boxes)


def contrast_at(
    points: FloatArray,
    image: ByteImage,
    known: tuple[FloatImage, ByteImage, FloatImage],
    limits: tuple[float, float],
) -> FloatArray:
    """How far a picture differs from the background, in multiples of the threshold.

    Args:
        points: float64[n, k, 2], x y, k points in each of n objects.
        image: uint8[h, w].
        known: the background, float32[h, w]; the mask of where it is valid, uint8[h, w]; and the noise of
            each pixel, float32[h, w], grey levels.
        limits: deviations of the noise that the threshold is, and its smallest value, grey levels.

    Returns:
        float64[n], the mean over those points of an object that exceed their threshold; 0 if none does.
    """
    columns, rows = np.round(points).astype(np.intp).transpose(2, 0, 1)
    columns, rows = held(columns, image.shape[1]), held(rows, image.shape[0])
    background, valid, spread = known
    gain, lowest = limits
    needed = gain * DEVIATION_RATIO * spread[rows, columns]
    needed = np.minimum(np.maximum(needed, max(lowest, 1.0)), HIGHEST_THRESHOLD)
    excess = np.abs(image[rows, columns] - background[rows, columns]) / needed
    counted = (excess > 1.0) & (valid[rows, columns] > 0)
    total = np.where(counted, excess, 0.0).sum(axis=1)
    return np.asarray(total / np.maximum(counted.sum(axis=1), 1), np.float64)


def confidence(contrast: FloatArray, ages: FloatArray, registration: float) -> FloatArray:
    """How sure each object is, float64[n], 0 to 1.

    Args:
        contrast: float64[n], mean difference from the background over the threshold; 1 is just foreground.
        ages: float64[n], frames since each appeared, from 1.
        registration: how well the frame was placed, 0 to 1; 1 for a camera that does not move.
    """
    clear = 1.0 - np.exp(-np.maximum(contrast - 0.5, 0.0) / CONTRAST_SCALE)
    lasting = FIRST_SHARE + (1.0 - FIRST_SHARE) * np.minimum(ages / LONG_ENOUGH_FRAMES, 1.0)
    return np.asarray(np.minimum(np.maximum(clear * lasting * registration, 0.0), 1.0))
