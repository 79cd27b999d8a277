"""Reads many rotated windows out of an image at once."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from streamkit_tracker.calling_thread import product
from streamkit_tracker.window_geometry import ANGLE, LENGTH, WIDTH, FloatArray, extent

Float32Array = NDArray[np.float32]
ByteArray = NDArray[np.uint8]

LARGEST_BATCH = 16384  # cv2.remap refuses maps with more than 32767 rows
WHOLE_FRAME_SHARE = 4
MIDDLE_GREY = 128.0  # keeps sums of squares small, so that float32 is enough for the variance


@cache
def unit_grid(patch: tuple[int, int]) -> Float32Array:
    """Sampling points of a patch in its own unit square.

    Args:
        patch: samples across and along the window (rows, columns).

    Returns:
        float32[3, rows * columns]: u (along the length), v (across) and 1; row by row from -0.5 to 0.5.
    """
    rows, columns = patch
    steps_across = (np.arange(rows, dtype=np.float32) + 0.5) / rows - 0.5
    steps_along = (np.arange(columns, dtype=np.float32) + 0.5) / columns - 0.5
    across, along = np.meshgrid(steps_across, steps_along, indexing="ij")
    grid = np.stack([along.ravel(), across.ravel(), np.ones(rows * columns, np.float32)])
    grid.setflags(write=False)
    return grid


class WindowSampler:
    """Resamples rotated windows of one frame to patches, with buffers that are used again and again.

    The sampling maps come from one matrix product, the pixels from one remap over all windows. Windows that
    lie together are cropped first, so that the cost does not grow with the frame; for windows all over the
    frame it is converted to float32 once. Windows several times larger than the patch are averaged down
    first. Outside the image its edge pixels continue.
    """

    def __init__(self) -> None:
        self._image: ByteArray = np.zeros((1, 1), np.uint8)
        self._levels: dict[int, Float32Array] = {}
        self._maps = np.zeros(0, np.float32)
        self._patches = np.zeros(0, np.float32)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the frame, px."""
        return self._image.shape[0], self._image.shape[1]

    def look_at(self, image: ByteArray) -> None:
        """Takes the next frame, uint8[h, w] grey levels.

        Raises:
            ValueError: the image is not grey or has no pixels.
        """
        if image.ndim != 2 or image.size == 0:
            raise ValueError(f"look_at needs a grey image with pixels, got shape {image.shape}")
        self._image = image
        self._levels.clear()

    def sample(self, windows: FloatArray, patch: tuple[int, int], factor: int = 1) -> Float32Array:
        """Resamples every window.

        Args:
            windows: float64[n, 5], finite.
            patch: samples across and along each window (rows, columns).
            factor: by how much the image is averaged down first, see `shrink_factor`.

        Returns:
            float32[n, rows * columns], grey levels minus 128; a view that the next call overwrites.

        Raises:
            ValueError: a window is not finite, or there are more than 16384.
        """
        if not np.isfinite(windows).all():
            raise ValueError("sample needs finite windows; a state has become NaN or infinite")
        if len(windows) > LARGEST_BATCH:
            raise ValueError(f"sample takes at most {LARGEST_BATCH} windows at once, got {len(windows)}")
        crop, left, top = self._crop(windows, factor)
        rows = _map_rows(windows, left, top, factor)
        maps, patches = self._buffers(len(windows), patch[0] * patch[1])
        product(rows, unit_grid(patch), out=maps)
        cv2.remap(crop, maps[0], maps[1], cv2.INTER_LINEAR, dst=patches, borderMode=cv2.BORDER_REPLICATE)
        return patches

    def _crop(self, windows: FloatArray, factor: int) -> tuple[Float32Array, int, int]:
        """float32 image around the windows minus 128, its left and its top pixel."""
        height, width = self._image.shape
        x0, y0, x1, y1 = extent(windows)
        left, top = int(min(max(x0 - 2, 0), width - 1)), int(min(max(y0 - 2, 0), height - 1))
        right = int(min(max(x1 + 3 + factor, left + factor), width))
        bottom = int(min(max(y1 + 3 + factor, top + factor), height))
        if (right - left) * (bottom - top) * WHOLE_FRAME_SHARE > height * width:
            if factor not in self._levels:
                self._levels[factor] = _shrunk(self._image, factor)
            return self._levels[factor], 0, 0
        left, top = min(left, max(width - factor, 0)), min(top, max(height - factor, 0))
        return _shrunk(self._image[top:bottom, left:right], factor), left, top

    def _buffers(self, count: int, pixels: int) -> tuple[Float32Array, Float32Array]:
        """float32[2, count, pixels] for the maps and float32[count, pixels] for the patches."""
        needed = count * pixels
        if self._patches.size < needed:
            self._maps = np.empty(2 * needed, np.float32)
            self._patches = np.empty(needed, np.float32)
        maps = self._maps[: 2 * needed].reshape(2, count, pixels)
        return maps, self._patches[:needed].reshape(count, pixels)


def shrink_factor(window: FloatArray, patch: tuple[int, int], image_shape: tuple[int, int]) -> int:
    """By how much the image is averaged down for a window, float64[5], so that its patch does not alias."""
    side = float(min(window[LENGTH], window[WIDTH]))
    return max(1, min(int(side // max(patch)), *image_shape))


def _shrunk(image: ByteArray, factor: int) -> Float32Array:
    """float32 image minus 128, averaged over squares of `factor` pixels; a rest at the far edges goes."""
    level = image.astype(np.float32)
    level -= MIDDLE_GREY
    if factor == 1:
        return level
    rows, columns = max(level.shape[0] // factor, 1), max(level.shape[1] // factor, 1)
    whole = level[: rows * factor, : columns * factor]
    return np.asarray(cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA), np.float32)


def _map_rows(windows: FloatArray, left: int, top: int, factor: int) -> Float32Array:
    """float32[2, n, 3]: times the unit grid they give the map's x and y in the crop."""
    cosine, sine = np.cos(windows[:, ANGLE]), np.sin(windows[:, ANGLE])
    rows = np.empty((2, len(windows), 3), np.float32)
    rows[0, :, 0] = windows[:, LENGTH] * cosine
    rows[0, :, 1] = -windows[:, WIDTH] * sine
    rows[1, :, 0] = windows[:, LENGTH] * sine
    rows[1, :, 1] = windows[:, WIDTH] * cosine
    rows[0, :, 2] = windows[:, 0] - left
    rows[1, :, 2] = windows[:, 1] - top
    if factor > 1:
        rows /= factor
        rows[:, :, 2] += 0.5 / factor - 0.5
    return rows
