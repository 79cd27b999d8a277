"""Reads many rotated windows out of an image at once."""

from __future__ import annotations

from functools import cache

import numpy as np

from streamkit_kernels import compiled
from streamkit_tracker.frame_crops import (
    ACROSS,
    DOWN,
    LEFT,
    MIDDLE_GREY,
    START,
    TOP,
    ByteArray,
    Crops,
    Float32Array,
    FrameCrops,
    IntArray,
    QuadArray,
)
from streamkit_tracker.window_geometry import ANGLE, LENGTH, WIDTH, FloatArray


@cache
def unit_grid(patch: tuple[int, int]) -> Float32Array:
    """Sampling points of a patch in its own unit square.

    Args:
        patch: samples across and along the window (rows, columns).

    Returns:
        float32[2, rows * columns]: u (along the length) and v (across); row by row from -0.5 to 0.5.
    """
    rows, columns = patch
    steps_across = (np.arange(rows, dtype=np.float32) + 0.5) / rows - 0.5
    steps_along = (np.arange(columns, dtype=np.float32) + 0.5) / columns - 0.5
    across, along = np.meshgrid(steps_across, steps_along, indexing="ij")
    return np.stack([along.ravel(), across.ravel()])


class WindowSampler:
    """Resamples rotated windows of one frame to patches, with a buffer that is used again and again.

    The parts of the frame that the windows lie in are cut out first, so that the cost does not grow with the
    frame. Windows several times larger than the patch are averaged down first. Outside the image its edge
    pixels continue.
    """

    def __init__(self) -> None:
        self._crops = FrameCrops()
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
            ValueError: a window is not finite.
        """
        crops = crops or self.crop(windows, factor)
        count, pixels = len(windows), patch[0] * patch[1]
        if self._patches.size < count * pixels:
            self._patches = np.empty(count * pixels, np.float32)
        patches = self._patches[: count * pixels].reshape(count, pixels)
        _resample(
            crops.quads, crops.places, crops.factor, np.ascontiguousarray(windows), unit_grid(patch), patches
        )
        return patches


def shrink_factor(window: FloatArray, patch: tuple[int, int], image_shape: tuple[int, int]) -> int:
    """By how much the image is averaged down for a window, float64[5], so that its patch does not alias."""
    side = float(min(window[LENGTH], window[WIDTH]))
    return max(1, min(int(side // max(patch)), *image_shape))


@compiled
def _resample(
    quads: QuadArray,
    places: IntArray,
    factor: int,
    windows: FloatArray,
    grid: Float32Array,
    patches: Float32Array,
) -> None:
    """Bilinear samples; each step in a loop of its own over a window, so that only the reading is scalar."""
    each, pixels = len(windows) // len(places), grid.shape[1]
    near = np.empty(pixels, np.int32)
    right, below = np.empty(pixels, np.float32), np.empty(pixels, np.float32)
    x_map, y_map = np.empty(3, np.float32), np.empty(3, np.float32)
    for index in range(len(windows)):
        place, window = places[index // each], windows[index]
        cosine, sine = np.cos(window[ANGLE]) / factor, np.sin(window[ANGLE]) / factor
        x_map[0], x_map[1] = window[LENGTH] * cosine, -window[WIDTH] * sine
        y_map[0], y_map[1] = window[LENGTH] * sine, window[WIDTH] * cosine
        x_map[2] = (window[0] - place[LEFT] + 0.5) / factor - 0.5
        y_map[2] = (window[1] - place[TOP] + 0.5) / factor - 0.5
        across, down = np.int32(place[ACROSS]), np.int32(place[DOWN])
        _aim(grid, x_map, y_map, across, down, near, right, below)
        part = quads[place[START] : place[START] + place[ACROSS] * place[DOWN]]
        for pixel in range(pixels):
            near[pixel] = part[np.uint32(near[pixel])]
        _blend(near, right, below, patches[index])


@compiled
def _aim(
    grid: Float32Array,
    x_map: Float32Array,
    y_map: Float32Array,
    across: np.int32,
    down: np.int32,
    near: QuadArray,
    right: Float32Array,
    below: Float32Array,
) -> None:
    """Index of the pixel at or before each sample, held inside the part, and the rest of the way."""
    u, v = grid[0], grid[1]
    x_u, x_v, x_0 = x_map[0], x_map[1], x_map[2]
    y_u, y_v, y_0 = y_map[0], y_map[1], y_map[2]
    nothing = np.float32(0)
    last_x, last_y = np.float32(across - 1), np.float32(down - 1)
    for pixel in range(len(near)):
        x = min(max(x_u * u[pixel] + x_v * v[pixel] + x_0, nothing), last_x)
        y = min(max(y_u * u[pixel] + y_v * v[pixel] + y_0, nothing), last_y)
        column, row = np.int32(x), np.int32(y)
        right[pixel], below[pixel] = x - np.float32(column), y - np.float32(row)
        near[pixel] = np.int32(np.int32(row * across) + column)


@compiled
def _blend(quads: QuadArray, right: Float32Array, below: Float32Array, patch: Float32Array) -> None:
    """Grey levels minus 128 between the four pixels of each quad."""
    byte = np.int32(255)
    for pixel in range(len(quads)):
        quad = quads[pixel]
        here = np.float32(np.int32(quad & byte))
        beside = np.float32(np.int32(np.int32(quad >> np.int32(8)) & byte))
        under = np.float32(np.int32(np.int32(quad >> np.int32(16)) & byte))
        across = np.float32(np.int32(np.int32(quad >> np.int32(24)) & byte))
        upper = here + right[pixel] * (beside - here)
        lower = under + right[pixel] * (across - under)
        patch[pixel] = upper + below[pixel] * (lower - upper) - MIDDLE_GREY
