"""Expectations of windows before the frame is searched, and log scores with them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from streamkit_kernels import compiled
from streamkit_tracker.window_geometry import ANGLE, LENGTH, WIDTH, FloatArray, half_turn, visible_fraction

SearchRows = NDArray[Any]

VISIBLE_ENOUGH = 0.5
HIDDEN_PENALTY = 20.0


# Expectations of one target before the frame is searched; infinite deviations and zero precisions are none.
SEARCH = np.dtype(
    [
        ("window", np.float64, 5),  # of the previous frame in the pixels of this one
        ("displacement", np.float64, 2),  # predicted motion since then, px
        ("spread", np.float64),  # standard deviation of the prediction, px
        ("wide_spread", np.float64),  # the same for a quarter of the particles, against surprises, px
        ("seed", np.float64, 2),  # x y of half of the particles, where the target was detected, px
        ("seed_std", np.float64),  # of the detection, px; infinite without one
        ("seed_spread", np.float64),  # of the particles there, px; NaN without a seed
        ("sides", np.float64, 2),  # length and width, px
        ("heading", np.float64),  # rad
        ("sides_precision", np.float64),
        ("heading_precision", np.float64),
        ("tolerance", np.float64),  # factor on the variance of the residual
    ]
)


@compiled
def log_scores(
    distances: FloatArray,
    variance: float,
    windows: FloatArray,
    searches: SearchRows,
    image_shape: tuple[int, int],
) -> FloatArray:
    """Log scores up to a constant, float64[t, n]; less for windows of which the frame shows less than half.

    Args:
        distances: float64[t, n].
        variance: of the residual of a rigid target.
        windows: float64[t, n, 5].
        searches: t rows of `SEARCH`.
        image_shape: height and width of the frame, px.
    """
    scores = np.empty(distances.shape)
    for target in range(len(windows)):
        search, fractions = searches[target], visible_fraction(windows[target], image_shape)
        place, sides = search["seed_std"] ** -2.0, search["sides_precision"]
        scale = -0.5 / (variance * search["tolerance"])
        for index in range(windows.shape[1]):
            window = windows[target, index]
            right, down = window[0] - search["seed"][0], window[1] - search["seed"][1]
            longer = np.log(window[LENGTH] / search["sides"][0])
            wider = np.log(window[WIDTH] / search["sides"][1])
            turned = half_turn(window[ANGLE] - search["heading"])
            surprise = place * (right**2 + down**2) + sides * (longer**2 + wider**2)
            surprise += search["heading_precision"] * turned**2
            hidden = max(VISIBLE_ENOUGH - fractions[index], 0.0)
            likelihood = scale * distances[target, index]
            scores[target, index] = likelihood - 0.5 * surprise - HIDDEN_PENALTY * hidden
    return scores
