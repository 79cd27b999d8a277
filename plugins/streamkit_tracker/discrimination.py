"""Asks the filter of a hand-drawn target where it went, and says how far to trust the answer."""

from __future__ import annotations

import math

import numpy as np

from streamkit_tracker.correlation_filter import CorrelationFilter, Response
from streamkit_tracker.evidence import LEAST_SHARPNESS, Evidence
from streamkit_tracker.window_geometry import LENGTH, WIDTH, FloatArray
from streamkit_tracker.window_priors import Prior
from streamkit_tracker.window_sampling import WindowSampler

PEAK_STD = 0.08  # of a filter's peak, relative to the target's side
PEAK_SIDES_STD = 0.02
TURN_STD = 0.1  # rad about the drawn angle, for a target too soft to show its turn
SOFT = 5.0
SIZE_STEP = 1.03
OTHER_SIZE_SHARE = 0.995
SIZE_CHANGE, TURN_CHANGE = 1.12, 0.2
RING = 6
RING_PER_FRAME = 0.2
LARGEST_RING = 3.0
NEAREST_RING = 0.4
INNER_RINGS = (1.0, 2 / 3, 1 / 3)  # in turn, so that the whole disc is searched in three frames


def ask(
    discriminator: CorrelationFilter,
    evidence: Evidence,
    sampler: WindowSampler,
    predicted: FloatArray,
    frames_unseen: int,
) -> Response | None:
    """The best response around a prediction, or None where there is none to believe.

    Args:
        discriminator: of this target.
        evidence: of this target.
        sampler: has been shown the frame.
        predicted: float64[5].
        frames_unseen: since the target was last seen; the search grows with them.
    """
    best = discriminator.respond(sampler, search_places(predicted, frames_unseen), OTHER_SIZE_SHARE)
    if frames_unseen > 0 and best.sharpness >= LEAST_SHARPNESS:
        changed = changed_windows(best)
        best = discriminator.respond(sampler, changed, OTHER_SIZE_SHARE)
    return best if evidence.responds(best.peak, best.sharpness, frames_unseen=frames_unseen) else None


def search_places(window: FloatArray, frames_unseen: int) -> FloatArray:
    """Windows float64[n, 5] to ask the filter at: other sizes, or other places after a gap."""
    if frames_unseen == 0:
        places = np.repeat(window[None], 3, axis=0)
        places[1, LENGTH : WIDTH + 1] *= SIZE_STEP
        places[2, LENGTH : WIDTH + 1] /= SIZE_STEP
        return places
    side = math.sqrt(float(window[LENGTH] * window[WIDTH]))
    reach = min(NEAREST_RING + RING_PER_FRAME * frames_unseen, LARGEST_RING) * side
    reach *= INNER_RINGS[frames_unseen % len(INNER_RINGS)]
    turns = np.arange(RING) * (2 * np.pi / RING)
    places = np.repeat(window[None], RING + 1, axis=0)
    places[1:, 0] += reach * np.cos(turns)
    places[1:, 1] += reach * np.sin(turns)
    return places


def changed_windows(response: Response) -> FloatArray:
    """Windows float64[9, 5] about a response, also smaller, larger and turned: nobody saw what it did."""
    sizes = np.array([1.0, SIZE_CHANGE, 1 / SIZE_CHANGE])
    turns = response.angle + np.array([0.0, TURN_CHANGE, -TURN_CHANGE])
    size, turn = (grid.ravel() for grid in np.meshgrid(sizes, turns))
    here = np.tile(np.array(response.position), (size.size, 1))
    return np.column_stack([here, size * response.sides[0], size * response.sides[1], turn])


def response_prior(response: Response, tolerance: float, drawn_angle: float) -> Prior:
    """What the particles are to expect after a response.

    A rigid target shows size and turn better in its template than in the filter; the softer it is
    (`tolerance` above 1), the more the filter's size and the drawn angle count.

    Args:
        response: of the filter.
        tolerance: see `Evidence.tolerance`.
        drawn_angle: rad, of the window in this frame had the target not turned.
    """
    firm = 1 / math.sqrt(tolerance)
    side = math.sqrt(response.sides[0] * response.sides[1])
    turn_std = TURN_STD * math.sqrt(SOFT / (tolerance - 1)) if tolerance > 1 else math.inf
    return Prior(
        response.position,
        PEAK_STD * firm * side,
        response.sides,
        PEAK_SIDES_STD * firm,
        drawn_angle,
        turn_std,
    )
