"""Confidence of a detection: its contrast, its age in frames, and the quality of the frame's registration."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from streamkit_differencer.arrays import ByteImage, FloatArray, overlaps
from streamkit_differencer.warping import mapped_into, mapped_point
from streamkit_kernels import FLOAT64, UINT8_STRIDED, kernel

# Contrast, in multiples of the threshold, above half a threshold, at which the confidence reaches 0.63.
CONTRAST_SCALE = 1.0
LONG_ENOUGH_FRAMES = 4
# Factor of an object of age 0.
FIRST_SHARE = 0.5
# Points along each side of an object's box that are sampled.
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
        self._ages = 1.0 + np.where(overlaps(boxes, self.boxes), self._ages, 0.0).max(axis=1, initial=0.0)
        self.boxes = boxes
        return self._ages


@kernel(FLOAT64, FLOAT64)
def mapped_boxes(matrix: FloatArray, boxes: FloatArray) -> FloatArray:
    """Bounding boxes of boxes under a homography, float64[n, 4] x0 y0 x1 y1."""
    found = np.empty_like(boxes)
    for number in range(len(boxes)):
        left, top, right, bottom = boxes[number]
        found[number, :2], found[number, 2:] = np.inf, -np.inf
        for x, y in ((left, top), (right, top), (right, bottom), (left, bottom)):
            across, down = mapped_point(matrix, x, y)
            found[number, 0], found[number, 1] = min(found[number, 0], across), min(found[number, 1], down)
            found[number, 2], found[number, 3] = max(found[number, 2], across), max(found[number, 3], down)
    return found


@kernel(FLOAT64, FLOAT64, *[UINT8_STRIDED] * 3)
def contrasts(
    boxes: FloatArray,
    to_image: FloatArray,
    image: ByteImage,
    background: ByteImage,
    thresholds: ByteImage,
) -> FloatArray:
    """Contrast of an image to the background in boxes, in multiples of the threshold.

    Args:
        boxes: float64[n, 4], x0 y0 x1 y1; `GRID` by `GRID` points of each are sampled.
        to_image: float64[3, 3], from the boxes' pixels to those of the images.
        image: uint8[h, w].
        background: uint8[h, w].
        thresholds: uint8[h, w], T_F of each pixel, grey levels, 255 where the background is unknown.

    Returns:
        float64[n], the mean over the points of an object that exceed their threshold; 0 if none does.
    """
    found = np.zeros(len(boxes))
    for number in range(len(boxes)):
        left, top, right, bottom = boxes[number]
        count = 0
        for point in range(GRID * GRID):
            x = left + (right - left) * ((point % GRID + 0.5) / GRID)
            y = top + (bottom - top) * ((point // GRID + 0.5) / GRID)
            x, y = mapped_into(to_image, x, y, image.shape)
            row, column = int(np.rint(y)), int(np.rint(x))
            difference = abs(np.int64(image[row, column]) - np.int64(background[row, column]))
            excess = difference / max(int(np.int64(thresholds[row, column])), 1)
            if excess > 1.0:
                found[number] += excess
                count += 1
        found[number] /= max(count, 1)
    return found


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
