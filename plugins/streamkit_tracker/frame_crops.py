"""The parts of a frame that windows lie in, as float32 pictures small enough to stay in the cache."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from streamkit_tracker.window_geometry import LENGTH, WIDTH, FloatArray

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
        if groups == 1:
            return self._one(windows, factor, margin)
        height, width = self.image.shape
        grouped = windows.reshape(groups, -1, windows.shape[1])
        frame = np.array([width, height])
        highest = grouped.max(axis=1)
        reach = ((0.5 + margin) * np.hypot(highest[:, LENGTH], highest[:, WIDTH]))[:, None]
        low, high = grouped[:, :, :2].min(axis=1) - reach, highest[:, :2] + reach
        starts = np.clip(low - 2, 0, np.maximum(frame - factor, 0)).astype(np.int64)
        ends = np.maximum(high + 3 + factor, starts + factor)
        ends = np.minimum(ends, np.maximum(frame, factor)).astype(np.int64)
        spans = ends - starts
        sizes = np.maximum(spans // factor, 1)
        rows = np.cumsum(sizes[:, 1])
        tall = int(rows[-1])
        rows -= sizes[:, 1]
        cut = (low < 0).any(axis=1) | (high > frame - 1).any(axis=1)
        area = int(spans[:, 0] @ spans[:, 1])
        if area * WHOLE_FRAME_SHARE > height * width or tall > TALLEST:
            return self._whole(cut, factor)
        picture = self._under_each_other(starts, ends, rows, sizes, factor)
        return Crops(picture, starts, rows, sizes, cut, factor)

    def _one(self, windows: FloatArray, factor: int, margin: float) -> Crops:
        """The part around one group; plain numbers, which are quicker than arrays of one."""
        height, width = self.image.shape
        x0, y0 = windows[:, :2].min(axis=0).tolist()
        x1, y1, length, across, _ = windows.max(axis=0).tolist()
        reach = (0.5 + margin) * math.hypot(length, across)
        left, right = _span(x0 - reach, x1 + reach, width, factor)
        top, bottom = _span(y0 - reach, y1 + reach, height, factor)
        over = min(x0, y0) - reach < 0 or x1 + reach > width - 1 or y1 + reach > height - 1
        if (right - left) * (bottom - top) * WHOLE_FRAME_SHARE > height * width:
            return self._whole(np.array([over]), factor)
        picture = shrunk(self.image[top:bottom, left:right], factor)
        size = np.array([picture.shape[::-1]])
        return Crops(picture, np.array([[left, top]]), np.zeros(1, np.int64), size, np.array([over]), factor)

    def _under_each_other(
        self, starts: IntArray, ends: IntArray, rows: IntArray, sizes: IntArray, factor: int
    ) -> Float32Array:
        """float32[h, w]: every part from its own row on."""
        shape = int(sizes[:, 1].sum()), int(sizes[:, 0].max())
        # bytes are copied first and made floats all together, which is much quicker than one by one
        picture = np.zeros(shape, np.uint8 if factor == 1 else np.float32)
        places = np.hstack([starts, ends, rows[:, None], sizes]).tolist()
        for left, top, right, bottom, row, across, down in places:
            part = self.image[top:bottom, left:right]
            picture[row : row + down, :across] = part if factor == 1 else shrunk(part, factor)
        return np.subtract(picture, MIDDLE_GREY) if factor == 1 else np.asarray(picture, np.float32)

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
