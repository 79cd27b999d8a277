"""What a correlation filter sees of the region around a target: gradients, colours, grey level."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy

from streamkit_kernels import compiled, product
from streamkit_tracker.appearance.frame_crops import MIDDLE_GREY, Float32Array
from streamkit_tracker.appearance.gradient_histograms import CELL, gradient_channels
from streamkit_tracker.appearance.window_sampling import WindowSampler, shrink_factor
from streamkit_tracker.window_geometry import LENGTH, WIDTH, FloatArray, IntArray

GRID = 40  # cells
SAMPLES = GRID * CELL
PADDING = 4.0  # side of the region relative to the mean side of the target ...
LEAST_SIDE = 64.0  # ... and px at first: small targets move by more of their sides
GRADIENTS, COLOURS = 10, 4  # components kept of the channels
HUES = 6
COLOUR_CHANNELS = HUES + 3
COLOUR_WEIGHT = np.float32(0.5)
LEAST_CHROMA, CHROMA_RANGE = 8.0, 40.0  # grey levels: where a hue begins to count, and until it counts fully


@dataclass(frozen=True, eq=False)
class Region:
    """The region around a window in one frame.

    Attributes:
        window: float64[5], the target's window in its middle.
        side: of the region, px.
        spectra: complex64[channels, grid, grid // 2 + 1].
        colours: int64[grid, grid], bin of each cell's grey level and chroma.
    """

    window: FloatArray
    side: float
    spectra: np.ndarray[tuple[int, ...], np.dtype[np.complex64]]
    colours: IntArray


class RegionFeatures:
    """Reads regions in the turn of their windows; keeps the components in which the first one varies most.

    The colours are soft memberships in six hues and black, grey and white, a stand-in for colour names that
    needs no table.

    Source: Danelljan, Khan, Felsberg and van de Weijer, Adaptive Color Attributes for Real-Time Visual
    Tracking, CVPR 2014 (colours and gradients, reduced to their principal components).

    Args:
        sampler: has been shown the first frame.
        window: float64[5], the first window.
    """

    def __init__(self, sampler: WindowSampler, window: FloatArray) -> None:
        mean_side = math.sqrt(window[LENGTH] * window[WIDTH])
        self._padding = max(PADDING, LEAST_SIDE / mean_side)
        self.extent = np.asarray(window[LENGTH : WIDTH + 1]) / (self._padding * mean_side)
        hann = np.hanning(GRID + 2)[1:-1]
        self._hann = np.outer(hann, hann).astype(np.float32)
        gradients, colours, _ = self._channels(sampler, window, self._side(window))
        self._components = [_principal(gradients, GRADIENTS), _principal(colours, COLOURS)]

    def read(self, sampler: WindowSampler, window: FloatArray) -> Region:
        """The region around a window, float64[5], of the sampler's frame."""
        side = self._side(window)
        *channels, bins = self._channels(sampler, window, side)
        pairs = zip(self._components, channels, strict=True)
        features = np.concatenate([product(components, each) for components, each in pairs])
        features -= features.mean(axis=1, keepdims=True)
        return Region(window, side, scipy.fft.rfft2(features.reshape(-1, GRID, GRID) * self._hann), bins)

    def _side(self, window: FloatArray) -> float:
        return self._padding * math.sqrt(window[LENGTH] * window[WIDTH])

    def _channels(
        self, sampler: WindowSampler, window: FloatArray, side: float
    ) -> tuple[Float32Array, Float32Array, IntArray]:
        """Gradients float32[31, cells], colours float32[9, cells] and bins int64[grid, grid]."""
        wider = window[None].copy()
        wider[:, LENGTH : WIDTH + 1] = side
        factor = shrink_factor(wider[0], (SAMPLES, SAMPLES), sampler.shape)
        patch = sampler.sample(wider, (SAMPLES, SAMPLES), factor)
        gradients = gradient_channels(patch.reshape(1, SAMPLES, SAMPLES))[0]
        levels = patch.reshape(GRID, CELL, GRID, CELL).mean(axis=(1, 3)) + MIDDLE_GREY
        chroma = sampler.sample_chroma(wider, (GRID, GRID))
        colours, bins = np.empty((COLOUR_CHANNELS, GRID * GRID), np.float32), np.empty(GRID * GRID, np.int64)
        _classify(levels.ravel(), chroma, colours, bins)
        return gradients.reshape(len(gradients), -1), colours, bins.reshape(GRID, GRID)


def _principal(channels: Float32Array, count: int) -> Float32Array:
    """Directions float32[count, channels] in which the columns vary most."""
    centred = (channels - channels.mean(axis=1, keepdims=True)).astype(np.float64)
    _, vectors = np.linalg.eigh(centred @ centred.T)
    return np.ascontiguousarray(vectors[:, ::-1][:, :count].T, np.float32)


@compiled
def _classify(levels: Float32Array, chroma: Float32Array, colours: Float32Array, bins: IntArray) -> None:
    """Memberships in hues and greys, and the bin of a histogram with 8 levels and 16 x 16 chromas.

    Args:
        levels: float32[cells], 0 to 255.
        chroma: float32[2, cells], u and v, 0 in a frame without colour.
        colours: float32[9, cells], is filled.
        bins: int64[cells], is filled.
    """
    for cell in range(len(levels)):
        u, v, level = chroma[0, cell], chroma[1, cell], levels[cell]
        most = 0.0
        for hue in range(HUES):
            angle = hue * (2 * np.pi / HUES)
            strength = (u * np.cos(angle) + v * np.sin(angle) - LEAST_CHROMA) / CHROMA_RANGE
            share = min(max(strength, 0.0), 1.0)
            colours[hue, cell], most = COLOUR_WEIGHT * share, max(most, share)
        grey, light = COLOUR_WEIGHT * (1 - most), level / 127.5 - 1
        colours[HUES, cell] = grey * max(-light, 0.0)
        colours[HUES + 1, cell] = grey * (1 - abs(light))
        colours[HUES + 2, cell] = grey * max(light, 0.0)
        row = min(max(int(u / 8 + 8), 0), 15)
        column = min(max(int(v / 8 + 8), 0), 15)
        bins[cell] = (min(max(int(level / 32), 0), 7) * 16 + row) * 16 + column
