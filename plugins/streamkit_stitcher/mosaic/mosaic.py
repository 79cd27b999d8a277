"""A mosaic that is painted incrementally, frame by frame."""

from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import (
    IDENTITY,
    FloatArray,
    corners,
    inverse,
    normalised,
    project,
    translation,
)
from streamkit_stitcher.mosaic.frame_drawing import (
    MAX_DISTANCE,
    depth_inside,
    is_paintable,
    reduced_for,
    with_channels,
)
from streamkit_stitcher.mosaic.tiles import TILE, ImageArray, Key, TileStore, tile_parts

CellArray = npt.NDArray[np.int64]

_SEAM_DEPTH: Final = 12
_MIN_SCALE: Final = 1 / 16
_FILES: Final = 16
_BLOCK: Final = 16  # px of the preview; JPEG codes as many together


class Mosaic:
    """Frames of one plane, joined where they are equally deep inside their borders.

    Each pixel shows the frame in which it is deepest, with a short cross-fade along the seams. The canvas
    grows with the flight, from memory into files, and is halved when full: a long flight loses resolution,
    not ground. Canvas pixel c shows the plane at (c + 0.5) / scale - 0.5, so that halving averages whole
    blocks.

    Args:
        max_px: most pixels in memory; 16 times as many go to files before the scale is halved.

    Attributes:
        frames: number of frames added.
        scale: canvas pixels per px of the first plane, 1 or a power of a half.
        channels: 1 for grey, 3 for colour; 0 while empty.
    """

    def __init__(self, max_px: int) -> None:
        self._memory_px = max_px
        self.frames = self.channels = 0
        self.scale = 1.0
        self._tiles = TileStore(0, max_px)
        self._low: CellArray = np.zeros(2, dtype=np.int64)
        self._high: CellArray = np.zeros(2, dtype=np.int64)
        self._from_current = IDENTITY
        self._shrunk: dict[Key, ImageArray] = {}
        self._shrunk_by = 1

    @property
    def box(self) -> tuple[int, int, int, int]:
        """Left, top, right and bottom of the canvas, px, the last two exclusive."""
        (left, top), (right, bottom) = self._low.tolist(), self._high.tolist()
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

    def image(self) -> ImageArray | None:
        """The mosaic so far: uint8[h, w] or uint8[h, w, 3] BGR, black where there is no frame, or None."""
        if not self.channels:
            return None
        left, top, right, bottom = self.box
        pixels, _ = self.read(left, top, right - left, bottom - top)
        return pixels[:, :, 0] if self.channels == 1 else pixels

    def add(self, frame: ImageArray, to_reference: FloatArray, fills_gaps: bool = False) -> bool:
        """Paints a frame, converted to the format of the first one.

        With `fills_gaps` it shows only where no other frame does, so that cars that keep pace with the camera
        are not painted again and again.

        Returns:
            False, with the mosaic unchanged, where the homography is degenerate, the scale differs from the
            reference by more than four, or the frame is out of the canvas's reach.

        Raises:
            OSError: there is no room for a temporary file.
        """
        shape = (frame.shape[0], frame.shape[1])
        to_first = np.asarray(self._from_current @ to_reference)
        if not is_paintable(to_first, shape):
            return False
        if not self.make_room(project(to_first, corners(shape)), 1 if frame.ndim == 2 else 3):
            return False
        deepest = 1 + _SEAM_DEPTH if fills_gaps else 255
        self._paint(with_channels(frame, self.channels), to_reference, deepest)
        self.frames += 1
        return True

    def _paint(self, frame: ImageArray, to_reference: FloatArray, deepest: int) -> None:
        frame, to_canvas = reduced_for(frame, normalised(self.from_plane @ to_reference))
        shape = (frame.shape[0], frame.shape[1])
        footprint = project(to_canvas, corners(shape))
        left, top = np.floor(footprint.min(axis=0)).astype(int).tolist()
        right, bottom = (np.ceil(footprint.max(axis=0)).astype(int) + 1).tolist()
        size = (right - left, bottom - top)
        pixels, depth = self.read(left, top, *size)
        to_box = normalised(translation(-np.array([left, top])) @ to_canvas)
        # What no frame shows stays 0, and nothing else is.
        shown = np.maximum(frame, np.uint8(1))
        warped = cv2.warpPerspective(shown, to_box, size, borderMode=cv2.BORDER_REPLICATE)
        flat = np.minimum(depth_inside(shape), np.uint8(deepest))
        deep = np.asarray(cv2.warpPerspective(flat, to_box, size, borderMode=cv2.BORDER_CONSTANT), np.uint8)
        share = cv2.addWeighted(deep, 0.5 / _SEAM_DEPTH, depth, -0.5 / _SEAM_DEPTH, 0.5, dtype=cv2.CV_32F)
        share[depth == 0] = 1
        share[deep == 0] = 0
        share = np.clip(share, 0, 1)
        blended = cv2.blendLinear(warped, pixels.reshape(warped.shape), share, 1 - share)
        painted = np.asarray(blended, dtype=np.uint8).reshape(pixels.shape)
        self.write(left, top, painted, np.maximum(depth, deep))

    def make_room(self, points: FloatArray, channels: int) -> bool:
        """Extends the canvas to points in px at scale 1, at a lower scale if necessary.

        Only the first call decides the channels. False, with nothing changed, where a sixteenth of the
        resolution would not be enough.
        """
        if float(np.abs(points).max()) > MAX_DISTANCE:
            return False
        scale, low, high = self.scale, self._low, self._high
        while True:
            cells = (points + 0.5) * scale - 0.5
            need_low = np.floor(cells.min(axis=0)).astype(np.int64)
            need_high = np.ceil(cells.max(axis=0)).astype(np.int64) + 1
            if self.channels:
                need_low, need_high = np.minimum(need_low, low), np.maximum(need_high, high)
            if int(np.prod(need_high - need_low)) <= _FILES * self._memory_px:
                break
            scale, low, high = scale / 2, low // 2, -(-high // 2)
            if scale < _MIN_SCALE:
                return False
        while self.scale > scale:
            self._halve()
        if not self.channels:
            self.channels = channels
            self._tiles = TileStore(channels + 1, self._memory_px)
        self._low, self._high = need_low, need_high
        return True

    def read(self, left: int, top: int, width: int, height: int) -> tuple[ImageArray, ImageArray]:
        """Copies a part: uint8[height, width, c] and its depth, uint8[height, width], 0 where not painted."""
        pixels = np.zeros((height, width, max(1, self.channels)), dtype=np.uint8)
        depth = np.zeros((height, width), dtype=np.uint8)
        for key, there, here in tile_parts(left, top, width, height):
            tile = self._tiles.get(key)
            if tile is not None:
                pixels[here], depth[here] = tile[there][:, :, :-1], tile[there][:, :, -1]
        return pixels, depth

    def write(self, left: int, top: int, pixels: ImageArray, depth: ImageArray) -> None:
        """Replaces a part by uint8[h, w, c] pixels and uint8[h, w] depths.

        Raises:
            OSError: there is no room for a temporary file.
        """
        for key, there, here in tile_parts(left, top, depth.shape[1], depth.shape[0]):
            if depth[here].any():
                part = self._tiles.make(key)[there]
                part[:, :, :-1], part[:, :, -1] = pixels[here], depth[here]
                self._shrunk.pop(key, None)

    def preview(self, width: int, height: int) -> tuple[ImageArray, FloatArray]:
        """The whole canvas in `width` x `height`, reduced only where it does not fit, with black around it.

        The grid of its pixels is fixed to the canvas, in blocks of 16: ground that no new frame shows keeps
        the pixels, and once coded the bytes, that it had in the preview before.

        Returns:
            uint8[height, width, c], and float64[3, 3] from the present plane to its pixels.
        """
        size = np.array([width, height])
        step, quarters, first, last = self._fitted(size)
        reading = min(step, TILE)
        cells = self._read_shrunk(first * step // reading, last * step // reading, reading)
        low, high = first * quarters // 4, last * quarters // 4
        shown = cv2.resize(cells, (high - low).tolist(), interpolation=cv2.INTER_AREA)
        result = np.zeros((height, width, max(1, self.channels)), dtype=np.uint8)
        x, y = (size - (high - low)) // (2 * _BLOCK) * _BLOCK
        result[y : y + len(shown), x : x + shown.shape[1]] = shown.reshape(*shown.shape[:2], -1)
        share = quarters / 4 / step
        across, down = np.array([x, y]) - low + 0.5 * share - 0.5
        fit = np.array([[share, 0, across], [0, share, down], [0, 0, 1]])
        return result, normalised(fit @ self.from_plane)

    def _fitted(self, size: CellArray) -> tuple[int, int, CellArray, CellArray]:
        """The largest scale at which the canvas fits into a size: 1, 3/4, 1/2, 3/8, 1/4, ...

        Returns:
            Canvas px and quarters of a px of the preview per cell; the first cell and the one after the last.
        """
        box, step = np.array(self.box), 1
        while True:
            for quarters in (4, 3):
                block = _BLOCK if quarters == 4 else 4 * _BLOCK
                first = box[:2] // (step * block) * block
                last = np.maximum(-(-box[2:] // (4 * step)) * 4, first + 4)
                if ((last - first) * quarters <= 4 * size).all():
                    return step, quarters, first, last
            step *= 2

    def close(self) -> None:
        """Releases the tiles."""
        self._tiles.close()

    def _read_shrunk(self, first: CellArray, last: CellArray, step: int) -> ImageArray:
        """Copies a part of the canvas reduced by `step`, in px of that; reduced tiles are kept."""
        (left, top), (width, height) = first.tolist(), (last - first).tolist()
        if step != self._shrunk_by:
            self._shrunk_by = step
            self._shrunk.clear()
        side = TILE // step
        pixels = np.zeros((height, width, max(1, self.channels)), dtype=np.uint8)
        for key, there, here in tile_parts(left, top, width, height, side):
            tile = self._tiles.get(key)
            if tile is None:
                continue
            if key not in self._shrunk:
                small = cv2.resize(tile, (side, side), interpolation=cv2.INTER_AREA)
                self._shrunk[key] = np.asarray(small, dtype=np.uint8)[:, :, :-1]
            pixels[here] = self._shrunk[key][there]
        return pixels

    def _halve(self) -> None:
        self.scale /= 2
        self._low, self._high = self._low // 2, -(-self._high // 2)
        old, self._tiles = self._tiles, TileStore(self.channels + 1, self._memory_px)
        self._shrunk.clear()
        half = TILE // 2
        for column, row in old.keys:
            tile = old.make((column, row))
            small = np.asarray(cv2.resize(tile, (half, half), interpolation=cv2.INTER_AREA), dtype=np.uint8)
            # Partly painted blocks would mix with black: they count as not painted.
            depth = tile[:, :, -1].reshape(half, 2, half, 2).min(axis=(1, 3))
            small[depth == 0] = 0
            self.write(column * half, row * half, small[:, :, :-1], depth)
        old.close()
