"""Georeferencing of a mosaic by what its frames show of the ground."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from streamkit.geometry.earth import metres_per_degree
from streamkit.geometry.homography import FloatArray, centre, inverse, normalised, project
from streamkit_stitcher.flight_plan.plan import GeodeticPoint
from streamkit_stitcher.registration.gauss_newton import gauss_newton_step
from streamkit_stitcher.registration.motion_models import MotionModel, least_squares

_MIN_VIEWS: Final = 3
_ITERATIONS: Final = 20
_MIN_SPREAD_M: Final = 1.0
# A model with more freedom must explain the positions better by this factor, and by a metre.
_BETTER: Final = 0.8
# Root mean square of distances in a plane by their median, of a normal distribution.
_RMS_OF_MEDIAN: Final = 1.2011
_STEPS: Final = 5
# Largest perspective element of a mosaic that is turned only: 100 000 px of it are off by a hundredth.
_NO_PERSPECTIVE: Final = 1e-9
_MAX_STEP_S: Final = 1.0
_MAX_LEAD_S: Final = 0.5
_Fit = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True, eq=False)
class GroundView:
    """Points of the ground in a frame.

    Attributes:
        pixels: float64[n, 2], px of the frame; the first is the one that the fit is judged by.
        places: float64[n, 2], their latitude and longitude, deg.
        std_m: standard deviation of a position, errors common to all frames included.
        time_s: of the frame; None where successive frames have nothing to do with each other.
        focal_px: focal length of a camera that looks about straight down; 0 if unknown.
        camera: float64[2], latitude and longitude of such a camera.
    """

    pixels: FloatArray
    places: FloatArray
    std_m: float = 0.0
    time_s: float | None = None
    focal_px: float = 0.0
    camera: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class Georeference:
    """A mosaic's position on the earth.

    Attributes:
        to_local: float64[3, 3], mosaic pixels to metres east and north of the origin.
        origin: of the metres.
        median_error_m: median distance between the positions and where the mosaic has them.
        error_m: expected error of a place in the mosaic, one standard deviation.
        spread_m: root mean square distance of the positions from the origin.
        lead_s: time by which the positions are ahead of the frames, as telemetry often is.
        lead_std_s: its standard deviation, large where all positions move alike.
        velocity: float64[2], the mean one of the positions, m/s.
    """

    to_local: FloatArray
    origin: GeodeticPoint
    median_error_m: float
    error_m: float
    spread_m: float
    lead_s: float = 0.0
    lead_std_s: float = 0.0
    velocity: FloatArray = field(default_factory=lambda: np.zeros(2))

    def lead_error_m(self, velocities: Sequence[FloatArray]) -> float:
        """Error of a place at velocities float64[2], m/s, as the positions are ahead by an unknown time.

        Telemetry and image differ by `lead_s`, and either may be right. What is unknown of it shows where the
        velocity is not that of the positions, as a constant one only shifts the fit.
        """
        errors = [
            math.hypot(math.hypot(*own) * self.lead_s, math.hypot(*(own - self.velocity)) * self.lead_std_s)
            for own in velocities
        ]
        return max(errors, default=0.0)

    def seen_through(self, matrix: FloatArray) -> "Georeference":
        """That of pixels to which `matrix`, float64[3, 3], maps those of this one."""
        return replace(self, to_local=normalised(self.to_local @ inverse(matrix)))

    def pixel_size_m(self, shape: tuple[int, int]) -> float:
        """Side of the middle pixel of a mosaic of (height, width) on the ground, m."""
        depth = float(self.to_local[2, :2] @ centre(shape) + self.to_local[2, 2])
        return math.sqrt(abs(float(np.linalg.det(self.to_local)) / depth**3))

    @property
    def is_affine(self) -> bool:
        """Whether a GeoTIFF can express it."""
        return float(np.abs(self.to_local[2, :2]).max()) < _NO_PERSPECTIVE


def local_metres(places: FloatArray, origin: GeodeticPoint) -> FloatArray:
    """Metres east and north of `origin`, float64[n, 2], to a few centimetres within ten kilometres.

    `places` are float64[n, 2], latitude and longitude, deg.
    """
    offsets = (places - [origin.latitude, origin.longitude]) * metres_per_degree(origin.latitude)
    return np.asarray(offsets[:, ::-1])


def georeference(to_mosaic: Sequence[FloatArray], views: Sequence[GroundView]) -> Georeference | None:
    """Fits a mosaic to the earth, robust against wrong positions.

    A similarity, or a homography where frames have several positions and these ask for it, as those of an
    oblique camera do. None for fewer than 3 frames, or positions within a metre of each other.

    Args:
        to_mosaic: float64[3, 3] of each frame.
        views: what each shows.

    Source: iteratively reweighted least squares with Cauchy weights; Umeyama's similarity, PAMI 1991.
    """
    if len(views) < _MIN_VIEWS:
        return None
    places = np.concatenate([view.places for view in views])
    origin = GeodeticPoint(*np.median(places, axis=0).tolist())
    pixels = np.concatenate(
        [project(matrix, view.pixels) for matrix, view in zip(to_mosaic, views, strict=True)]
    )
    metres = local_metres(places, origin)
    if float(np.ptp(metres, axis=0).max()) < _MIN_SPREAD_M or float(np.ptp(pixels, axis=0).max()) < 1:
        return None
    first = np.cumsum([0, *(len(view.places) for view in views[:-1])])
    speeds = _speeds(views, metres, first)
    matrix, distances, lead_s = _robust(_mirrored_similarity, pixels, metres, speeds)
    if len(places) > len(views):
        bent, others, other_s = _robust(_homography, pixels, metres, speeds)
        if np.median(others) < min(_BETTER * np.median(distances), np.median(distances) - 1):
            matrix, distances, lead_s = bent, others, other_s
    median = float(np.median(distances[first]))
    std = float(np.median([view.std_m for view in views]))
    return Georeference(
        matrix,
        origin,
        median,
        math.hypot(_RMS_OF_MEDIAN * median, std),
        math.sqrt(float((metres**2).sum(axis=1).mean())),
        lead_s,
        _lead_std_s(distances[first], speeds[first]),
        speeds[first].mean(axis=0),
    )


def _lead_std_s(distances: FloatArray, speeds: FloatArray) -> float:
    """Standard deviation of the lead of positions that are so far off, m, and move so, float64[n, 2], m/s."""
    power = float(((speeds - speeds.mean(axis=0)) ** 2).sum())
    spread = _RMS_OF_MEDIAN * float(np.median(distances))
    return min(_MAX_LEAD_S, spread / math.sqrt(power)) if power > 0 else _MAX_LEAD_S


def _speeds(views: Sequence[GroundView], metres: FloatArray, first: npt.NDArray[np.int64]) -> FloatArray:
    """Speed of each position over the ground, float64[n, 2], m/s; 0 where it is unknown."""
    speeds = np.zeros_like(metres)
    for before, after, start, end in zip(views, views[1:], first, first[1:], strict=False):
        count = len(after.places)
        if before.time_s is None or after.time_s is None or count != len(before.places):
            continue
        if 0 < (step := after.time_s - before.time_s) < _MAX_STEP_S:
            speeds[end : end + count] = (metres[end : end + count] - metres[start : start + count]) / step
    return speeds


def _robust(
    fit: _Fit, pixels: FloatArray, metres: FloatArray, speeds: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """The fit with less weight on what is far off.

    Returns:
        The matrix, the distance of each position, m, and the time by which positions are ahead, s.
    """
    weights, lead_s, shifted = np.ones(len(pixels)), 0.0, metres
    for _ in range(_ITERATIONS):
        matrix = fit(pixels, shifted, weights)
        residuals = shifted - project(matrix, pixels)
        distances = np.hypot(*residuals.T)
        spread = max(1e-6, 1.4826 * float(np.median(distances)))
        weights = 1 / (1 + (distances / (2 * spread)) ** 2)
        power = float((weights * (speeds**2).sum(axis=1)).sum())
        if power > 0:
            lead_s += float((weights * (residuals * speeds).sum(axis=1)).sum()) / power
            lead_s = min(max(lead_s, -_MAX_LEAD_S), _MAX_LEAD_S)
            shifted = metres - lead_s * speeds
    return matrix, distances, lead_s


def _homography(pixels: FloatArray, metres: FloatArray, weights: FloatArray) -> FloatArray:
    """The weighted least-squares homography, float64[3, 3]; the affine motion where it is degenerate."""
    matrix = least_squares(MotionModel.AFFINE, pixels, metres)
    if matrix is None:
        return _mirrored_similarity(pixels, metres, weights)
    for _ in range(_STEPS):
        step = gauss_newton_step(matrix, pixels, metres, weights)
        if step is None:
            break
        matrix = step
    return normalised(matrix)


def _mirrored_similarity(pixels: FloatArray, metres: FloatArray, weights: FloatArray) -> FloatArray:
    """The weighted least-squares similarity from y-down pixels to y-up metres, float64[3, 3]."""
    flipped, goal = pixels @ [1, -1j], metres @ [1, 1j]
    middle, goal_middle = (np.average(one, weights=weights) for one in (flipped, goal))
    inner = flipped - middle
    power = max(1e-12, float((weights * np.abs(inner) ** 2).sum()))
    factor = (weights * inner.conj() * (goal - goal_middle)).sum() / power
    shift = goal_middle - factor * middle
    a, b = factor.real, factor.imag
    return np.array([[a, b, shift.real], [b, -a, shift.imag], [0, 0, 1]])
