"""What is expected of windows before the image is looked at, and their log scores with it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np

from streamkit_kernels import compiled
from streamkit_tracker.window_geometry import ANGLE, LENGTH, WIDTH, FloatArray

VISIBLE_ENOUGH = 0.5
HIDDEN_PENALTY = 20.0


class Prior(msgspec.Struct, frozen=True):
    """What is expected of the window before the image is looked at; an infinite deviation is no opinion.

    Attributes:
        centroid: centre of the detection, px.
        centroid_std: its standard deviation, px.
        sides: length and width, px.
        sides_std: relative standard deviation of both.
        heading: direction of motion, rad.
        heading_std: its standard deviation, rad.
    """

    centroid: tuple[float, float] = (0.0, 0.0)
    centroid_std: float = math.inf
    sides: tuple[float, float] = (1.0, 1.0)
    sides_std: float = math.inf
    heading: float = 0.0
    heading_std: float = math.inf


def prior_rows(priors: Sequence[Prior]) -> FloatArray:
    """Priors as rows float64[t, 8]: x, y, length, width, heading; precisions of place, sides and heading."""
    return np.array(
        [
            (*p.centroid, *p.sides, p.heading, p.centroid_std**-2, p.sides_std**-2, p.heading_std**-2)
            for p in priors
        ]
    )


@compiled
def log_scores(
    distances: FloatArray,
    scales: FloatArray,
    windows: FloatArray,
    priors: FloatArray,
    height: int,
    width: int,
    scores: FloatArray,
) -> None:
    """Log scores up to a constant; less for windows of which the frame shows less than half.

    Args:
        distances: float64[t, n].
        scales: float64[t], factor from a distance to a log likelihood.
        windows: float64[t, n, 5].
        priors: float64[t, 8], see `prior_rows`.
        height: of the frame, px.
        width: likewise.
        scores: float64[t, n], is filled.
    """
    for target in range(len(windows)):
        x, y, length, across, heading, place, sides, turn = priors[target]
        for index in range(windows.shape[1]):
            window = windows[target, index]
            surprise = place * ((window[0] - x) ** 2 + (window[1] - y) ** 2)
            if sides > 0:
                longer, wider = np.log(window[LENGTH] / length), np.log(window[WIDTH] / across)
                surprise += sides * (longer**2 + wider**2)
            if turn > 0:
                surprise += turn * ((window[ANGLE] - heading + np.pi / 2) % np.pi - np.pi / 2) ** 2
            hidden = max(VISIBLE_ENOUGH - _visible(window, height, width), 0.0)
            likelihood = scales[target] * distances[target, index]
            scores[target, index] = likelihood - 0.5 * surprise - HIDDEN_PENALTY * hidden


@compiled
def _visible(window: FloatArray, height: int, width: int) -> float:
    """Part of a window's upright box that lies inside the frame, 0 to 1."""
    cosine, sine = abs(np.cos(window[ANGLE])), abs(np.sin(window[ANGLE]))
    half_x = 0.5 * (window[LENGTH] * cosine + window[WIDTH] * sine)
    half_y = 0.5 * (window[LENGTH] * sine + window[WIDTH] * cosine)
    inside_x = min(window[0] + half_x, width - 0.5) - max(window[0] - half_x, -0.5)
    inside_y = min(window[1] + half_y, height - 0.5) - max(window[1] - half_y, -0.5)
    return float(max(inside_x, 0.0) * max(inside_y, 0.0) / max(4 * half_x * half_y, 1e-9))
