"""Success and precision of one target followed from its first box."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from streamkit_tracker.evaluation.boxes import overlaps
from streamkit_tracker.window_geometry import FloatArray

THRESHOLDS = np.linspace(0.0, 1.0, 21)
PRECISE_WITHIN = 20.0


@dataclass(frozen=True)
class OnePassScores:
    """Scores over the frames that have a truth.

    Attributes:
        success: mean over 21 thresholds of the share of frames that overlap by more, 0 to 1.
        precision: share of frames with a centre error of at most 20 px.
        centre_error: median centre error, px; infinite where most frames have no box.
        frames: number of frames scored.
    """

    success: float
    precision: float
    centre_error: float
    frames: int


def one_pass(found: FloatArray, truth: FloatArray) -> OnePassScores:
    """Scores one target.

    Args:
        found: float64[n, 4], left, top, width, height, px; NaN where the tracker gave no box.
        truth: float64[n, 4], likewise; NaN or no area where there is no truth.

    Raises:
        ValueError: the lengths differ, or no frame has a truth.

    Source: Wu, Lim and Yang, Online Object Tracking: A Benchmark, CVPR 2013.
    """
    if found.shape != truth.shape:
        raise ValueError(f"one box for each truth is needed, got {len(found)} boxes for {len(truth)}")
    scored = np.isfinite(truth).all(axis=1) & (truth[:, 2:] > 0).all(axis=1)
    if not scored.any():
        raise ValueError("no frame has a truth to score against")
    found, truth = found[scored], truth[scored]
    given = np.isfinite(found).all(axis=1)
    overlap, error = np.zeros(len(truth)), np.full(len(truth), np.inf)
    for index in np.flatnonzero(given):
        overlap[index] = overlaps(found[index : index + 1], truth[index : index + 1])[0, 0]
    apart = found[given, :2] + found[given, 2:] / 2 - truth[given, :2] - truth[given, 2:] / 2
    error[given] = np.hypot(apart[:, 0], apart[:, 1])
    success = float(np.mean(overlap[None] > THRESHOLDS[:, None]))
    return OnePassScores(
        success, float(np.mean(error <= PRECISE_WITHIN)), float(np.median(error)), len(truth)
    )
