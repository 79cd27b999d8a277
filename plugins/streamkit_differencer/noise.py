"""Noise of each pixel of the background, the unit of equation 4's threshold.

A road is quiet, leaves are not, and an edge with a registration error flickers: one threshold for all pixels
is too high for the first or too low for the others.
"""

from __future__ import annotations

import numpy as np

from streamkit_differencer.arrays import Region
from streamkit_differencer.canvas_images import CanvasFrame

SAMPLE_STEP = 8
MOST_DEVIATIONS = 3.0
# Tiles along each side of the frame, and the share of them where nothing may be moving.
TILES, QUIET_SHARE = 4, 0.1
LEAST_FIRST_DEVIATION = 1.5
HIGHEST_THRESHOLD = 60.0
# Of a normal distribution: standard deviation over mean absolute deviation.
DEVIATION_RATIO = 1.2533
# Mean deviation of an unknown pixel, and the share of the local range added to that of its first frames.
UNKNOWN_DEVIATION = 5.0
EDGE_SHARE = 0.08


def first_deviation(earlier: CanvasFrame, current: CanvasFrame, region: Region) -> float:
    """Mean deviation of pixels whose background is a single frame: that of two frames where less moves.

    Args:
        earlier: a frame on the canvas, sampled at every eighth pixel of every eighth row.
        current: a later one.
        region: of the canvas.
    """
    top, bottom, left, right = region
    grid = np.s_[top + SAMPLE_STEP // 2 : bottom : SAMPLE_STEP, left + SAMPLE_STEP // 2 : right : SAMPLE_STEP]
    difference = np.abs(earlier.image[grid].astype(np.float32) - current.image[grid])
    difference[(earlier.seen[grid] & current.seen[grid]) == 0] = -1.0
    means = []
    for rows in np.array_split(difference, TILES):
        for tile in np.array_split(rows, TILES, axis=1):
            values = tile[tile >= 0.0]
            if values.size:
                means.append(values[values <= MOST_DEVIATIONS * np.median(values) + 1.0].mean())
    return max(float(np.quantile(means, QUIET_SHARE)) if means else 0.0, LEAST_FIRST_DEVIATION)
