"""Downsampling of frames, and where they are drawn on the canvas."""

from __future__ import annotations

from typing import cast

import cv2
import numpy as np

from streamkit.geometry.homography import corners, inverse, project
from streamkit_differencer.arrays import ByteImage, FloatArray, above
from streamkit_differencer.ground import BLACK, UNSEEN, CanvasFrame
from streamkit_differencer.warping import draw, spans_within
from streamkit_kernels import hidden_pixels

# The outermost pixels of a warped frame mix with the border.
BORDER_PX = 2
_INWARDS = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]], np.float64)
# A frame within this distance of whole canvas pixels is not interpolated.
WHOLE_PIXEL_PX = 0.02


def downsampled(image: ByteImage, scale: int) -> ByteImage:
    """Means of blocks of `scale` by `scale` pixels; the remainder at the right and bottom is cut off."""
    while scale > 1:
        height, width = image.shape[0] // 2, image.shape[1] // 2
        whole = image[: 2 * height, : 2 * width]
        image = cast("ByteImage", cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA))
        scale //= 2
    return image


def without_hidden(image: ByteImage, hidden: ByteImage) -> ByteImage:
    """An image with the mean of the surroundings where it is hidden: graphics that never move show no edge.

    Args:
        image: uint8[h, w].
        hidden: uint8 of any size, 255 where hidden, else 0.
    """
    mask = cv2.resize(hidden, image.shape[::-1], interpolation=cv2.INTER_AREA)
    return hidden_pixels.without_hidden(image, above(cast("ByteImage", mask), 0))


def draw_on_canvas(working: ByteImage, to_canvas: FloatArray, size: tuple[int, int]) -> CanvasFrame:
    """Resamples a frame onto the part of the canvas that it covers.

    Args:
        working: uint8[h, w], the frame at working resolution.
        to_canvas: float64[3, 3], working pixels to canvas.
        size: width and height of the canvas, px.
    """
    shape, image = (working.shape[0], working.shape[1]), np.full(size[::-1], UNSEEN, np.uint8)
    outline = corners(shape)
    placed = project(to_canvas, outline)
    low, high = placed.min(axis=0) + WHOLE_PIXEL_PX, placed.max(axis=0) - WHOLE_PIXEL_PX
    left, top = np.clip(np.floor(low), 0, size).astype(int).tolist()
    right, bottom = np.clip(np.ceil(high) + 1, 0, size).astype(int).tolist()
    is_whole = np.abs(placed - [left, top] - outline).max() <= WHOLE_PIXEL_PX
    if is_whole and (bottom - top, right - left) == shape:
        np.maximum(working, BLACK, out=image[top:bottom, left:right])
        whole = np.full((bottom - top, 2), (left, right))
        return CanvasFrame(image, (top, bottom, left, right), whole, is_resampled=False)
    # A wider border than the one that interpolation mixes with.
    spans = spans_within(project(to_canvas, outline + _INWARDS * BORDER_PX), *image.shape)
    draw(working, inverse(to_canvas), spans, image)
    return CanvasFrame(image, (top, bottom, left, right), spans[top:bottom], is_resampled=True)
