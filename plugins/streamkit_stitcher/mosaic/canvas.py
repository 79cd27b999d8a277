"""A bounded canvas on a plane that grows to what is painted, and halves rather than outgrow its limit."""

from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from streamkit_stitcher.homographies import FloatArray

PictureArray = npt.NDArray[np.uint8]
CellArray = npt.NDArray[np.int64]

_GROWTH: Final = 0.25
_SMALLEST_SCALE: Final = 1 / 16


class Canvas:
    """Pixels and their depth over the part of a plane painted so far.

    Canvas pixel c shows the plane at (c + 0.5) / scale - 0.5, so that halving averages whole blocks. The
    arrays cover a box of such pixels from `origin` on, with room to grow.

    Args:
        max_px: most pixels of the painted box.

    Attributes:
        scale: canvas pixels per px of the plane, 1 or a power of a half.
        origin: int64[2], canvas x y of the arrays' first pixel.
        pixels: uint8[h, w] or uint8[h, w, 3].
        depth: uint8[h, w], 0 where nothing was painted.
    """

    def __init__(self, max_px: int) -> None:
        self._limit = max_px
        self.scale = 1.0
        self.origin: CellArray = np.zeros(2, dtype=np.int64)
        self.pixels: PictureArray = np.zeros((0, 0), dtype=np.uint8)
        self.depth: PictureArray = np.zeros((0, 0), dtype=np.uint8)
        self._low: CellArray = np.zeros(2, dtype=np.int64)
        self._high: CellArray = np.zeros(2, dtype=np.int64)

    @property
    def is_empty(self) -> bool:
        """Whether nothing was painted yet."""
        return self.depth.size == 0

    @property
    def from_plane(self) -> FloatArray:
        """float64[3, 3] from the plane to indices of the arrays."""
        return self._from_plane(self.origin)

    @property
    def painted_from_plane(self) -> FloatArray:
        """float64[3, 3] from the plane to the pixels of `painted()`."""
        return self._from_plane(self._low)

    def painted(self) -> PictureArray:
        """The box that encloses all that was asked room for, a view of the arrays."""
        left, top = self._low - self.origin
        right, bottom = self._high - self.origin
        return self.pixels[top:bottom, left:right]

    def make_room(self, points: FloatArray, dimensions: int) -> bool:
        """Lets the arrays enclose points of the plane, at half the scale if need be.

        Args:
            points: float64[n, 2], x y on the plane.
            dimensions: of the pixels, 2 for grey and 3 for colour; only the first call decides.

        Returns:
            False, with nothing changed, where a sixteenth of the resolution would not be enough.
        """
        scale = self.scale
        low, high = self._low, self._high
        while True:
            cells = (points + 0.5) * scale - 0.5
            need_low = np.floor(cells.min(axis=0)).astype(np.int64)
            need_high = np.ceil(cells.max(axis=0)).astype(np.int64) + 1
            if not self.is_empty:
                need_low, need_high = np.minimum(need_low, low), np.maximum(need_high, high)
            if int(np.prod(need_high - need_low)) <= self._limit:
                break
            scale, low, high = scale / 2, low // 2, -(-high // 2)
            if scale < _SMALLEST_SCALE:
                return False
        while self.scale > scale:
            self._halve()
        self._enclose(need_low, need_high, dimensions)
        return True

    def _from_plane(self, origin: CellArray) -> FloatArray:
        offset = 0.5 * self.scale - 0.5 - origin
        return np.array([[self.scale, 0, offset[0]], [0, self.scale, offset[1]], [0, 0, 1]])

    def _enclose(self, low: CellArray, high: CellArray, dimensions: int) -> None:
        size = np.array(self.depth.shape[::-1])
        self._low, self._high = low, high
        if not self.is_empty and (low >= self.origin).all() and (high <= self.origin + size).all():
            return
        margin = np.ceil((high - low) * _GROWTH).astype(np.int64)
        if int(np.prod(high - low + 2 * margin)) > self._limit:
            margin = np.zeros(2, dtype=np.int64)
        width, height = high - low + 2 * margin
        colours = () if dimensions == 2 else (3,)
        if not self.is_empty:
            colours = self.pixels.shape[2:]
        pixels = np.zeros((height, width, *colours), dtype=np.uint8)
        depth = np.zeros((height, width), dtype=np.uint8)
        origin = low - margin
        if not self.is_empty:
            start = np.maximum(self.origin, origin)
            stop = np.minimum(self.origin + size, origin + np.array([width, height]))
            new = _box(start - origin, stop - origin)
            old = _box(start - self.origin, stop - self.origin)
            pixels[new], depth[new] = self.pixels[old], self.depth[old]
        self.pixels, self.depth, self.origin = pixels, depth, origin

    def _halve(self) -> None:
        self.scale /= 2
        if self.is_empty:
            return
        left, top = (self.origin % 2).tolist()
        height, width = self.depth.shape
        border = (top, (height + top) % 2, left, (width + left) % 2)
        pixels = cv2.copyMakeBorder(self.pixels, *border, cv2.BORDER_CONSTANT, value=0)
        depth = cv2.copyMakeBorder(self.depth, *border, cv2.BORDER_CONSTANT, value=0)
        rows, columns = depth.shape[0] // 2, depth.shape[1] // 2
        halved = cv2.resize(pixels, (columns, rows), interpolation=cv2.INTER_AREA)
        # A block that is painted in part would mix with black: it counts as not painted.
        shallow = depth.reshape(rows, 2, columns, 2).min(axis=(1, 3))
        halved[shallow == 0] = 0
        self.pixels, self.depth = np.asarray(halved, dtype=np.uint8), shallow
        self.origin = self.origin // 2
        self._low, self._high = self._low // 2, -(-self._high // 2)


def _box(low: CellArray, high: CellArray) -> tuple[slice, slice]:
    return slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0]))
