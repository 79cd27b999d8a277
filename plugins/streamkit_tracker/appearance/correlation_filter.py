"""Place and size of a target drawn by hand, by a filter that also learns the background."""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass

import numpy as np

from streamkit_tracker.appearance.background_aware_filter import BackgroundAwareFilter
from streamkit_tracker.appearance.region_features import GRID, ColourHistogram, Region, RegionFeatures
from streamkit_tracker.appearance.scale_filter import ScaleFilter, parabola_peak
from streamkit_tracker.appearance.window_sampling import WindowSampler
from streamkit_tracker.window_geometry import ANGLE, Float32Array, FloatArray

COLOUR_SHARE = np.float32(0.3)  # of the position, that colours decide
SIDELOBE = 5  # cells around the peak that do not count as ground
MIN_SHARPNESS = 5.0
NEAR = 2  # cells between the peak with colours and that of the filter


@dataclass(frozen=True, eq=False)
class Response:
    """What the filter found around a window.

    Attributes:
        window: float64[5], the window moved to the peak.
        peak: its height; about 1 for what was learnt.
        sharpness: peak to sidelobe ratio.
    """

    window: FloatArray
    peak: float
    sharpness: float

    @property
    def strength(self) -> float:
        """Logarithm of height times sharpness, which fall together when a target is covered."""
        return math.log(max(self.peak, 1e-3) * max(self.sharpness, 1e-3))


class CorrelationFilter:
    """Distinguishes a target from the background around it.

    A template that only knows the target cannot say which of two likely positions is the better one; this
    filter also learns the background. The region is read in the window's own turn and size, so that the
    filter needs neither. The position is that of the peak of a `BackgroundAwareFilter` and a
    `ColourHistogram` together, the size that of a `ScaleFilter`.

    Args:
        sampler: has been shown the first frame.
        window: float64[5], the first window.

    Attributes:
        features: reads regions for `learn` and `sharpness`.
        sizes: finds how much the target has grown.
    """

    def __init__(self, sampler: WindowSampler, window: FloatArray) -> None:
        self.features = RegionFeatures(sampler, window)
        region, extent = self.features.read(sampler, window), self.features.extent
        self._filter = BackgroundAwareFilter(region.spectra, extent)
        self._colours = ColourHistogram(region, extent)
        self.sizes = ScaleFilter(sampler, window)

    def respond(self, sampler: WindowSampler, window: FloatArray) -> Response:
        """Place of the target around a window, float64[5], that it may have moved from."""
        region = self.features.read(sampler, window)
        response = self._filter.respond(region.spectra)
        colours = self._colours.respond(region)
        both = response + COLOUR_SHARE * (colours - response)
        row, column = divmod(int(both.argmax()), GRID)
        # between the cells the filter alone decides, whose peak is a Gaussian: colours are coarse
        heights = np.log(np.maximum(response, 1e-3)).astype(np.float64)
        down = row + parabola_peak(*(float(heights[(row + step) % GRID, column]) for step in (-1, 0, 1)))
        along = column + parabola_peak(*(float(heights[row, (column + step) % GRID]) for step in (-1, 0, 1)))
        dx, dy = (along - GRID // 2) * region.side / GRID, (down - GRID // 2) * region.side / GRID
        cosine, sine = np.cos(window[ANGLE]), np.sin(window[ANGLE])
        moved = window.copy()
        moved[:2] = window[0] + dx * cosine - dy * sine, window[1] + dx * sine + dy * cosine
        return Response(moved, *_clearness(response, row, column))

    def copy(self) -> CorrelationFilter:
        """A filter that has learnt the same and learns by itself from now on."""
        other = copy.copy(self)
        other._filter, other._colours = copy.copy(self._filter), copy.copy(self._colours)
        other.sizes = copy.copy(self.sizes)
        return other

    def mixed(self, earlier: CorrelationFilter, share: float) -> CorrelationFilter:
        """A filter that responds as the mean of both; `share`, 0 to 1, is the weight of the earlier one."""
        other = self.copy()
        other._filter = self._filter.mixed(earlier._filter, share)
        return other

    def sharpness(self, region: Region) -> float:
        """Peak to sidelobe ratio in the middle of a region."""
        return _clearness(self._filter.respond(region.spectra), GRID // 2, GRID // 2)[1]

    def learn(self, sampler: WindowSampler, region: Region, share: float = 1.0) -> None:
        """Learns a region with the target in its middle; `share`, above 0 to 1, is how far it is believed."""
        self._filter.learn(region.spectra, share)
        self._colours.learn(region, share)
        self.sizes.learn(sampler, region.window, share)


def _clearness(response: Float32Array, row: int, column: int) -> tuple[float, float]:
    """Height of the peak near a cell, and its peak to sidelobe ratio, 0 where all values are alike.

    Source: Bolme, Beveridge, Draper and Lui, Visual Object Tracking using Adaptive Correlation Filters,
    CVPR 2010.
    """
    top, left = max(row - SIDELOBE, 0), max(column - SIDELOBE, 0)
    ground = np.ones(response.shape, np.bool_)
    ground[top : row + SIDELOBE + 1, left : column + SIDELOBE + 1] = False
    sidelobes = response[ground]
    near = response[max(row - NEAR, 0) : row + NEAR + 1, max(column - NEAR, 0) : column + NEAR + 1]
    peak = float(near.max())
    return peak, (peak - float(sidelobes.mean())) / max(float(sidelobes.std()), 1e-6)
