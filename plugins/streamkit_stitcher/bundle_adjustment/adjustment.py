"""Levenberg-Marquardt over homographies and plane points."""

import math
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import scipy

from streamkit.geometry.homography import FloatArray, inverse, project
from streamkit.settings import setting
from streamkit_stitcher.bundle_adjustment.lens import Lens
from streamkit_stitcher.bundle_adjustment.problem import PlaneProblem, projected, robust_cost
from streamkit_stitcher.registration.motion_models import MotionModel

_FIRST_DAMPING: Final = 1e-5
_MAX_DAMPING: Final = 1e6
_MIN_DEPTH: Final = 1e-3
_MIN_PIVOT: Final = 1e-12
# Columns turn a camera's free parameters into the elements h11 h12 h13 h21 h22 h23 h31 h32.
_BASES: Final[dict[MotionModel, FloatArray]] = {
    MotionModel.HOMOGRAPHY: np.eye(8),
    MotionModel.AFFINE: np.eye(8)[:, :6],
    MotionModel.SIMILARITY: np.array(
        [
            [1.0, 0, 0, 0, 1, 0, 0, 0],
            [0, -1, 0, 1, 0, 0, 0, 0],
            [0, 0, 1, 0, 0, 0, 0, 0],
            [0, 0, 0, 0, 0, 1, 0, 0],
        ]
    ).T,
}


@dataclass(frozen=True)
class AdjustmentSettings:
    """Settings of a bundle adjustment.

    Attributes:
        model: motion model of the cameras.
        tolerance: relative decrease of the cost below which the iteration ends.
    """

    ba_iterations: int = setting(8, min=1, max=100, doc="Most iterations of a bundle adjustment.")
    huber: float = setting(1.5, min=0.1, unit="px", doc="Residual from which a tie point has less weight.")
    model: MotionModel = MotionModel.HOMOGRAPHY
    tolerance: float = 1e-5


@dataclass(frozen=True, eq=False)
class Adjustment:
    """The result of an adjustment.

    Attributes:
        cameras: float64[n, 3, 3], plane to frame; fixed ones unchanged.
        points: float64[m, 2], on the plane.
        cost: half the sum of Huber's function of the residuals, px squared.
        rmse: root mean square residual, px.
        iterations: iterations tried.
    """

    cameras: FloatArray
    points: FloatArray
    cost: float
    rmse: float
    iterations: int


def adjust(problem: PlaneProblem, settings: AdjustmentSettings | None = None) -> Adjustment:
    """Minimises the reprojection error over homographies and plane points, from near the solution.

    Points without observations are unchanged.

    Raises:
        ValueError: the problem is inconsistent.

    Source: Triggs, McLauchlan, Hartley and Fitzgibbon, Bundle adjustment, a modern synthesis, 2000; Lourakis
    and Argyros, SBA, ACM TOMS 36, 2009; Nielsen, Damping parameter in Marquardt's method, 1999.
    """
    settings = settings or AdjustmentSettings()
    problem.check()
    # Without the frames and points that were not observed.
    cameras, camera_index = np.unique(problem.camera_index, return_inverse=True)
    points, point_index = np.unique(problem.point_index, return_inverse=True)
    free = ~problem.fixed[cameras]
    if not free.any():
        seen, _ = projected(problem.cameras[problem.camera_index], problem.points[problem.point_index])
        residuals = problem.observed - seen
        rmse = math.sqrt(float((residuals**2).sum()) / max(1, len(seen)))
        cost, _ = robust_cost(residuals, settings.huber)
        return Adjustment(problem.cameras, problem.points, cost, rmse, 0)
    part = replace(
        problem,
        cameras=problem.cameras[cameras],
        points=problem.points[points],
        camera_index=camera_index,
        point_index=point_index,
        fixed=~free,
    )
    # In normalised coordinates all parameters have similar weight.
    image, plane = _to_unit(problem.observed), _to_unit(part.points)
    unit = 1 / float(image[0, 0])
    descent = _Descent(_changed(part, image, plane), replace(settings, huber=settings.huber / unit), unit)
    iterations = descent.run()
    adjusted, places = problem.cameras.copy(), problem.points.copy()
    back = _changed(descent.problem, inverse(image), inverse(plane))
    adjusted[cameras[free]], places[points] = back.cameras[free], back.points
    rmse = unit * math.sqrt(float((descent.view.residuals**2).sum()) / len(problem.observed))
    return Adjustment(adjusted, places, descent.view.cost * unit**2, rmse, iterations)


def _to_unit(points: FloatArray) -> FloatArray:
    """The similarity that centres points float64[n, 2] and scales them to at most 1, float64[3, 3]."""
    low, high = points.min(axis=0), points.max(axis=0)
    scale = 2 / max(1e-9, float((high - low).max()))
    x, y = (-scale * (low + high) / 2).tolist()
    return np.array([[scale, 0, x], [0, scale, y], [0, 0, 1]])


def _changed(problem: PlaneProblem, image: FloatArray, plane: FloatArray) -> PlaneProblem:
    """A problem in other coordinates of frames and plane; both similarities, float64[3, 3]."""
    cameras = image @ problem.cameras @ np.linalg.inv(plane)
    return replace(
        problem,
        cameras=cameras / cameras[:, 2:, 2:],
        points=project(plane, problem.points),
        observed=project(image, problem.observed),
        lens=None if problem.lens is None else problem.lens.seen_through(image),
    )


@dataclass(frozen=True, eq=False)
class _View:
    """What cameras see of the points.

    Attributes:
        projected: float64[k, 2].
        depth: float64[k], the third homogeneous coordinate.
        residuals: float64[k, 2], observed minus projected.
        weights: float64[k], of the robust cost.
        cost: of residuals and lens; infinite where a point lies behind a camera.
    """

    projected: FloatArray
    depth: FloatArray
    residuals: FloatArray
    weights: FloatArray
    cost: float

    @property
    def scale(self) -> FloatArray:
        """float64[k, 1, 1], factor of the derivatives of the homogeneous coordinates."""
        return (np.sqrt(self.weights) / self.depth)[:, np.newaxis, np.newaxis]


class _Descent:
    """The Levenberg-Marquardt iteration.

    Args:
        problem: in normalised coordinates.
        settings: with Huber's bound in these.
        unit: px of a frame per unit. Residuals of the lens, in standard deviations, count as if in px.
    """

    def __init__(self, problem: PlaneProblem, settings: AdjustmentSettings, unit: float) -> None:
        self.problem = problem
        self._settings = settings
        self._free = np.flatnonzero(~problem.fixed)
        self._basis = _BASES[settings.model]
        self._lens_weight = 1 / unit
        self.view = self._view(problem)

    def run(self) -> int:
        """Runs to convergence; returns the iterations tried."""
        damping, growth = _FIRST_DAMPING, 2.0
        for iteration in range(1, self._settings.ba_iterations + 1):
            tried = self._stepped(damping)
            view = self._view(tried)
            gain, least = self.view.cost - view.cost, self._settings.tolerance * self.view.cost
            if gain > 0:
                self.problem, self.view = tried, view
                damping, growth = max(damping / 5, 1e-12), 2.0
            else:
                damping, growth = damping * growth, growth * 2
            if abs(gain) <= least or damping >= _MAX_DAMPING:
                return iteration
        return self._settings.ba_iterations

    def _view(self, problem: PlaneProblem) -> _View:
        seen, depth = projected(problem.cameras[problem.camera_index], problem.points[problem.point_index])
        residuals = problem.observed - seen
        cost, weights = robust_cost(residuals, self._settings.huber)
        if problem.lens is not None:
            violations = self._lens_weight * problem.lens.residuals(problem.cameras[self._free])
            cost += 0.5 * float((violations**2).sum())
        return _View(seen, depth, residuals, weights, cost if depth.min() > _MIN_DEPTH else math.inf)

    def _stepped(self, damping: float) -> PlaneProblem:
        """Cameras and points after a step by the Schur complement, and one more step of the points alone.

        Long strips have motions that hardly change the cost; the second step allows larger ones. `damping` is
        the factor of the diagonal that is added to it.

        Source: Lourakis and Argyros, SBA, ACM TOMS 36 (2009), section 3.
        """
        problem = self.problem
        by_cameras = self._by_cameras()
        by_points, residuals = _by_points(problem, self.view)
        cameras, sides = by_cameras.T @ by_cameras, by_cameras.T @ residuals
        if problem.lens is not None:
            slopes, violations = self._lens_slopes(problem.lens)
            cameras, sides = cameras + slopes.T @ slopes, sides - slopes.T @ violations
        mixed, points = by_cameras.T @ by_points, _inverse(by_points.T @ by_points, damping)
        point_sides = by_points.T @ residuals
        damped = cameras + scipy.sparse.diags_array(damping * cameras.diagonal())
        reduced = scipy.sparse.csc_array(damped - mixed @ points @ mixed.T)
        try:
            step = scipy.sparse.linalg.splu(reduced, options={"SymmetricMode": True}).solve(
                sides - mixed @ (points @ point_sides)
            )
        except RuntimeError:  # singular: the cost is infinite, and more damping follows
            step = np.full_like(sides, np.nan)
        moved = problem.cameras.copy()
        moved.reshape(-1, 9)[self._free, :8] += step.reshape(len(self._free), -1) @ self._basis.T
        places = problem.points + (points @ (point_sides - mixed.T @ step)).reshape(-1, 2)
        problem = replace(problem, cameras=moved, points=places)
        by_points, residuals = _by_points(problem, self._view(problem))
        alone = _inverse(by_points.T @ by_points, 0.0) @ (by_points.T @ residuals)
        return replace(problem, points=places + alone.reshape(-1, 2))

    def _by_cameras(self) -> Any:
        """Derivatives of the weighted residuals by the free cameras' parameters, [2 k, c f]."""
        problem, view = self.problem, self.view
        place = np.column_stack([problem.points[problem.point_index], np.ones(len(view.weights))])
        slopes = np.zeros((len(place), 2, 8))
        slopes[:, 0, :3] = slopes[:, 1, 3:6] = place
        slopes[:, :, 6:] = -view.projected[:, :, np.newaxis] * place[:, np.newaxis, :2]
        moves = ~problem.fixed[problem.camera_index]
        columns = np.searchsorted(self._free, problem.camera_index[moves])
        return scipy.sparse.bsr_array(
            ((slopes * view.scale)[moves] @ self._basis, columns, np.concatenate([[0], np.cumsum(moves)])),
            shape=(2 * len(place), self._basis.shape[1] * len(self._free)),
        )

    def _lens_slopes(self, lens: Lens) -> tuple[Any, FloatArray]:
        """Derivatives of what violates the lens by the free cameras' parameters, [4 f, c f], and that."""
        cameras = self.problem.cameras[self._free]
        number = np.arange(len(cameras) + 1)
        slopes = self._lens_weight * lens.slopes(cameras) @ self._basis
        violations = self._lens_weight * lens.residuals(cameras)
        return scipy.sparse.bsr_array((slopes, number[:-1], number)), violations.ravel()


def _by_points(problem: PlaneProblem, view: _View) -> tuple[Any, FloatArray]:
    """Derivatives of the weighted residuals by the points, [2 k, 2 m], and these, float64[2 k]."""
    cameras = problem.cameras[problem.camera_index]
    linear = cameras[:, :2, :2] - view.projected[:, :, np.newaxis] * cameras[:, 2:, :2]
    slopes = scipy.sparse.bsr_array(
        (view.scale * linear, problem.point_index, np.arange(len(linear) + 1)),
        shape=(2 * len(linear), 2 * len(problem.points)),
    )
    return slopes, (np.sqrt(view.weights)[:, np.newaxis] * view.residuals).ravel()


def _inverse(blocks: Any, damping: float) -> Any:
    """The inverse of the points' blocks, their diagonal enlarged by the factor `damping`."""
    inverse = blocks.copy()
    inverse.data = np.linalg.inv(blocks.data * (1 + damping * np.eye(2)) + _MIN_PIVOT * np.eye(2))
    return inverse
