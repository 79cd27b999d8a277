"""Reads many rotated windows out of an image at once."""

from __future__ import annotations

import cv2
import numpy as np

from streamkit_kernels import compiled
from streamkit_tracker.appearance.frame_crops import (
    ACROSS,
    DOWN,
    LEFT,
    MIDDLE_GREY,
    START,
    TOP,
    Crops,
    QuadArray,
    lay_out_parts,
    pack_parts,
)
from streamkit_tracker.window_geometry import (
    ANGLE,
    LENGTH,
    WIDTH,
    ByteArray,
    Float32Array,
    FloatArray,
    IntArray,
    unit_grid,
    widened,
)

Chroma = tuple[ByteArray, ByteArray]


class WindowSampler:
    """Resamples rotated windows of one frame to patches.

    The parts of the frame that the windows lie in are cut out first, so that the cost does not grow with the
    frame. Windows several times larger than the patch are averaged down first. Outside the image its edge
    pixels continue.

    Attributes:
        shape: height and width of the frame, px.
    """

    def __init__(self) -> None:
        self.shape = (1, 1)
        self._image: ByteArray = np.zeros(self.shape, np.uint8)
        self._quads = np.zeros(0, np.int32)
        self._used = 0
        self._chroma: list[WindowSampler] = []

    def set_frame(self, image: ByteArray, chroma: Chroma | None = None) -> None:
        """Sets the frame; the parts of the last one are overwritten.

        Args:
            image: uint8[h, w], grey levels.
            chroma: planes u and v, uint8[h / 2, w / 2], or None for a frame without colour.

        Raises:
            ValueError: the image is not grey or has no pixels.
        """
        if image.ndim != 2 or image.size == 0:
            raise ValueError(f"set_frame needs a grey image with pixels, got shape {image.shape}")
        self._image, self.shape, self._used = image, (image.shape[0], image.shape[1]), 0
        if chroma is None:
            self._chroma = []
            return
        self._chroma = self._chroma or [WindowSampler(), WindowSampler()]
        for sampler, plane in zip(self._chroma, chroma, strict=True):
            sampler.set_frame(plane)

    def sample_chroma(self, window: FloatArray, patch: tuple[int, int]) -> Float32Array:
        """Resamples the chroma planes at one window, float64[5]: float32[2, rows * columns], 0 is grey."""
        if not self._chroma:
            return np.zeros((2, patch[0] * patch[1]), np.float32)
        half = widened(window, 0.5)
        half[:2] = (window[:2] - 0.5) / 2
        return np.concatenate([sampler.sample(half[None], patch) for sampler in self._chroma])

    def crop(self, windows: FloatArray, factor: int, groups: int = 1, margin: float = 0.0) -> Crops:
        """The parts of the frame around `groups` equal runs of windows, for several samples.

        Args:
            windows: float64[n, 5], n a multiple of `groups`.
            factor: by how much the frame is averaged down.
            groups: number of parts.
            margin: for windows that come later, relative to the diagonal of the largest.

        Raises:
            ValueError: a window is not finite.
        """
        if not np.isfinite(windows).all():
            raise ValueError("sample needs finite windows; a state has become NaN or infinite")
        parts = np.empty((groups, 5), np.int64)
        total = lay_out_parts(np.ascontiguousarray(windows), *self.shape, factor, margin, parts)
        # memory is used again in each frame: new memory costs more than filling it
        if self._used + total > len(self._quads):
            self._quads, self._used = np.empty(2 * max(total, len(self._quads)), np.int32), 0
        quads = self._quads[self._used : self._used + total]
        self._used += total
        if factor == 1:
            pack_parts(self._image, parts, quads)
            return Crops(quads, parts, factor)
        for part in parts:
            left, top, across, down, start = part.tolist()
            region = self._image[top : top + down * factor, left : left + across * factor]
            level = np.asarray(cv2.resize(region, (across, down), interpolation=cv2.INTER_AREA), np.uint8)
            pack_parts(level, np.array([[0, 0, across, down, 0]]), quads[start : start + across * down])
        return Crops(quads, parts, factor)

    def sample(
        self,
        windows: FloatArray,
        patch: tuple[int, int],
        factor: int | None = None,
        crops: Crops | None = None,
    ) -> Float32Array:
        """Resamples every window.

        Args:
            windows: float64[n, 5], finite.
            patch: samples across and along each window (rows, columns).
            factor: by how much the frame is averaged down; None is what suits the first window.
            crops: that hold the windows, if they are known already; then the factor is theirs.

        Returns:
            float32[n, rows * columns], grey levels minus 128.

        Raises:
            ValueError: a window is not finite.
        """
        if crops is None:
            crops = self.crop(windows, factor or shrink_factor(windows[0], patch, self.shape))
        patches = np.empty((len(windows), patch[0] * patch[1]), np.float32)
        windows = np.ascontiguousarray(windows)
        _resample(crops.quads, crops.parts, crops.factor, windows, unit_grid(patch), patches)
        return patches


def shrink_factor(window: FloatArray, patch: tuple[int, int], image_shape: tuple[int, int]) -> int:
    """By how much the image is averaged down for a window, float64[5], so that its patch does not alias."""
    side = float(min(window[LENGTH], window[WIDTH]))
    return max(1, min(int(side // max(patch)), *image_shape))


@compiled
def _resample(
    quads: QuadArray,
    parts: IntArray,
    factor: int,
    windows: FloatArray,
    grid: Float32Array,
    patches: Float32Array,
) -> None:
    """Bilinear samples; each step in a loop of its own over a window, so that only the reading is scalar."""
    each, pixels = len(windows) // len(parts), grid.shape[1]
    near, between = np.empty(pixels, np.int32), np.empty((2, pixels), np.float32)
    for index in range(len(windows)):
        sample_window(
            quads, parts[index // each], factor, windows[index], grid, near, between, patches[index]
        )


@compiled
def sample_window(
    quads: QuadArray,
    part: IntArray,
    factor: int,
    window: FloatArray,
    grid: Float32Array,
    near: QuadArray,
    between: Float32Array,
    patch: Float32Array,
) -> None:
    """Bilinear samples of one window, grey levels minus 128; each step is a loop of its own over the window.

    `near` int32[p] and `between` float32[2, p] are overwritten: the index of the pixel at or before each
    sample, held inside the part, then its quad; and the rest of the way to the right and down.
    """
    cosine, sine = np.cos(window[ANGLE]) / factor, np.sin(window[ANGLE]) / factor
    x_u, x_v = np.float32(window[LENGTH] * cosine), np.float32(-window[WIDTH] * sine)
    y_u, y_v = np.float32(window[LENGTH] * sine), np.float32(window[WIDTH] * cosine)
    x_0 = np.float32((window[0] - part[LEFT] + 0.5) / factor - 0.5)
    y_0 = np.float32((window[1] - part[TOP] + 0.5) / factor - 0.5)
    across, nothing, byte = np.int32(part[ACROSS]), np.float32(0), np.int32(255)
    last_x, last_y = np.float32(across - 1), np.float32(np.int32(part[DOWN]) - 1)
    u, v, right, below = grid[0], grid[1], between[0], between[1]
    for pixel in range(len(near)):
        x = min(max(x_u * u[pixel] + x_v * v[pixel] + x_0, nothing), last_x)
        y = min(max(y_u * u[pixel] + y_v * v[pixel] + y_0, nothing), last_y)
        column, row = np.int32(x), np.int32(y)
        right[pixel], below[pixel] = x - np.float32(column), y - np.float32(row)
        near[pixel] = np.int32(np.int32(row * across) + column)
    pixels = quads[part[START] : part[START] + part[ACROSS] * part[DOWN]]
    for pixel in range(len(near)):
        near[pixel] = pixels[np.uint32(near[pixel])]
    for pixel in range(len(near)):
        quad = near[pixel]
        here = np.float32(np.int32(quad & byte))
        right_of = np.float32(np.int32(np.int32(quad >> np.int32(8)) & byte))
        under = np.float32(np.int32(np.int32(quad >> np.int32(16)) & byte))
        across_of = np.float32(np.int32(np.int32(quad >> np.int32(24)) & byte))
        upper = here + right[pixel] * (right_of - here)
        lower = under + right[pixel] * (across_of - under)
        patch[pixel] = upper + below[pixel] * (lower - upper) - MIDDLE_GREY
