"""Reads many rotated windows out of an image at once."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np

from streamkit_tracker.calling_thread import product
from streamkit_tracker.frame_crops import ByteArray, Crops, Float32Array, FrameCrops
from streamkit_tracker.window_geometry import LENGTH, WIDTH, FloatArray

LARGEST_BATCH = 16384  # cv2.remap refuses maps with more than 32767 rows


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

    The sampling maps come from one matrix product, the pixels from one remap over all windows. The parts of
    the frame that the windows lie in are cropped first, so that the cost does not grow with the frame.
    Windows several times larger than the patch are averaged down first. Outside the image its edge pixels
    continue.
    """

    def __init__(self) -> None:
        self._crops = FrameCrops()
        self._maps = np.zeros(0, np.float32)
        self._patches = np.zeros(0, np.float32)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the frame, px."""
        return self._crops.image.shape[0], self._crops.image.shape[1]

    def look_at(self, image: ByteArray) -> None:
        """Takes the next frame, uint8[h, w] grey levels.

        Raises:
            ValueError: the image is not grey or has no pixels.
        """
        if image.ndim != 2 or image.size == 0:
            raise ValueError(f"look_at needs a grey image with pixels, got shape {image.shape}")
        self._crops.look_at(image)

    def crop(self, windows: FloatArray, factor: int, groups: int = 1, margin: float = 0.0) -> Crops:
        """The parts of the frame around windows float64[n, 5], for several samples; see `FrameCrops`.

        Raises:
            ValueError: a window is not finite.
        """
        if not np.isfinite(windows).all():
            raise ValueError("sample needs finite windows; a state has become NaN or infinite")
        return self._crops.around(windows, groups, factor, margin)

    def sample(
        self, windows: FloatArray, patch: tuple[int, int], factor: int = 1, crops: Crops | None = None
    ) -> Float32Array:
        """Resamples every window.

        Args:
            windows: float64[n, 5], finite.
            patch: samples across and along each window (rows, columns).
            factor: by how much the image is averaged down first, see `shrink_factor`.
            crops: that hold the windows, if they are known already; then `factor` is theirs.

        Returns:
            float32[n, rows * columns], grey levels minus 128; a view that the next call overwrites.

        Raises:
            ValueError: a window is not finite, or there are more than 16384.
        """
        if len(windows) > LARGEST_BATCH:
            raise ValueError(f"sample takes at most {LARGEST_BATCH} windows at once, got {len(windows)}")
        crops = crops or self.crop(windows, factor)
        rows = _map_rows(windows, crops)
        maps, patches = self._buffers(len(windows), patch[0] * patch[1])
        product(rows, unit_grid(patch), out=maps)
        if len(crops.rows) > 1:
            _stay_inside(maps.reshape(2, len(crops.rows), -1), crops)
        cv2.remap(
            crops.picture, maps[0], maps[1], cv2.INTER_LINEAR, dst=patches, borderMode=cv2.BORDER_REPLICATE
        )
        return patches

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


def _map_rows(windows: FloatArray, crops: Crops) -> Float32Array:
    """float32[2, n, 3]: times the unit grid they give the map's x and y in the crops' picture."""
    x, y, length, width, angle = windows.T
    cosine, sine, factor = np.cos(angle), np.sin(angle), crops.factor
    rows = np.empty((2, 3, len(windows)))
    np.multiply(length, cosine, out=rows[0, 0])
    np.multiply(width, -sine, out=rows[0, 1])
    np.multiply(length, sine, out=rows[1, 0])
    np.multiply(width, cosine, out=rows[1, 1])
    if len(crops.rows) == 1:
        left, top = crops.corners[0].tolist()
        np.subtract(x, left, out=rows[0, 2])
        np.subtract(y, top, out=rows[1, 2])
    else:
        each = len(windows) // len(crops.rows)
        np.subtract(x, np.repeat(crops.corners[:, 0], each), out=rows[0, 2])
        np.subtract(y, np.repeat(crops.corners[:, 1] - factor * crops.rows, each), out=rows[1, 2])
    if factor > 1:
        rows /= factor
        rows[:, 2] += 0.5 / factor - 0.5
    return rows.transpose(0, 2, 1).astype(np.float32)


def _stay_inside(maps: Float32Array, crops: Crops) -> None:
    """Repeats the frame's edge where a crop ends at it, since in the picture another one follows."""
    for group in np.flatnonzero(crops.cut):
        for axis, start in ((0, 0), (1, int(crops.rows[group]))):
            end = start + int(crops.sizes[group, axis]) - 1
            np.clip(maps[axis, group], start, end, out=maps[axis, group])
