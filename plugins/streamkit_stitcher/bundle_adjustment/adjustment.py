"""Levenberg-Marquardt over homographies and plane points."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from streamkit_stitcher.bundle_adjustment.normal_equations import form, point_steps, solve
from streamkit_stitcher.bundle_adjustment.problem import (
    BASES,
    CameraModel,
    IndexArray,
    Layout,
    PlaneProblem,
    layout,
)
from streamkit_stitcher.bundle_adjustment.projection import (
    linearise,
    point_slopes,
    projected,
    robust_cost,
)
from streamkit_stitcher.homographies import FloatArray

_FIRST_DAMPING: Final = 1e-5
_LARGEST_DAMPING: Final = 1e6
_LEAST_DEPTH: Final = 1e-3


@dataclass(frozen=True)
class AdjustmentSettings:
    """How an adjustment runs.

    Attributes:
        model: what the cameras may be.
        huber: residual from which the cost grows linearly, px.
        max_iterations: most steps tried.
        tolerance: relative fall of the cost below which it ends.
    """

    model: CameraModel = CameraModel.HOMOGRAPHY
    huber: float = 1.5
    max_iterations: int = 20
    tolerance: float = 1e-6


@dataclass(frozen=True, eq=False)
class Adjustment:
    """An adjusted problem.

    Attributes:
        cameras: float64[n, 3, 3], plane to picture; the fixed ones as they were given.
        points: float64[m, 2], on the plane.
        cost: half the sum of Huber's function of the residuals, px squared.
        rmse: root mean square length of the residuals, px.
        iterations: steps tried.
    """

    cameras: FloatArray
    points: FloatArray
    cost: float
    rmse: float
    iterations: int


def adjust(problem: PlaneProblem, settings: AdjustmentSettings | None = None) -> Adjustment:
    """Finds the homographies and plane points that explain the observations best.

    Residuals count in picture pixels. Points without observations keep their places.

    Args:
        problem: the pictures, points and observations, near the solution.
        settings: how it runs.

    Raises:
        ValueError: the problem contradicts itself.

    Source: Triggs, McLauchlan, Hartley and Fitzgibbon, Bundle adjustment, a modern synthesis, 2000; Lourakis
    and Argyros, SBA, ACM TOMS 36, 2009; Nielsen, Damping parameter in Marquardt's method, 1999.
    """
    settings = settings or AdjustmentSettings()
    problem.check()
    if not len(problem.observed) or problem.fixed.all():
        cost, rmse = _cost_of(problem, settings.huber)
        return Adjustment(problem.cameras, problem.points, cost, rmse, 0)
    used, compact = np.unique(problem.point_index, return_inverse=True)
    small = replace(problem, points=problem.points[used], point_index=compact.astype(np.int64))
    scaled = _Scaled(small)
    cameras, points, iterations = _Descent(scaled, settings).run()
    cameras, places = scaled.restored(cameras, points)
    everywhere = problem.points.copy()
    everywhere[used] = places
    cameras[problem.fixed] = problem.cameras[problem.fixed]
    cost, rmse = _cost_of(replace(problem, cameras=cameras, points=everywhere), settings.huber)
    return Adjustment(cameras, everywhere, cost, rmse, iterations)


def _cost_of(problem: PlaneProblem, huber: float) -> tuple[float, float]:
    if not len(problem.observed):
        return 0.0, 0.0
    seen, _ = projected(problem.cameras[problem.camera_index], problem.points[problem.point_index])
    residuals = problem.observed - seen
    return robust_cost(residuals, huber)[0], float(np.sqrt((residuals**2).sum(axis=1).mean()))


class _Scaled:
    """A problem in coordinates of order one, so that all parameters weigh alike."""

    def __init__(self, problem: PlaneProblem) -> None:
        self.problem = problem
        middle = (problem.observed.max(axis=0) + problem.observed.min(axis=0)) / 2
        self.unit = max(1.0, float(np.abs(problem.observed - middle).max()))
        self._picture = _similarity(middle, self.unit)
        plane_middle = problem.points.mean(axis=0)
        plane_unit = max(1e-9, float(np.abs(problem.points - plane_middle).max()))
        self._plane = _similarity(plane_middle, plane_unit)
        cameras = self._picture @ problem.cameras @ np.linalg.inv(self._plane)
        self.cameras = cameras / cameras[:, 2:, 2:]
        self.points = (problem.points - plane_middle) / plane_unit
        self.observed = (problem.observed - middle) / self.unit
        self._plane_middle, self._plane_unit = plane_middle, plane_unit

    def restored(self, cameras: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        matrices = np.linalg.inv(self._picture) @ cameras @ self._plane
        return matrices / matrices[:, 2:, 2:], points * self._plane_unit + self._plane_middle


def _similarity(middle: FloatArray, unit: float) -> FloatArray:
    return np.array([[1 / unit, 0, -middle[0] / unit], [0, 1 / unit, -middle[1] / unit], [0, 0, 1]])


class _Descent:
    """The iteration: linearise, solve, keep what lowers the cost."""

    def __init__(self, scaled: _Scaled, settings: AdjustmentSettings) -> None:
        self._settings = settings
        self._layout: Layout = layout(scaled.problem)
        order = self._layout.order
        self._index: tuple[IndexArray, IndexArray] = (
            scaled.problem.camera_index[order],
            self._layout.group_of,
        )
        self._observed = scaled.observed[order]
        self._huber = settings.huber / scaled.unit
        self._basis = BASES[settings.model]
        self._cameras, self._points = scaled.cameras, scaled.points

    def run(self) -> tuple[FloatArray, FloatArray, int]:
        cost = self._cost(self._cameras, self._points)
        damping, growth = _FIRST_DAMPING, 2.0
        equations = None
        iterations = 0
        while iterations < self._settings.max_iterations and damping < _LARGEST_DAMPING:
            iterations += 1
            if equations is None:
                equations = form(
                    linearise(
                        self._cameras, self._points, self._index, self._observed, self._basis, self._huber
                    ),
                    self._layout,
                )
            try:
                step = solve(equations, self._layout, damping)
            except np.linalg.LinAlgError:
                damping, growth = damping * growth, growth * 2
                continue
            cameras, points = self._moved(step)
            tried = self._cost(cameras, points)
            if not tried < cost:
                if tried <= cost * (1 + self._settings.tolerance):
                    break
                damping, growth = damping * growth, growth * 2
                continue
            done = cost - tried <= self._settings.tolerance * cost
            self._cameras, self._points, cost = cameras, points, tried
            damping, growth, equations = max(damping / 5, 1e-12), 2.0, None
            if done:
                break
        return self._cameras, self._points, iterations

    def _moved(self, step: tuple[FloatArray, FloatArray]) -> tuple[FloatArray, FloatArray]:
        cameras = self._cameras.copy()
        elements = np.concatenate([step[0] @ self._basis.T, np.zeros((len(step[0]), 1))], axis=1)
        cameras[self._layout.free] += elements.reshape(-1, 3, 3)
        return cameras, self._settled(cameras, self._points + step[1])

    def _settled(self, cameras: FloatArray, points: FloatArray) -> FloatArray:
        """The points after a step of their own: the cameras' step bends them in the second order.

        Long strips have motions that hardly change the cost; along those this takes wider steps possible.
        """
        residuals, slopes = point_slopes(cameras, points, self._index, self._observed, self._huber)
        return points + point_steps(residuals, slopes, self._layout)

    def _cost(self, cameras: FloatArray, points: FloatArray) -> float:
        """The cost, infinite where a point comes to lie behind a camera's horizon."""
        seen, depth = projected(cameras[self._index[0]], points[self._index[1]])
        if not depth.min() > _LEAST_DEPTH:
            return float("inf")
        return robust_cost(self._observed - seen, self._huber)[0]
