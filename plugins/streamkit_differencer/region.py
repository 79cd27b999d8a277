"""Regions of interest: polygons as text, or an image."""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np

from streamkit_differencer.arrays import ByteImage, FloatArray

IMAGE_SUFFIXES = (".png", ".bmp", ".jpg", ".jpeg", ".tif", ".tiff", ".pgm")
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)"
_POLYGON = re.compile(rf"\s*{_NUMBER}\s*,\s*{_NUMBER}(?:\s+{_NUMBER}\s*,\s*{_NUMBER}){{2,}}\s*")
RELATIVE = 1.0


class RegionOfInterest:
    """Region of the frame where objects are detected."""

    def __init__(self, text: str) -> None:
        """Reads a region.

        Args:
            text: polygons such as `0,0 640,0 640,200; 10,300 90,300 50,400`, corners in px, or as shares of
                the frame where no number exceeds 1; or the path of an image that is black outside.

        Raises:
            ValueError: neither polygons nor a readable image.
        """
        self._image: ByteImage | None = None
        self._polygons: list[FloatArray] = []
        if text.lower().strip().endswith(IMAGE_SUFFIXES):
            self._image = read_mask(text.strip())
            return
        for part in filter(str.strip, text.split(";")):
            if not _POLYGON.fullmatch(part):
                raise ValueError(
                    f"polygon {part.strip()!r} needs three or more corners x,y with spaces between them; "
                    "write for example roi='0,0 640,0 640,200', or name an image"
                )
            numbers = [float(number) for number in re.findall(_NUMBER, part)]
            self._polygons.append(np.array(numbers).reshape(-1, 2))
        if not self._polygons:
            raise ValueError("no polygon given; write for example roi='0,0 640,0 640,200', or name an image")

    def mask(self, width: int, height: int) -> ByteImage:
        """The region in a frame of this size: uint8[height, width], 255 inside."""
        if self._image is not None:
            size = (width, height)
            return np.asarray(cv2.resize(self._image, size, interpolation=cv2.INTER_NEAREST), np.uint8)
        result = np.zeros((height, width), np.uint8)
        for polygon in self._polygons:
            is_relative = polygon.max() <= RELATIVE
            corners = polygon * (width, height) - 0.5 if is_relative else polygon
            cv2.fillPoly(result, [np.round(corners).astype(np.int32)], 255)
        return result


def read_mask(path: str) -> ByteImage:
    """An image as a mask, uint8[h, w], 255 where it is brighter than half.

    Raises:
        ValueError: it cannot be read.
    """
    image = cv2.imread(path, cv2.IMREAD_GRAYSCALE) if Path(path).is_file() else None
    if image is None:
        raise ValueError(f"mask {path}: not an image that can be read; name a PNG or BMP, white inside")
    return np.asarray(cv2.threshold(image, 127, 255, cv2.THRESH_BINARY)[1], np.uint8)
