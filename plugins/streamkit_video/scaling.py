"""Scaling of raw pictures, and the homography that goes with it."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from streamkit_video.numbered import Numbered
from streamkit_video.pixel_formats import PLANAR, odd_size, picture_height, size_allows

ByteArray = NDArray[np.uint8]
FloatArray = NDArray[np.float64]
Size = tuple[int, int]


class ScaleMethod(Numbered):
    """How pixels between pixels are found: GStreamer's words and numbers, as far as OpenCV has the filter."""

    NEAREST = "nearest-neighbour", 0, "Nearest Neighbour"
    LINEAR = "bilinear", 1, "Bilinear (2-tap)"
    CUBIC = "4-tap", 2, "4-tap Sinc"
    LANCZOS = "lanczos", 3, "Lanczos"
    AREA = "bilinear2", 4, "Bilinear (multi-tap)"


INTERPOLATIONS = {
    # Plain INTER_NEAREST takes pixels half a pixel off for shrinking; the exact one agrees with the others.
    ScaleMethod.NEAREST: cv2.INTER_NEAREST_EXACT,
    ScaleMethod.LINEAR: cv2.INTER_LINEAR,
    ScaleMethod.CUBIC: cv2.INTER_CUBIC,
    ScaleMethod.LANCZOS: cv2.INTER_LANCZOS4,
    # Averages over every pixel that falls into the new one, as GStreamer's multi-tap filter does.
    ScaleMethod.AREA: cv2.INTER_AREA,
}


def scale_picture(data: ByteArray, pixel_format: str, size: Size, method: ScaleMethod) -> ByteArray:
    """Scales a picture.

    Args:
        data: uint8, laid out as `pixel_format`; not written to.
        pixel_format: one of `pixel_formats.FORMATS`.
        size: width, height wanted, px.
        method: interpolation.

    Returns:
        uint8, laid out as `pixel_format`; a new array.

    Raises:
        ValueError: I420 or NV12 of an odd size, before or after.
    """
    width, height = size
    interpolation = INTERPOLATIONS[method]
    if pixel_format not in PLANAR:
        return np.asarray(cv2.resize(data, size, interpolation=interpolation), np.uint8)
    rows, columns = picture_height(data, pixel_format), data.shape[1]
    for odd in ((columns, rows), size):
        if not size_allows(pixel_format, *odd):
            raise ValueError(odd_size(pixel_format, *odd))
    planes = (2, rows // 2, columns // 2) if pixel_format == "I420" else (1, rows // 2, columns // 2, 2)
    scaled = np.empty((height * 3 // 2, width), np.uint8)
    scaled[:height] = cv2.resize(data[:rows], size, interpolation=interpolation)
    chroma = [
        cv2.resize(plane, (width // 2, height // 2), interpolation=interpolation)
        for plane in data[rows:].reshape(planes)
    ]
    scaled[height:] = np.stack(chroma).reshape(height // 2, width)
    return scaled


def scaling_homography(before: Size, after: Size) -> FloatArray:
    """float64[3, 3]: pixels of a picture to pixels of the scaled one, so that their borders coincide."""
    across, down = after[0] / before[0], after[1] / before[1]
    return np.array([[across, 0.0, (across - 1.0) / 2.0], [0.0, down, (down - 1.0) / 2.0], [0.0, 0.0, 1.0]])
