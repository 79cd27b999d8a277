"""Finds a target drawn by hand with its correlation filter; the particles are drawn around it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from streamkit_tracker.appearance.correlation_filter import CorrelationFilter, Response
from streamkit_tracker.appearance.window_sampling import WindowSampler
from streamkit_tracker.update.evidence import Evidence
from streamkit_tracker.update.layered_filter import SearchRows
from streamkit_tracker.window_geometry import LENGTH, WIDTH, FloatArray, visible_fraction, widened

PEAK_STD = 0.02  # of a filter's peak, relative to the target's side
PEAK_SIDES_STD = 0.004
TURN_STD = 0.35  # rad about the drawn angle, for a rigid target
FAR = 0.4  # sides; a peak nearer to the rim of the region that was read is faint
MOVED = 0.1  # sides between both positions, from which both are asked
GAIN = 0.1  # logarithms of a response, above the other one


def find_response(
    discriminator: CorrelationFilter,
    evidence: Evidence,
    sampler: WindowSampler,
    predicted: FloatArray,
    unmoved: FloatArray,
    *,
    is_unseen: bool,
) -> Response | None:
    """The best response around a prediction, or None where none is credible, or in the picture.

    Args:
        discriminator: of this target.
        evidence: of this target.
        sampler: has been shown the frame.
        predicted: float64[5].
        unmoved: float64[5], where the camera holds a target that it follows: at the position in the frame
            where it was last seen.
        is_unseen: whether the target was not seen in the last frame.
    """
    # a filter finds any usual motion in the picture; a registration may be wrong, or the camera may follow
    best = discriminator.respond(sampler, unmoved)
    # a region fades towards its rim: a large motion is seen well only from near the target
    side = math.sqrt(best.window[LENGTH] * best.window[WIDTH])
    is_far = math.dist(best.window[:2], unmoved[:2]) > FAR * side
    others = [best.window] if is_far else []
    is_doubtful = is_unseen or is_far or not evidence.is_clear(best)
    if is_doubtful and math.dist(unmoved[:2], predicted[:2]) > MOVED * side:
        others.append(predicted)
    for window in others:
        other = discriminator.respond(sampler, window)
        if evidence.drop(other) < evidence.drop(best) - GAIN:
            best = other
    # beyond the picture the region repeats its edge: a peak there says nothing, least of all that it has left
    is_shown = visible_fraction(np.array([[*best.window[:2], 1.0, 1.0, 0.0]]), sampler.shape)[0] > 0
    if not is_shown or not evidence.is_credible(best):
        return None
    return replace(best, window=widened(best.window, discriminator.sizes.growth(sampler, best.window)))


def expect_response(search: SearchRows, response: Response, tolerance: float, drawn_angle: float) -> None:
    """Fills in the expectation of the window, a row of `SEARCH`, after a response.

    A rigid target shows size and turn better in its template than in the filter; the softer it is
    (`tolerance` above 1), the more the filter's size and the drawn angle, rad, count.
    """
    firm = 1 / math.sqrt(tolerance)
    position, sides = response.window[:2], response.window[LENGTH : WIDTH + 1]
    search["seed"], search["seed_std"] = position, PEAK_STD * firm * math.sqrt(sides.prod())
    search["sides"], search["sides_precision"] = sides, (PEAK_SIDES_STD * firm) ** -2
    # what changes shape hardly shows its turn, and errors of the angle enlarge the box around a long window
    search["heading"], search["heading_precision"] = drawn_angle, (TURN_STD * firm**3) ** -2
