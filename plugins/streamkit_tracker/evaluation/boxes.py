"""Overlap of upright boxes."""

from __future__ import annotations

import numpy as np

from streamkit_tracker.window_geometry import FloatArray


def overlaps(first: FloatArray, second: FloatArray) -> FloatArray:
    """Intersection over union of every pair.

    Args:
        first: float64[n, 4], left, top, width, height, px.
        second: float64[m, 4], likewise.

    Returns:
        float64[n, m], 0 to 1; boxes without area overlap nothing.
    """
    low = np.maximum(first[:, None, :2], second[None, :, :2])
    high = np.minimum(first[:, None, :2] + first[:, None, 2:], second[None, :, :2] + second[None, :, 2:])
    common = np.prod(np.maximum(high - low, 0.0), axis=2)
    areas = [np.prod(np.maximum(boxes[:, 2:], 0.0), axis=1) for boxes in (first, second)]
    union = areas[0][:, None] + areas[1][None] - common
    return np.asarray(np.where(union > 0, common / np.maximum(union, 1e-12), 0.0))
