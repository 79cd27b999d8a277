"""Images as masks."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from streamkit.geometry.homography import GreyArray


def read_mask(path: str) -> GreyArray:
    """An image as a mask, uint8[h, w], 255 where it is brighter than half.

    Raises:
        ValueError: it cannot be read.
    """
    image = cv2.imread(path, cv2.IMREAD_GRAYSCALE) if Path(path).is_file() else None
    if image is None:
        raise ValueError(
            f"mask {path}: not an image that can be read; name a PNG, white where the mask applies"
        )
    return np.asarray(cv2.threshold(image, 127, 255, cv2.THRESH_BINARY)[1], np.uint8)
