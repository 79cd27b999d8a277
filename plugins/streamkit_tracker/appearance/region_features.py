"""What filters see of the region around a target, gradients and colours, and a histogram of the colours."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import scipy
from numpy.typing import NDArray

from streamkit_kernels import compiled, product
from streamkit_tracker.appearance.frame_crops import MIDDLE_GREY
from streamkit_tracker.appearance.gradient_histograms import CELL, gradient_channels
from streamkit_tracker.appearance.window_sampling import WindowSampler
from streamkit_tracker.window_geometry import LENGTH, WIDTH, Float32Array, FloatArray, IntArray

GRID = 40  # cells
PADDING = 4.0  # side of the region relative to the mean side of the target ...
# ... and to that of the frame, at least: small targets move by more of their sides. But they keep five cells.
FRAME_SHARE, MAX_PADDING = 1 / 15, 8.0
GRADIENTS, COLOURS = 10, 4  # components kept of the channels
HUES = 6
COLOUR_CHANNELS = HUES + 3
COLOUR_WEIGHT = np.float32(0.5)
MIN_CHROMA, CHROMA_RANGE = 8.0, 40.0  # grey levels: where a hue begins to count, and until it counts fully
BINS = 8 * 16 * 16
LEARNING_RATE = 0.04
INNER = 0.8  # of a target's sides: the corners of a window are ground
OUTER = 1.1  # of its sides: beyond is ground
SUMMED = 0.9  # of its sides
COLOUR_FLOOR = 1e-4  # share of a colour that neither has; such a colour speaks for both


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
        frame_side = math.sqrt(math.prod(sampler.shape))
        self._padding = max(PADDING, min(FRAME_SHARE * frame_side / mean_side, MAX_PADDING))
        self.extent = np.asarray(window[LENGTH : WIDTH + 1]) / (self._padding * mean_side)
        hann = np.hanning(GRID + 2)[1:-1]
        self._hann = np.outer(hann, hann).astype(np.float32)
        gradients, colours, _ = read_channels(sampler, self._around(window), (GRID, GRID))
        self._components = [
            principal_directions(gradients, GRADIENTS),
            principal_directions(colours, COLOURS),
        ]

    def read(self, sampler: WindowSampler, window: FloatArray) -> Region:
        """The region around a window, float64[5], of the sampler's frame."""
        around = self._around(window)
        *channels, bins = read_channels(sampler, around, (GRID, GRID))
        pairs = zip(self._components, channels, strict=True)
        features = np.concatenate([product(components, each) for components, each in pairs])
        features -= features.mean(axis=1, keepdims=True)
        return Region(
            window,
            float(around[LENGTH]),
            scipy.fft.rfft2(features.reshape(-1, GRID, GRID) * self._hann),
            bins,
        )

    def _around(self, window: FloatArray) -> FloatArray:
        """The region as a window, float64[5]."""
        around = window.copy()
        around[LENGTH : WIDTH + 1] = self._padding * math.sqrt(window[LENGTH] * window[WIDTH])
        return around


def read_channels(
    sampler: WindowSampler, region: FloatArray, cells: tuple[int, int], factor: int | None = None
) -> tuple[Float32Array, Float32Array, IntArray]:
    """What filters see of a region.

    Args:
        sampler: has been shown the frame.
        region: float64[5], a window.
        cells: its rows and columns.
        factor: by how much the frame is averaged down; None is what suits a square region.

    Returns:
        Gradients float32[31, cells], colours float32[9, cells] and bins int64[rows, columns].
    """
    rows, columns = cells
    patch = sampler.sample(region[None], (rows * CELL, columns * CELL), factor)
    gradients = gradient_channels(patch.reshape(1, rows * CELL, columns * CELL))[0]
    levels = patch.reshape(rows, CELL, columns, CELL).mean(axis=(1, 3)) + MIDDLE_GREY
    chroma = sampler.sample_chroma(region, cells)
    colours = np.empty((COLOUR_CHANNELS, rows * columns), np.float32)
    _classify(levels.ravel(), chroma, colours)
    return gradients.reshape(len(gradients), -1), colours, colour_bins(levels, chroma.reshape(2, *cells))


def principal_directions(channels: Float32Array, count: int) -> Float32Array:
    """Directions float32[count, channels] in which the columns vary most."""
    centred = (channels - channels.mean(axis=1, keepdims=True)).astype(np.float64)
    _, vectors = np.linalg.eigh(centred @ centred.T)
    return np.ascontiguousarray(vectors[:, ::-1][:, :count].T, np.float32)


def colour_bins(levels: NDArray[Any], chroma: NDArray[Any]) -> IntArray:
    """Bins of a histogram with 8 levels and 16 x 16 chromas, int64[...].

    Args:
        levels: [...], 0 to 255.
        chroma: [2, ...], u and v, 0 in a frame without colour.
    """
    rows, columns = np.clip((chroma.astype(np.float64) / 8 + 8).astype(np.int64), 0, 15)
    return np.asarray((np.clip((levels / 32).astype(np.int64), 0, 7) * 16 + rows) * 16 + columns)


@compiled
def _classify(levels: Float32Array, chroma: Float32Array, colours: Float32Array) -> None:
    """Memberships in hues and greys.

    Args:
        levels: float32[cells], 0 to 255.
        chroma: float32[2, cells], u and v, 0 in a frame without colour.
        colours: float32[9, cells], is filled.
    """
    for cell in range(len(levels)):
        u, v, level = chroma[0, cell], chroma[1, cell], levels[cell]
        most = 0.0
        for hue in range(HUES):
            angle = hue * (2 * np.pi / HUES)
            strength = (u * np.cos(angle) + v * np.sin(angle) - MIN_CHROMA) / CHROMA_RANGE
            share = min(max(strength, 0.0), 1.0)
            colours[hue, cell], most = COLOUR_WEIGHT * share, max(most, share)
        grey, light = COLOUR_WEIGHT * (1 - most), level / 127.5 - 1
        colours[HUES, cell] = grey * max(-light, 0.0)
        colours[HUES + 1, cell] = grey * (1 - abs(light))
        colours[HUES + 2, cell] = grey * max(light, 0.0)


class ColourHistogram:
    """Likelihood of each cell to belong to the target, by its colour.

    Source: Bertinetto, Valmadre, Golodetz, Miksik and Torr, Staple: Complementary Learners for Real-Time
    Tracking, CVPR 2016.

    Args:
        region: around the first window.
        extent: float64[2], the target's length and width relative to the region's side.
    """

    def __init__(self, region: Region, extent: FloatArray) -> None:
        from_middle = np.abs((np.arange(GRID) + 0.5) / GRID - 0.5) * 2
        along, across = from_middle[None] / extent[0], from_middle[:, None] / extent[1]
        farthest = np.maximum(along, across)
        self._target = farthest < max(INNER, farthest.min() + 1e-9)
        self._ground = farthest > OUTER
        self._summed = tuple(max(1, round(float(share) * GRID * SUMMED)) for share in extent)
        self._shares = self._count(region)

    def learn(self, region: Region, share: float) -> None:
        """Learns a region with the target in its middle, as far as `share` says, above 0 to 1."""
        change = self._count(region) - self._shares
        self._shares = self._shares + np.float32(share * LEARNING_RATE) * change

    def respond(self, region: Region) -> Float32Array:
        """Mean likelihood in a window at each cell, float32[grid, grid], 0 to 1."""
        target, ground = self._shares
        table = (target + np.float32(COLOUR_FLOOR / 2)) / (target + ground + np.float32(COLOUR_FLOOR))
        return np.asarray(
            cv2.boxFilter(table[region.colours], -1, self._summed, borderType=cv2.BORDER_REFLECT), np.float32
        )

    def _count(self, region: Region) -> Float32Array:
        """float32[2, bins]: shares of the colours in target and ground."""
        counts = [np.bincount(region.colours[part], minlength=BINS) for part in (self._target, self._ground)]
        return np.array([count / max(count.sum(), 1) for count in counts], np.float32)
