"""Finds a target drawn by hand with its correlation filter, and what particles are to expect there."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from streamkit_tracker.appearance.correlation_filter import CorrelationFilter, Response
from streamkit_tracker.appearance.window_sampling import WindowSampler
from streamkit_tracker.update.evidence import LEAST_SHARPNESS, Evidence
from streamkit_tracker.update.expectations import Prior
from streamkit_tracker.window_geometry import LENGTH, WIDTH, FloatArray

PEAK_STD = 0.08  # of a filter's peak, relative to the target's side
PEAK_SIDES_STD = 0.02
TURN_STD = 0.1  # rad about the drawn angle, for a target too soft to show its turn
SOFT = 5.0
SIZE_STEP = 1.05
OTHER_SIZE_SHARE = 0.995
SIZE_CHANGE, TURN_CHANGE = 1.12, 0.2
FAR = 0.4  # sides; a peak nearer to the rim of what was looked at is faint
MOVED, APART = 0.2, 0.1
FAINT, GAIN = 1.0, 0.1  # logarithms of a response: below the usual, and above the other one
RING = 6
RING_PER_FRAME = 0.2
LARGEST_RING = 3.0
NEAREST_RING = 0.4
INNER_RINGS = (1.0, 2 / 3, 1 / 3)  # in turn, so that the whole disc is searched in three frames


def find_response(
    discriminator: CorrelationFilter,
    evidence: Evidence,
    sampler: WindowSampler,
    window: FloatArray,
    predicted: FloatArray,
    frames_unseen: int,
) -> Response | None:
    """The best response around a prediction, or None where none is credible.

    Args:
        discriminator: of this target.
        evidence: of this target.
        sampler: has been shown the frame.
        window: float64[5], where the target was in the last frame.
        predicted: float64[5].
        frames_unseen: since the target was last seen; the search grows with them.
    """
    places = search_windows(predicted, frames_unseen)
    best = discriminator.respond(sampler, places, OTHER_SIZE_SHARE, apart=frames_unseen > 0)
    if frames_unseen == 0:
        grown = SIZE_STEP ** parabola_peak(*best.heights)
        best = replace(best, sides=(float(predicted[LENGTH] * grown), float(predicted[WIDTH] * grown)))
        best = _refined_response(best, discriminator, evidence, sampler, window, predicted)
    elif best.sharpness >= LEAST_SHARPNESS:
        changed = changed_windows(best)
        best = discriminator.respond(sampler, changed, OTHER_SIZE_SHARE)
    return best if evidence.is_credible(best.peak, best.sharpness, frames_unseen=frames_unseen) else None


def _refined_response(
    best: Response,
    discriminator: CorrelationFilter,
    evidence: Evidence,
    sampler: WindowSampler,
    window: FloatArray,
    predicted: FloatArray,
) -> Response:
    """Repeats a response that is far from the prediction, or weak, at its position and at the last one.

    The filter's window fades towards its rim: a large motion is seen well only from near the target.
    """
    side = math.sqrt(best.sides[0] * best.sides[1])
    shift = math.dist(best.position, predicted[:2].tolist()) / side
    drop = evidence.drop(best.peak, best.sharpness)
    if shift <= FAR and drop <= FAINT:
        return best
    centres = [best.position] if shift > APART else []
    if math.dist(window[:2].tolist(), predicted[:2].tolist()) > MOVED * side:
        centres.append((float(window[0]), float(window[1])))
    if not centres:
        return best
    places = np.array([(*centre, *best.sides, best.angle) for centre in centres])
    other = discriminator.respond(sampler, places, apart=True)
    better = evidence.drop(other.peak, other.sharpness) < drop - GAIN
    return other if better and other.sharpness >= LEAST_SHARPNESS else best


def parabola_peak(same: float, larger: float, smaller: float) -> float:
    """Position of the highest response between the sizes, -1 (smaller) to 1, by a parabola."""
    curve = larger - 2 * same + smaller
    if curve >= 0:
        return 0.0 if same >= max(larger, smaller) else 1.0 if larger > smaller else -1.0
    return min(max(0.5 * (smaller - larger) / curve, -1.0), 1.0)


def search_windows(window: FloatArray, frames_unseen: int) -> FloatArray:
    """Windows float64[n, 5] to find_response the filter at: other sizes, or other places after a gap."""
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
    """Windows float64[9, 5] about a response, also smaller, larger and turned, after a gap."""
    sizes = np.array([1.0, SIZE_CHANGE, 1 / SIZE_CHANGE])
    turns = response.angle + np.array([0.0, TURN_CHANGE, -TURN_CHANGE])
    size, turn = (grid.ravel() for grid in np.meshgrid(sizes, turns))
    here = np.tile(np.array(response.position), (size.size, 1))
    return np.column_stack([here, size * response.sides[0], size * response.sides[1], turn])


def response_prior(response: Response, tolerance: float, drawn_angle: float) -> Prior:
    """Expectation of the window after a response.

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
