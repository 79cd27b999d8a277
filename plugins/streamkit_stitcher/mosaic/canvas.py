"""A tiled canvas on a plane, which follows changes of the plane and halves its resolution when full."""

from collections.abc import Callable
from itertools import pairwise
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import IDENTITY, FloatArray, inverse, normalised
from streamkit_stitcher.mosaic.tiles import REDUCTION, TILE, ImageArray, Tile, TileStore

CellArray = npt.NDArray[np.int64]

_SMALLEST_SCALE: Final = 1 / 16
_SPILL_FACTOR: Final = 16
# Largest distance of a point of the canvas from its origin, px at scale 1.
LONGEST_SIDE: Final = 500_000
_PREVIEW_WHOLE_PX: Final = 4_000_000


class MosaicCanvas:
    """Pixels and their depth over the painted part of a plane.

    Canvas pixel c shows the plane at (c + 0.5) / scale - 0.5, so that halving averages whole blocks.

    Args:
        max_px: most pixels in memory; 16 times as many go to a file before the scale is halved.

    Attributes:
        scale: canvas pixels per px of the first plane, 1 or a power of a half.
    """

    def __init__(self, max_px: int) -> None:
        self._memory_px = max_px
        self._limit = max_px * _SPILL_FACTOR
        self.scale = 1.0
        self._store: TileStore | None = None
        self._low: CellArray = np.zeros(2, dtype=np.int64)
        self._high: CellArray = np.zeros(2, dtype=np.int64)
        self._from_current = IDENTITY

    @property
    def is_empty(self) -> bool:
        """Whether nothing was painted yet."""
        return self._store is None

    @property
    def channels(self) -> int:
        """Channels of the pixels: 1 for grey, 3 for colour; 0 for an empty canvas."""
        return 0 if self._store is None else self._store.channels

    @property
    def box(self) -> tuple[int, int, int, int]:
        """Left, top, right and bottom of the canvas, px, the last two exclusive."""
        left, top = self._low.tolist()
        right, bottom = self._high.tolist()
        return left, top, right, bottom

    @property
    def from_plane(self) -> FloatArray:
        """float64[3, 3] from the present plane to canvas px."""
        offset = 0.5 * self.scale - 0.5
        scaling = np.array([[self.scale, 0, offset], [0, self.scale, offset], [0, 0, 1]])
        return normalised(scaling @ self._from_current)

    def move_plane(self, change: FloatArray) -> None:
        """Follows a change of the plane, float64[3, 3] old to new; painted pixels do not move."""
        self._from_current = normalised(self._from_current @ inverse(change))

    def make_room(self, points: FloatArray, channels: int) -> bool:
        """Extends the canvas to points in px at scale 1, at a lower scale if necessary.

        Only the first call decides the channels. False, with nothing changed, where a sixteenth of the
        resolution would not be enough.
        """
        if float(np.abs(points).max()) > LONGEST_SIDE:
            return False
        scale, low, high = self.scale, self._low, self._high
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
        if self._store is None:
            self._store = TileStore(channels, self._memory_px)
        self._low, self._high = need_low, need_high
        return True

    def from_frame(self, to_plane: FloatArray) -> FloatArray:
        """A frame's homography to a canvas at scale 1, float64[3, 3]."""
        return np.asarray(self._from_current @ to_plane, dtype=np.float64)

    def at_scale_one(self, points: FloatArray) -> FloatArray:
        """Points of the present plane, float64[n, 2], in px of a canvas at scale 1."""
        mapped = cv2.perspectiveTransform(points.reshape(1, -1, 2), self._from_current)
        return np.asarray(mapped, dtype=np.float64).reshape(-1, 2)

    def read(self, left: int, top: int, width: int, height: int) -> tuple[ImageArray, ImageArray]:
        """Copies a part: uint8[height, width, c] and its depth, uint8[height, width]."""
        pixels = np.zeros((height, width, max(1, self.channels)), dtype=np.uint8)
        depth = np.zeros((height, width), dtype=np.uint8)
        for key, there, here in _parts(left, top, width, height):
            tile = None if self._store is None else self._store.get(key)
            if tile is not None:
                pixels[here], depth[here] = tile.pixels[there], tile.depth[there]
        return pixels, depth

    def write(self, left: int, top: int, pixels: ImageArray, depth: ImageArray) -> None:
        """Replaces a part by uint8[h, w, c] pixels and uint8[h, w] depths.

        Raises:
            OSError: the temporary file is full.
        """
        if self._store is None:
            return
        for key, there, here in _parts(left, top, depth.shape[1], depth.shape[0]):
            if not depth[here].any():
                continue
            tile = self._store.get(key) or Tile(
                np.zeros((TILE, TILE, self.channels), dtype=np.uint8), np.zeros((TILE, TILE), dtype=np.uint8)
            )
            tile.pixels[there], tile.depth[there] = pixels[here], depth[here]
            self._store.put(key, tile)

    def preview(self, width: int, height: int) -> tuple[ImageArray, FloatArray]:
        """The whole canvas fitted into `width` x `height`, with black borders.

        Returns:
            uint8[height, width, c], and float64[3, 3] from the present plane to its pixels.
        """
        left, top, right, bottom = self.box
        share = min(width / max(1, right - left), height / max(1, bottom - top), 1.0)
        step = REDUCTION if share <= 1 / REDUCTION else 1
        left, top = left // step * step, top // step * step
        right, bottom = max(left + 1, right), max(top + 1, bottom)
        whole = -(-(right - left) // step) * step, -(-(bottom - top) // step) * step
        share = min(width / whole[0], height / whole[1], 1.0)
        size = max(1, round(whole[0] * share)), max(1, round(whole[1] * share))
        part = left // step, top // step, whole[0] // step, whole[1] // step
        shown = self._shrunk(*part, size, self._read_reduced if step > 1 else self._read_pixels)
        result = np.zeros((height, width, max(1, self.channels)), dtype=np.uint8)
        x, y = (width - size[0]) // 2, (height - size[1]) // 2
        result[y : y + size[1], x : x + size[0]] = shown.reshape(size[1], size[0], -1)
        across, down = size[0] / whole[0], size[1] / whole[1]
        fit = np.array(
            [[across, 0, x + (0.5 - left) * across - 0.5], [0, down, y + (0.5 - top) * down - 0.5], [0, 0, 1]]
        )
        return result, normalised(fit @ self.from_plane)

    def close(self) -> None:
        """Releases the tiles."""
        if self._store is not None:
            self._store.close()

    def _read_pixels(self, left: int, top: int, width: int, height: int) -> ImageArray:
        return self.read(left, top, width, height)[0]

    def _read_reduced(self, left: int, top: int, width: int, height: int) -> ImageArray:
        """Reads a part at a quarter of the resolution, in px of that."""
        pixels = np.zeros((height, width, max(1, self.channels)), dtype=np.uint8)
        for key, there, here in _parts(left, top, width, height, TILE // REDUCTION):
            tile = None if self._store is None else self._store.reduced(key)
            if tile is not None:
                pixels[here] = tile[there]
        return pixels

    def _shrunk(
        self,
        left: int,
        top: int,
        width: int,
        height: int,
        size: tuple[int, int],
        read: Callable[[int, int, int, int], ImageArray],
    ) -> ImageArray:
        """Reduces a part to `size`, a row of tiles at a time to save memory."""
        if width * height <= _PREVIEW_WHOLE_PX:
            return np.asarray(cv2.resize(read(left, top, width, height), size, interpolation=cv2.INTER_AREA))
        result = np.zeros((size[1], size[0], max(1, self.channels)), dtype=np.uint8)
        edges = np.linspace(0, size[1], max(2, height // TILE + 1)).astype(int)
        for first, last in pairwise(edges.tolist()):
            begin, end = round(first * height / size[1]), round(last * height / size[1])
            if last > first and end > begin:
                strip = read(left, top + begin, width, end - begin)
                small = cv2.resize(strip, (size[0], int(last - first)), interpolation=cv2.INTER_AREA)
                result[first:last] = small.reshape(last - first, size[0], -1)
        return result

    def _halve(self) -> None:
        self.scale /= 2
        self._low, self._high = self._low // 2, -(-self._high // 2)
        old = self._store
        if old is None:
            return
        self._store = TileStore(old.channels, self._memory_px)
        for column, row in old.keys:
            tile = old.get((column, row))
            if tile is None:
                continue
            half = TILE // 2
            small = cv2.resize(tile.pixels, (half, half), interpolation=cv2.INTER_AREA).reshape(
                half, half, -1
            )
            # Partly painted blocks would mix with black: they count as not painted.
            depth = tile.depth.reshape(half, 2, half, 2).min(axis=(1, 3))
            small[depth == 0] = 0
            self.write(column * half, row * half, np.asarray(small, dtype=np.uint8), depth)
        old.close()


def _parts(
    left: int, top: int, width: int, height: int, side: int = TILE
) -> list[tuple[tuple[int, int], tuple[slice, slice], tuple[slice, slice]]]:
    """The tiles of a side under a box: key, the part of the tile, and the same part of the box."""
    found = []
    for row in range(top // side, (top + height - 1) // side + 1):
        for column in range(left // side, (left + width - 1) // side + 1):
            x0, x1 = max(left, column * side), min(left + width, (column + 1) * side)
            y0, y1 = max(top, row * side), min(top + height, (row + 1) * side)
            there = slice(y0 - row * side, y1 - row * side), slice(x0 - column * side, x1 - column * side)
            here = slice(y0 - top, y1 - top), slice(x0 - left, x1 - left)
            found.append(((column, row), there, here))
    return found
