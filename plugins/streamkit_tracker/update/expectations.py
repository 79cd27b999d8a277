"""Expectations of windows before the frame is searched, and log scores with them."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from streamkit_kernels import compiled
from streamkit_tracker.window_geometry import ANGLE, LENGTH, WIDTH, FloatArray, half_turn, visible_part

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
        ("reach", np.float64),  # how much wider than usual to search, 1 or more
        ("seed", np.float64, 2),  # x y of half of the particles, where the target was detected, px
        ("seed_std", np.float64),  # of the detection, px
        ("seed_spread", np.float64),  # of the particles there, px; NaN without a seed
        ("sides", np.float64, 2),  # length and width, px
        ("heading", np.float64),  # rad
        ("heading_std", np.float64),  # rad
        ("position_precision", np.float64),  # of the seed
        ("sides_precision", np.float64),
        ("heading_precision", np.float64),
        ("tolerance", np.float64),  # factor on the variance of the residual
    ]
)


class Prior(msgspec.Struct, frozen=True):
    """Expectation of a window before the frame is searched; an infinite deviation is none.

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

    def write(self, search: SearchRows) -> None:
        """Sets the expectations in a row of `SEARCH`."""
        search["seed"], search["seed_std"], search["sides"] = self.centroid, self.centroid_std, self.sides
        search["heading"] = self.heading
        search["position_precision"] = self.centroid_std**-2
        search["sides_precision"], search["heading_precision"] = self.sides_std**-2, self.heading_std**-2


@compiled
def log_scores(
    distances: FloatArray,
    variance: float,
    windows: FloatArray,
    searches: SearchRows,
    height: int,
    width: int,
    scores: FloatArray,
) -> None:
    """Log scores up to a constant; less for windows of which the frame shows less than half.

    Args:
        distances: float64[t, n].
        variance: of the residual of a rigid target.
        windows: float64[t, n, 5].
        searches: t rows of `SEARCH`.
        height: of the frame, px.
        width: of the frame, px.
        scores: float64[t, n], is filled.
    """
    for target in range(len(windows)):
        search = searches[target]
        x, y = search["seed"]
        length, across = search["sides"]
        heading, turn = search["heading"], search["heading_precision"]
        place, sides = search["position_precision"], search["sides_precision"]
        scale = -0.5 / (variance * search["tolerance"])
        for index in range(windows.shape[1]):
            window = windows[target, index]
            surprise = place * ((window[0] - x) ** 2 + (window[1] - y) ** 2)
            if sides > 0:
                longer, wider = np.log(window[LENGTH] / length), np.log(window[WIDTH] / across)
                surprise += sides * (longer**2 + wider**2)
            if turn > 0:
                surprise += turn * half_turn(window[ANGLE] - heading) ** 2
            hidden = max(VISIBLE_ENOUGH - visible_part(window, height, width), 0.0)
            likelihood = scale * distances[target, index]
            scores[target, index] = likelihood - 0.5 * surprise - HIDDEN_PENALTY * hidden
