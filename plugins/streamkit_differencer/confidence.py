"""Confidence of a detection: its contrast, its age in frames, and the quality of the frame's registration."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numba import types

from streamkit_differencer.arrays import ByteImage, FloatArray, FloatImage
from streamkit_differencer.noise import DEVIATION_RATIO, HIGHEST_THRESHOLD
from streamkit_kernels import BYTES, FLOATS, TABLE, kernel

# Contrast, in multiples of the threshold, above half a threshold, at which the confidence reaches 0.63.
CONTRAST_SCALE = 1.0
LONG_ENOUGH_FRAMES = 4
# Factor of an object of age 0.
FIRST_SHARE = 0.5
# Sampled points along each side of an object.
GRID = 5


@dataclass(slots=True)
class Persistence:
    """Counts the frames since each object appeared; objects whose boxes overlap are the same.

    Attributes:
        boxes: float64[n, 4], of the last frame's objects on the canvas.
    """

    boxes: FloatArray = field(default_factory=lambda: np.zeros((0, 4)))
    _ages: FloatArray = field(default_factory=lambda: np.zeros(0))

    def update(self, boxes: FloatArray) -> FloatArray:
        """Ages of the objects of a frame, float64[n], 1 for new ones; boxes float64[n, 4] x0 y0 x1 y1."""
        ages = np.ones(len(boxes))
        if len(boxes) and len(self.boxes):
            low = np.maximum(boxes[:, None, :2], self.boxes[None, :, :2])
            high = np.minimum(boxes[:, None, 2:], self.boxes[None, :, 2:])
            overlaps = (high > low).all(axis=2)
            ages += np.where(overlaps, self._ages, 0.0).max(axis=1)
        self.boxes, self._ages = boxes, ages
        return ages


@kernel(TABLE, TABLE, BYTES, FLOATS, BYTES, FLOATS, types.float64, types.float64)
def contrasts(
    boxes: FloatArray,
    to_canvas: FloatArray,
    image: ByteImage,
    background: FloatImage,
    valid: ByteImage,
    deviation: FloatImage,
    gain: float,
    lowest: float,
) -> FloatArray:
    """Contrast of an image to the background in boxes, in multiples of the threshold.

    Args:
        boxes: float64[n, 4], x0 y0 x1 y1; 25 points of each are sampled.
        to_canvas: float64[3, 3], from the boxes' pixels to those of the images.
        image: uint8[h, w].
        background: float32[h, w].
        valid: uint8[h, w], mask of where it is known.
        deviation: float32[h, w], noise of each pixel, grey levels.
        gain: threshold in standard deviations of the noise.
        lowest: smallest threshold, grey levels.

    Returns:
        float64[n], the mean over the points of an object that exceed their threshold; 0 if none does.
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
            # This comparison order maps NaN to 0.
            column = int(min(across if across > 0.0 else 0.0, width - 1.0))
            row = int(min(down if down > 0.0 else 0.0, height - 1.0))
            threshold = min(
                max(gain * DEVIATION_RATIO * deviation[row, column], lowest, 1.0), HIGHEST_THRESHOLD
            )
            excess = abs(image[row, column] - background[row, column]) / threshold
            if excess > 1.0 and valid[row, column] > 0:
                total, count = total + excess, count + 1
        result[number] = total / max(count, 1)
    return result


def confidence(contrast: FloatArray, ages: FloatArray, registration: float) -> FloatArray:
    """Confidence of each object, float64[n], 0 to 1.

    Args:
        contrast: float64[n], see `contrasts`; 1 is just foreground.
        ages: float64[n], frames since each appeared, from 1.
        registration: quality of the registration, 0 to 1; 1 for a fixed camera.
    """
    clear = 1.0 - np.exp(-np.maximum(contrast - 0.5, 0.0) / CONTRAST_SCALE)
    lasting = FIRST_SHARE + (1.0 - FIRST_SHARE) * np.minimum(ages / LONG_ENOUGH_FRAMES, 1.0)
    return np.asarray(np.minimum(np.maximum(clear * lasting * registration, 0.0), 1.0))
