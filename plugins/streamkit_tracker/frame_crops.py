"""The parts of a frame that windows lie in, as float32 pictures small enough to stay in the cache."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from streamkit_tracker.window_geometry import FloatArray

Float32Array = NDArray[np.float32]
ByteArray = NDArray[np.uint8]
IntArray = NDArray[np.int64]

WHOLE_FRAME_SHARE = 4
TALLEST = 32000  # cv2.remap refuses pictures with more than 32767 rows
MIDDLE_GREY = np.float32(128.0)  # keeps sums of squares small, so that float32 is enough for the variance


@dataclass(frozen=True, eq=False)
class Crops:
    """Where in one picture the parts of a frame lie, one for each of g groups of windows.

    Attributes:
        picture: float32[h, w], grey levels minus 128, shrunk.
        corners: int64[g, 2], left and top pixel of each part in the frame.
        rows: int64[g], row of the picture in which a part begins.
        sizes: int64[g, 2], width and height of each part in the picture.
        cut: bool[g], whether windows of the group reach beyond their part, over the edge of the frame.
        factor: by how much the frame was averaged down.
    """

    picture: Float32Array
    corners: IntArray
    rows: IntArray
    sizes: IntArray
    cut: NDArray[np.bool_]
    factor: int

    @property
    def whole(self) -> bool:
        """Whether every window lies inside the frame with all of itself."""
        return not self.cut.any()


class FrameCrops:
    """Cuts the parts out of one frame after another.

    One part is a picture by itself; several lie under each other in one; where they would make up a good
    share of the frame, the whole of it is converted, once.
    """

    def __init__(self) -> None:
        self.image: ByteArray = np.zeros((1, 1), np.uint8)
        self._levels: dict[int, Float32Array] = {}

    def look_at(self, image: ByteArray) -> None:
        """Takes the next frame, uint8[h, w]."""
        self.image = image
        self._levels.clear()

    def around(self, windows: FloatArray, groups: int, factor: int, margin: float = 0.0) -> Crops:
        """The parts around `groups` runs of equal length of the windows float64[n, 5].

        Args:
            windows: finite.
            groups: divides n.
            factor: by how much the frame is averaged down.
            margin: room for windows that come later, relative to the diagonal of the largest.
        """
        height, width = self.image.shape
        grouped = windows.reshape(groups, -1, windows.shape[1])
        lows, highs = grouped[:, :, :2].min(axis=1).tolist(), grouped.max(axis=1).tolist()
        places, cut, rows, tall, area = [], [], [], 0, 0
        for (x0, y0), (x1, y1, length, across, _) in zip(lows, highs, strict=True):
            reach = (0.5 + margin) * math.hypot(length, across)
            left, right = _span(x0 - reach, x1 + reach, width, factor)
            top, bottom = _span(y0 - reach, y1 + reach, height, factor)
            size = max((right - left) // factor, 1), max((bottom - top) // factor, 1)
            places.append((left, top, right, bottom, tall, *size))
            cut.append(min(x0, y0) - reach < 0 or x1 + reach > width - 1 or y1 + reach > height - 1)
            rows.append(tall)
            tall += size[1]
            area += (right - left) * (bottom - top)
        outside = np.array(cut)
        if area * WHOLE_FRAME_SHARE > height * width or (groups > 1 and tall > TALLEST):
            return self._whole(outside, factor)
        parts = np.array(places)
        if groups == 1:
            left, top, right, bottom = places[0][:4]
            picture = shrunk(self.image[top:bottom, left:right], factor)
        else:
            picture = self._under_each_other(places, tall, int(parts[:, 5].max()), factor)
        return Crops(picture, parts[:, :2], parts[:, 4], parts[:, 5:], outside, factor)

    def _under_each_other(
        self, places: Sequence[tuple[int, ...]], tall: int, wide: int, factor: int
    ) -> Float32Array:
        """float32[tall, wide]: every part from its own row on."""
        picture = np.zeros((tall, wide), np.float32)
        for left, top, right, bottom, row, across, down in places:
            part, target = self.image[top:bottom, left:right], picture[row : row + down, :across]
            if factor == 1:
                np.subtract(part, MIDDLE_GREY, out=target)
            else:
                target[:] = shrunk(part, factor)
        return picture

    def _whole(self, cut: NDArray[np.bool_], factor: int) -> Crops:
        if factor not in self._levels:
            self._levels[factor] = shrunk(self.image, factor)
        picture, none = self._levels[factor], np.zeros((len(cut), 2), np.int64)
        return Crops(picture, none, none[:, 0], none + picture.shape[::-1], cut, factor)


def _span(low: float, high: float, size: int, factor: int) -> tuple[int, int]:
    """Where a crop around low and high begins and ends along one side of the frame."""
    start = int(min(max(low - 2, 0), max(size - factor, 0)))
    return start, int(min(max(high + 3 + factor, start + factor), max(size, factor)))


def shrunk(image: ByteArray, factor: int) -> Float32Array:
    """float32 image minus 128, averaged over squares of `factor` pixels; a rest at the far edges goes."""
    level = np.subtract(image, MIDDLE_GREY)
    if factor == 1:
        return level
    rows, columns = max(level.shape[0] // factor, 1), max(level.shape[1] // factor, 1)
    whole = level[: rows * factor, : columns * factor]
    return np.asarray(cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA), np.float32)
