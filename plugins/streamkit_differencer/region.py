"""Regions of interest: polygons as text, or an image."""

from __future__ import annotations

import re
from typing import cast

import cv2
import numpy as np

from streamkit_differencer.arrays import ByteImage
from streamkit_kernels.mask_image import read_mask

IMAGE_SUFFIXES = (".png", ".bmp", ".jpg", ".jpeg", ".tif", ".tiff", ".pgm")
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)"
_POLYGON = re.compile(rf"\s*{_NUMBER}\s*,\s*{_NUMBER}(?:\s+{_NUMBER}\s*,\s*{_NUMBER}){{2,}}\s*")
RELATIVE = 1.0


def region_mask(text: str, width: int, height: int) -> ByteImage:
    """The region of a frame where objects are detected.

    Args:
        text: polygons such as `0,0 640,0 640,200; 10,300 90,300 50,400`, corners in px, or as shares of the
            frame where no number exceeds 1; or the path of an image that is black outside.
        width: of the frame, px.
        height: of the frame, px.

    Returns:
        uint8[height, width], 255 inside.

    Raises:
        ValueError: neither polygons nor a readable image.
    """
    if text.lower().strip().endswith(IMAGE_SUFFIXES):
        image = read_mask(text.strip())
        return cast("ByteImage", cv2.resize(image, (width, height), interpolation=cv2.INTER_NEAREST))
    result = np.zeros((height, width), np.uint8)
    polygons = list(filter(str.strip, text.split(";")))
    for part in polygons:
        if not _POLYGON.fullmatch(part):
            raise ValueError(
                f"polygon {part.strip()!r} needs three or more corners x,y with spaces between them; "
                "write for example roi='0,0 640,0 640,200', or name an image"
            )
        corners = np.array(re.findall(_NUMBER, part), np.float64).reshape(-1, 2)
        if corners.max() <= RELATIVE:
            corners = corners * (width, height) - 0.5
        cv2.fillPoly(result, [np.round(corners).astype(np.int32)], 255)
    if not polygons:
        raise ValueError("no polygon given; write for example roi='0,0 640,0 640,200', or name an image")
    return result
