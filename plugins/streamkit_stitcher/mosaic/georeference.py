"""Georeferencing of a mosaic by the GNSS positions of its frames."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from streamkit.geometry.earth import metres_per_degree
from streamkit.geometry.homography import FloatArray, centre, project
from streamkit_stitcher.flight_plan.plan import GeodeticPoint

_FEWEST: Final = 3
_ITERATIONS: Final = 20
_LEAST_SPREAD_M: Final = 1.0


@dataclass(frozen=True, eq=False)
class Georeference:
    """A mosaic's position on the earth.

    Attributes:
        to_local: float64[3, 3], mosaic pixels to metres east and north of the origin.
        origin: of the metres.
        median_error_m: median distance between the positions and the centres of the frames' footprints.
        fixes: number of positions used.
    """

    to_local: FloatArray
    origin: GeodeticPoint
    median_error_m: float
    fixes: int


def local_metres(fixes: Sequence[GeodeticPoint], origin: GeodeticPoint) -> FloatArray:
    """float64[n, 2], metres east and north of `origin`, to a few centimetres within ten kilometres."""
    north_m, east_m = metres_per_degree(origin.latitude)
    return np.array(
        [
            [(fix.longitude - origin.longitude) * east_m, (fix.latitude - origin.latitude) * north_m]
            for fix in fixes
        ]
    )


def georeference(
    to_mosaic: Sequence[FloatArray], shapes: Sequence[tuple[int, int]], fixes: Sequence[GeodeticPoint]
) -> Georeference | None:
    """Fits a similarity from the mosaic to the earth, robust against wrong positions.

    Cameras are assumed to look straight down. None for fewer than 3 positions, or positions within a metre of
    each other.

    Source: iteratively reweighted least squares with Cauchy weights, on Umeyama's similarity, PAMI 1991.
    """
    if len(fixes) < _FEWEST:
        return None
    middles = np.array(
        [
            project(matrix, centre(shape)[np.newaxis])[0]
            for matrix, shape in zip(to_mosaic, shapes, strict=True)
        ]
    )
    origin = GeodeticPoint(
        float(np.median([fix.latitude for fix in fixes])), float(np.median([fix.longitude for fix in fixes]))
    )
    metres = local_metres(fixes, origin)
    if float(np.ptp(metres, axis=0).max()) < _LEAST_SPREAD_M or float(np.ptp(middles, axis=0).max()) < 1:
        return None
    weights = np.ones(len(fixes))
    matrix = np.eye(3)
    distances = np.zeros(len(fixes))
    for _ in range(_ITERATIONS):
        matrix = _mirrored_similarity(middles, metres, weights)
        distances = np.hypot(*(project(matrix, middles) - metres).T)
        spread = max(1e-6, 1.4826 * float(np.median(distances)))
        weights = 1 / (1 + (distances / (2 * spread)) ** 2)
    return Georeference(matrix, origin, float(np.median(distances)), len(fixes))


def _mirrored_similarity(pixels: FloatArray, metres: FloatArray, weights: FloatArray) -> FloatArray:
    """The weighted least-squares similarity from y-down pixels to y-up metres, float64[3, 3]."""
    total = weights.sum()
    flipped = pixels * [1, -1]
    middle = (weights[:, np.newaxis] * flipped).sum(axis=0) / total
    goal = (weights[:, np.newaxis] * metres).sum(axis=0) / total
    inner, outer = flipped - middle, metres - goal
    power = max(1e-12, float((weights * (inner**2).sum(axis=1)).sum()))
    along = float((weights * (inner * outer).sum(axis=1)).sum()) / power
    across = float((weights * (inner[:, 0] * outer[:, 1] - inner[:, 1] * outer[:, 0])).sum()) / power
    turn = np.array([[along, -across], [across, along]])
    matrix = np.eye(3)
    matrix[:2, :2] = turn @ np.diag([1.0, -1.0])
    matrix[:2, 2] = goal - turn @ middle
    return matrix
