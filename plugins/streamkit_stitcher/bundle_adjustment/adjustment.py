"""Levenberg-Marquardt over homographies and plane points."""

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from streamkit.geometry.homography import FloatArray
from streamkit.settings import setting
from streamkit_stitcher.bundle_adjustment.normal_equations import NormalEquations, form, point_steps, solve
from streamkit_stitcher.bundle_adjustment.problem import BASES, IndexArray, PlaneProblem, layout
from streamkit_stitcher.bundle_adjustment.projection import (
    ProjectedObservations,
    projected,
    robust_cost,
    view,
)
from streamkit_stitcher.registration.motion_models import MotionModel

_FIRST_DAMPING: Final = 1e-5
_LARGEST_DAMPING: Final = 1e6
_LEAST_DEPTH: Final = 1e-3


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
    if not len(problem.observed) or problem.fixed.all():
        return _unchanged(problem, settings.huber)
    # Frames and points without observations are left out: a window of a long flight costs what its own frames
    # cost.
    cameras, camera_index = _compact(problem.camera_index, len(problem.cameras))
    points, point_index = _compact(problem.point_index, len(problem.points))
    if problem.fixed[cameras].all():
        return _unchanged(problem, settings.huber)
    part = PlaneProblem(
        problem.cameras[cameras],
        problem.points[points],
        camera_index,
        point_index,
        problem.observed,
        problem.fixed[cameras],
        problem.lens,
    )
    scaled = _Scaled(part)
    descent = _Descent(scaled, settings)
    iterations = descent.run()
    adjusted, places = scaled.restored(descent.cameras, descent.points)
    free = ~part.fixed
    whole, everywhere = problem.cameras.copy(), problem.points.copy()
    whole[cameras[free]] = adjusted[free]
    everywhere[points] = places
    cost, squares = descent.cost * scaled.unit**2, descent.squares * scaled.unit**2
    return Adjustment(whole, everywhere, cost, float(np.sqrt(squares / len(problem.observed))), iterations)


def _unchanged(problem: PlaneProblem, huber: float) -> Adjustment:
    """The result of a problem in which nothing can move."""
    seen, _ = projected(problem.cameras[problem.camera_index], problem.points[problem.point_index])
    residuals = (problem.observed - seen).T
    squares = float((residuals**2).sum()) / max(1, len(seen))
    return Adjustment(problem.cameras, problem.points, robust_cost(residuals, huber)[0], squares**0.5, 0)


def _compact(index: IndexArray, count: int) -> tuple[IndexArray, IndexArray]:
    """The numbers below `count` that occur, ascending, and the position of each index among them."""
    occurs = np.zeros(count, dtype=np.bool_)
    occurs[index] = True
    return np.flatnonzero(occurs), (np.cumsum(occurs) - 1)[index]


class _Scaled:
    """A problem in normalised coordinates, so that all parameters have similar weight."""

    def __init__(self, problem: PlaneProblem) -> None:
        self.problem = problem
        low, high = problem.observed.min(axis=0), problem.observed.max(axis=0)
        self.unit = max(1.0, float((high - low).max()) / 2)
        self._image, self._image_back = _similarity((high + low) / 2, self.unit)
        self.lens = None if problem.lens is None else problem.lens.scaled(self.unit, (high + low) / 2)
        low, high = problem.points.min(axis=0), problem.points.max(axis=0)
        self._plane, self._plane_back = _similarity(
            (high + low) / 2, max(1e-9, float((high - low).max()) / 2)
        )
        cameras = self._image @ problem.cameras @ self._plane_back
        self.cameras = cameras / cameras[:, 2:, 2:]
        self.points = _mapped(self._plane, problem.points.T)
        self.observed = _mapped(self._image, problem.observed.T)

    def restored(self, cameras: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """float64[n, 3, 3] and float64[m, 2] in the problem's own coordinates."""
        matrices = self._image_back @ cameras @ self._plane
        return matrices / matrices[:, 2:, 2:], _mapped(self._plane_back, points).T


def _similarity(middle: FloatArray, unit: float) -> tuple[FloatArray, FloatArray]:
    """The scaling to unit size about a centre, and its inverse."""
    x, y = middle.tolist()
    return (
        np.array([[1 / unit, 0, -x / unit], [0, 1 / unit, -y / unit], [0, 0, 1]]),
        np.array([[unit, 0, x], [0, unit, y], [0, 0, 1]]),
    )


def _mapped(similarity: FloatArray, points: FloatArray) -> FloatArray:
    """float64[2, k] scaled and shifted."""
    return np.asarray(points * similarity[0, 0] + similarity[:2, 2:])


class _Descent:
    """The Levenberg-Marquardt iteration."""

    def __init__(self, scaled: _Scaled, settings: AdjustmentSettings) -> None:
        self._settings = settings
        self._layout = layout(scaled.problem)
        self._observed = np.ascontiguousarray(scaled.observed[:, self._layout.order])
        self._huber = settings.huber / scaled.unit
        self._basis = BASES[settings.model]
        # Ties count by their residual; those of the lens by their standard deviations, as much as 1 px.
        self._lens, self._lens_weight = scaled.lens, 1 / scaled.unit
        self.cameras, self.points = scaled.cameras, scaled.points
        self._views = self._view(self._elements(self.cameras), self.points)

    @property
    def cost(self) -> float:
        """Half the sum of Huber's function of the residuals, and of the squares of the lens's."""
        return self._cost(self.cameras, self._views)

    @property
    def squares(self) -> float:
        """The sum of the squared residuals."""
        return float(((self._observed - self._views.projected) ** 2).sum())

    def run(self) -> int:
        """Runs to convergence; returns the iterations tried."""
        damping, growth = _FIRST_DAMPING, 2.0
        equations = None
        iterations = 0
        while iterations < self._settings.ba_iterations and damping < _LARGEST_DAMPING:
            iterations += 1
            if equations is None:
                equations = self._with_lens(form(self._views, self._layout))
            try:
                step = solve(equations, self._layout, self._basis, damping)
            except np.linalg.LinAlgError:
                damping, growth = damping * growth, growth * 2
                continue
            cameras, points, views = self._tried(step)
            cost, lowered = self.cost, self._cost(cameras, views)
            if not lowered < cost:
                if lowered <= cost * (1 + self._settings.tolerance):
                    break
                damping, growth = damping * growth, growth * 2
                continue
            self.cameras, self.points, self._views = cameras, points, views
            damping, growth, equations = max(damping / 5, 1e-12), 2.0, None
            if cost - lowered <= self._settings.tolerance * cost:
                break
        return iterations

    def _tried(
        self, step: tuple[FloatArray, FloatArray]
    ) -> tuple[FloatArray, FloatArray, ProjectedObservations]:
        """Cameras and points after a step, and one more step of the points alone.

        Long strips have motions that hardly change the cost; the second step allows larger ones.
        """
        cameras = self.cameras.copy()
        cameras.reshape(-1, 9)[self._layout.free, :8] += step[0]
        elements, points = self._elements(cameras), self.points + step[1]
        points += point_steps(self._view(elements, points), self._layout)
        return cameras, points, self._view(elements, points)

    def _cost(self, cameras: FloatArray, views: ProjectedObservations) -> float:
        """The cost; infinite where a point lies behind a camera."""
        if not views.depth.min() > _LEAST_DEPTH:
            return math.inf
        if self._lens is None:
            return views.cost
        residuals = self._lens_weight * self._lens.residuals(cameras[self._layout.free])
        return views.cost + 0.5 * float((residuals**2).sum())

    def _with_lens(self, equations: NormalEquations) -> NormalEquations:
        """The normal equations with the residuals of the lens."""
        if self._lens is None:
            return equations
        cameras = self.cameras[self._layout.free]
        slopes = self._lens_weight * self._lens.slopes(cameras)
        residuals = self._lens_weight * self._lens.residuals(cameras)
        return replace(
            equations,
            camera_blocks=equations.camera_blocks + slopes.transpose(0, 2, 1) @ slopes,
            camera_sides=equations.camera_sides - (residuals[:, np.newaxis] @ slopes)[:, 0],
        )

    def _elements(self, cameras: FloatArray) -> FloatArray:
        """float64[3, 3, k], of each observation's camera."""
        return np.ascontiguousarray(cameras.transpose(1, 2, 0)).take(self._layout.camera, axis=2)

    def _view(self, elements: FloatArray, points: FloatArray) -> ProjectedObservations:
        return view(elements, points.take(self._layout.point, axis=1), self._observed, self._huber)
