"""How sure a detection is: its contrast, how long it has been there, and how well the frame was placed."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numba import types

from streamkit_differencer.noise import DEVIATION_RATIO, HIGHEST_THRESHOLD
from streamkit_kernels import BYTES, FLOATS, TABLE, kernel

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
# Points along each side of an object where its contrast is asked.
GRID = 5


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


@kernel(TABLE, TABLE, BYTES, FLOATS, BYTES, FLOATS, types.float64, types.float64)
def contrasts(
    boxes: FloatArray,
    to_canvas: FloatArray,
    image: ByteImage,
    background: FloatImage,
    valid: ByteImage,
    spread: FloatImage,
    gain: float,
    lowest: float,
) -> FloatArray:
    """How far a picture differs from the background, in multiples of the threshold.

    Args:
        boxes: float64[n, 4], x0 y0 x1 y1, in each of which 25 points are asked.
        to_canvas: float64[3, 3], from the boxes' pixels to those of the pictures.
        image: uint8[h, w].
        background: float32[h, w].
        valid: uint8[h, w], mask of where that is known.
        spread: float32[h, w], noise of each pixel, grey levels.
        gain: deviations of the noise that the threshold is.
        lowest: smallest threshold, grey levels.

    Returns:
        float64[n], the mean over those points of an object that exceed their threshold; 0 if none does.
    """
    height, width = image.shape
    result = np.zeros(len(boxes))
    for number in range(len(boxes)):
        left, top, right, bottom = boxes[number]
        total, count = 0.0, 0
        for place in range(GRID * GRID):
            x = left + (right - left) * (0.1 + 0.2 * (place % GRID))
            y = top + (bottom - top) * (0.1 + 0.2 * (place // GRID))
            depth = to_canvas[2, 0] * x + to_canvas[2, 1] * y + to_canvas[2, 2]
            across = np.rint((to_canvas[0, 0] * x + to_canvas[0, 1] * y + to_canvas[0, 2]) / depth)
            down = np.rint((to_canvas[1, 0] * x + to_canvas[1, 1] * y + to_canvas[1, 2]) / depth)
            # In this order what is no number becomes 0.
            column = int(min(across if across > 0.0 else 0.0, width - 1.0))
            row = int(min(down if down > 0.0 else 0.0, height - 1.0))
            needed = min(max(gain * DEVIATION_RATIO * spread[row, column], lowest, 1.0), HIGHEST_THRESHOLD)
            excess = abs(image[row, column] - background[row, column]) / needed
            if excess > 1.0 and valid[row, column] > 0:
                total, count = total + excess, count + 1
        result[number] = total / max(count, 1)
    return result


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
