"""Colours of the upper and the lower half of upright boxes: jacket and trousers of people."""

from __future__ import annotations

import numpy as np

from streamkit_tracker.appearance.region_features import BINS, colour_bins
from streamkit_tracker.appearance.window_sampling import Chroma
from streamkit_tracker.window_geometry import ByteArray, Float32Array, FloatArray, IntArray

COLOURS_VERSION = -1  # of the space of these vectors; those of feature spaces are 0 and more
MIDDLE = 0.25, 0.75  # of the width: beside it is ground
UPPER, LOWER = (1 / 6, 1 / 2), (1 / 2, 11 / 12)  # of the height: without head and feet
ROWS, COLUMNS = 16, 12  # samples of each half
USUAL_LEVEL = 110.0  # mean of a frame: levels are relative to it, as an exposure may change within a frame


def box_colours(image: ByteArray, chroma: Chroma | None, boxes: FloatArray) -> Float32Array:
    """Square roots of the two histograms of each box: their product is the Bhattacharyya coefficient.

    Args:
        image: uint8[h, w], grey levels.
        chroma: planes u and v, uint8[h / 2, w / 2], or None for a frame without colour.
        boxes: float64[n, 4], x0 y0 x1 y1, px; those beyond the frame show its edge.

    Returns:
        float32[n, k], rows of length 1.

    Source: Perez, Hue, Vermaak and Gangnet, Color-Based Probabilistic Tracking, ECCV 2002 (a histogram for
    each part of a person).
    """
    count, (height, width) = len(boxes), image.shape
    boxes = np.nan_to_num(boxes)
    down = np.concatenate([_middles(*UPPER, ROWS), _middles(*LOWER, ROWS)])
    rows = _pixels(boxes[:, 1, None], boxes[:, 3, None], down, height)[:, :, None]
    columns = _pixels(boxes[:, 0, None], boxes[:, 2, None], _middles(*MIDDLE, COLUMNS), width)[:, None]
    levels = image[rows, columns] * (USUAL_LEVEL / max(float(image[::8, ::8].mean()), 1.0))
    tints = np.zeros((2, *levels.shape))
    if chroma is not None:
        tints += [plane[rows // 2, columns // 2] for plane in chroma]
        tints -= 128
    bins = colour_bins(levels, tints).reshape(2 * count, ROWS * COLUMNS)
    bins += BINS * np.arange(2 * count)[:, None]  # a histogram for each half of each box, counted at once
    counts = np.bincount(bins.ravel(), minlength=2 * count * BINS).reshape(count, 2 * BINS)
    return np.sqrt(counts / (2 * ROWS * COLUMNS)).astype(np.float32)


def _middles(start: float, stop: float, count: int) -> FloatArray:
    """Middles of equal parts between two shares of a side, float64[count]."""
    return start + (stop - start) * (np.arange(count) + 0.5) / count


def _pixels(low: FloatArray, high: FloatArray, shares: FloatArray, size: int) -> IntArray:
    """Pixels at shares float64[k] of sides from low to high, float64[n, 1]: int64[n, k], inside the frame."""
    return np.clip(np.rint(low + (high - low) * shares), 0, size - 1).astype(np.int64)
