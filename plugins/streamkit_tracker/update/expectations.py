"""Expectations of windows before the frame is searched, and log scores with them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

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
    expected = searches[:, None]
    apart = windows[..., :2] - expected["seed"]
    resized = np.log(windows[..., LENGTH : WIDTH + 1] / expected["sides"])
    turned = half_turn(windows[..., ANGLE] - expected["heading"])
    # Term by term: numpy sums along an axis of two slowly.
    surprise = expected["seed_std"] ** -2.0 * (apart[..., 0] ** 2 + apart[..., 1] ** 2)
    surprise += expected["sides_precision"] * (resized[..., 0] ** 2 + resized[..., 1] ** 2)
    surprise += expected["heading_precision"] * turned**2
    hidden = np.maximum(VISIBLE_ENOUGH - visible_fraction(windows, image_shape), 0.0)
    likelihood = -0.5 / (variance * expected["tolerance"]) * distances
    return np.asarray(likelihood - 0.5 * surprise - HIDDEN_PENALTY * hidden)
