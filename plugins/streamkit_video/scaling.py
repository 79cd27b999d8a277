"""Scaling of raw frames."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from streamkit import Choice
from streamkit_video.pixel_formats import image_height, map_planes, odd_size_error, supports_size

ByteArray = NDArray[np.uint8]
Size = tuple[int, int]


class ScaleMethod(Choice):
    """Interpolation: GStreamer's words and numbers, where OpenCV has the filter."""

    NEAREST = "nearest-neighbour", 0, "Nearest Neighbour"
    LINEAR = "bilinear", 1, "Bilinear (2-tap)"
    CUBIC = "4-tap", 2, "4-tap Sinc"
    LANCZOS = "lanczos", 3, "Lanczos"
    AREA = "bilinear2", 4, "Bilinear (multi-tap)"


INTERPOLATIONS = {
    # Plain INTER_NEAREST is half a pixel off when shrinking; the exact one agrees with the others.
    ScaleMethod.NEAREST: cv2.INTER_NEAREST_EXACT,
    ScaleMethod.LINEAR: cv2.INTER_LINEAR,
    ScaleMethod.CUBIC: cv2.INTER_CUBIC,
    ScaleMethod.LANCZOS: cv2.INTER_LANCZOS4,
    # Averages all pixels that fall into the new one, as GStreamer's multi-tap filter does.
    ScaleMethod.AREA: cv2.INTER_AREA,
}


def scale_image(data: ByteArray, pixel_format: str, size: Size, method: ScaleMethod) -> ByteArray:
    """Scales a frame.

    Args:
        data: uint8, laid out as `pixel_format`.
        pixel_format: one of `pixel_formats.FORMATS`.
        size: width, height wanted, px.
        method: interpolation.

    Returns:
        uint8, laid out as `pixel_format`; a new array.

    Raises:
        ValueError: I420 or NV12 of an odd size, before or after.
    """
    before = data.shape[1], image_height(data, pixel_format)
    for width, height in (before, size):
        if not supports_size(pixel_format, width, height):
            raise ValueError(odd_size_error(pixel_format, width, height))

    def scale(plane: ByteArray, step: int) -> ByteArray:
        part = size[0] // step, size[1] // step
        return np.asarray(cv2.resize(plane, part, interpolation=INTERPOLATIONS[method]), np.uint8)

    return map_planes(data, pixel_format, scale)
