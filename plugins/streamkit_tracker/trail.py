"""The last positions of a target on the ground, float64[n, 2], px of the latest frame."""

from __future__ import annotations

import numpy as np

from streamkit_tracker.window_geometry import FloatArray

MAX_POSITIONS = 16
# Straightness of what moves to and fro, and of what goes on. Of walks of 15 random steps 4 % reach the first,
# none the second.
JITTER, STRAIGHT = 0.5, 0.9


def extended(trail: FloatArray, position: FloatArray) -> FloatArray:
    """With one more position or sighting, float64[2]; the oldest goes when 16 are kept."""
    return np.vstack([trail, position])[-MAX_POSITIONS:]


def span(trail: FloatArray) -> FloatArray:
    """float64[2] from the oldest to the latest positions, each averaged over a third, px."""
    part = max(len(trail) // 3, 1)
    return np.asarray(trail[-part:].mean(axis=0) - trail[:part].mean(axis=0))


def straightness(trail: FloatArray) -> float:
    """Distance travelled over the length of the path: 1 along a line, near 0 for jitter."""
    path = float(np.hypot(*np.diff(trail, axis=0).T).sum())
    return float(np.hypot(*(trail[-1] - trail[0]))) / path if path > 0 else 0.0


def steadiness(trail: FloatArray) -> float:
    """How far the motion may be expected to go on, 0 to 1: 1 for a path that is long and straight."""
    if len(trail) < MAX_POSITIONS:
        return 0.0
    return min(max((straightness(trail) - JITTER) / (STRAIGHT - JITTER), 0.0), 1.0)
