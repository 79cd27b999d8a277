"""Cuts square windows around detections and says which of them to distrust."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from streamkit_wavelet_eigen.feature_space import flat_windows

# Pixels; a smaller target is mostly blur and compression.
TINY_SIDE = 8


@dataclass(frozen=True, eq=False)
class Windows:
    """Windows of one frame, one per detection.

    Attributes:
        patches: float32[n, patch, patch], grey levels 0..255.
        flat: bool[n], the window shows no structure (deviation below 4 grey levels).
        clipped: float64[n], share of the window's area outside the picture, 0..1.
        tiny: bool[n], the box is smaller than 8 px on its longer side, so the window is mostly blur.
    """

    patches: NDArray[np.float32]
    flat: NDArray[np.bool_]
    clipped: NDArray[np.float64]
    tiny: NDArray[np.bool_]


def cut_windows(
    image: NDArray[np.uint8],
    centroids: NDArray[np.float64],
    boxes: NDArray[np.float64],
    patch: int,
    margin: float = 1.25,
) -> Windows:
    """Cuts a square around each box, scaled to one size.

    The square is centred on the centroid, to a fraction of a pixel, and as wide as the longer side of the box
    times the margin. What lies outside the picture is filled with its nearest pixel.

    Args:
        image: uint8[h, w].
        centroids: float64[n, 2], x and y in pixels.
        boxes: float64[n, 4], x0 y0 x1 y1 in pixels.
        patch: side of the windows, pixels.
        margin: how much wider than the box the square is.

    Returns:
        The windows; a detection whose numbers are not finite has an all-zero patch, flat and wholly clipped.
    """
    height, width = image.shape
    boxes, centroids = np.reshape(boxes, (-1, 4)), np.reshape(centroids, (-1, 2))
    extents = np.maximum(boxes[:, 2] - boxes[:, 0], boxes[:, 3] - boxes[:, 1])
    valid = np.isfinite(extents) & np.isfinite(centroids).all(axis=1)
    extents = np.where(valid, extents, 0.0)
    sides = np.clip(np.rint(extents * margin), 1, max(height, width)).astype(int)
    patches = np.zeros((len(boxes), patch, patch), np.float32)
    clipped = np.ones(len(boxes))
    for index in np.flatnonzero(valid):
        side = int(sides[index])
        # Farther out every window is the same edge pixels, and the coordinates would overflow OpenCV's int.
        x, y = np.clip(centroids[index], -side, (width + side, height + side))
        window = cv2.getRectSubPix(image, (side, side), (float(x), float(y)))
        shrink = cv2.INTER_AREA if side > patch else cv2.INTER_LINEAR
        patches[index] = cv2.resize(window, (patch, patch), interpolation=shrink)
        clipped[index] = 1.0 - _share_inside(float(x), side, width) * _share_inside(float(y), side, height)
    return Windows(patches, flat_windows(patches), clipped, extents < TINY_SIDE)


def _share_inside(centre: float, side: int, length: int) -> float:
    """Share of [centre - side / 2, centre + side / 2] within the pixels 0 .. length - 1."""
    first, last = max(centre - side / 2, -0.5), min(centre + side / 2, length - 0.5)
    return max(last - first, 0.0) / side
