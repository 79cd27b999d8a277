"""Histograms of the colours of a target and its background: a cue that survives changes of posture."""

from __future__ import annotations

import cv2
import numpy as np

from streamkit_tracker.appearance.frame_crops import Float32Array
from streamkit_tracker.appearance.region_features import GRID, Region
from streamkit_tracker.window_geometry import FloatArray

BINS = 8 * 16 * 16
LEARNING_RATE = 0.04
INNER = 0.8  # of a target's sides: the corners of a window are ground
OUTER = 1.1  # of its sides: beyond is ground
SUMMED = 0.9  # of its sides
FLOOR = 1e-4  # share of a colour that neither has; such a colour speaks for both


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
        table = (target + np.float32(FLOOR / 2)) / (target + ground + np.float32(FLOOR))
        return np.asarray(
            cv2.boxFilter(table[region.colours], -1, self._summed, borderType=cv2.BORDER_REFLECT), np.float32
        )

    def _count(self, region: Region) -> Float32Array:
        """float32[2, bins]: shares of the colours in target and ground."""
        counts = [np.bincount(region.colours[part], minlength=BINS) for part in (self._target, self._ground)]
        return np.array([count / max(count.sum(), 1) for count in counts], np.float32)
