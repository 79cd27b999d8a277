"""One picture to one JPEG file's bytes."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Pixels = NDArray[np.uint8]


def jpeg_bytes(pixels: Pixels, pixel_format: str, quality: int) -> bytes:
    """A picture as JPEG.

    Args:
        pixels: uint8[h, w] for GRAY8, uint8[h, w, 3] for BGR.
        pixel_format: GRAY8 or BGR.
        quality: 1 to 100.

    Raises:
        ValueError: the format is neither, or the picture is empty.
    """
    if pixel_format not in ("GRAY8", "BGR"):
        raise ValueError(f"a JPEG is made of GRAY8 or BGR, got {pixel_format}")
    if not pixels.size:
        raise ValueError("a picture without pixels cannot be encoded")
    done, data = cv2.imencode(".jpg", np.ascontiguousarray(pixels), [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not done:
        raise ValueError("the JPEG encoder refused the picture")
    return bytes(data)
