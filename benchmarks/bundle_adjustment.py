"""The bundle adjustment against scipy's least squares, and the middle reference plane against the first.

    python benchmarks/bundle_adjustment.py

1. Observations with 0.5 px of noise, 6 to 100 cameras: cost, residual against the noise floor, and time.
   scipy gets the same residuals, the analytic sparse Jacobian, and the better of its two solvers where the
   problem is small enough for the dense one; its time is that until it is within a thousandth of our cost.
2. The time of one adjustment of the newest 12 cameras while a strip grows to 300.
3. Strips of 21 pictures, 25 seeds: the worst corner of the two ends with the first picture as the plane and
   with the middle one, both adjusted.
"""

import statistics
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import scipy.optimize
import scipy.sparse

from streamkit_stitcher.bundle_adjustment.adjustment import AdjustmentSettings, adjust
from streamkit_stitcher.bundle_adjustment.problem import PlaneProblem, projected

FloatArray = npt.NDArray[np.float64]
WIDTH, HEIGHT = 1280, 720
NOISE = 0.5
WINDOW_FLIGHT = 300
EXACT = AdjustmentSettings(huber=1e9, ba_iterations=60, tolerance=1e-8)
QUICK = AdjustmentSettings(huber=1e9, ba_iterations=60, tolerance=1e-4)
CORNERS = np.array([[0, 0, 1], [WIDTH, 0, 1], [WIDTH, HEIGHT, 1], [0, HEIGHT, 1.0]]).T


def survey(count: int, per_row: int, seed: int, tilt: float = 1e-5) -> tuple[PlaneProblem, FloatArray]:
    """Strips over scattered points, begun with errors that add up; and the true cameras."""
    random = np.random.default_rng(seed)
    cameras = []
    for index in range(count):
        row, column = divmod(index, per_row)
        column = column if row % 2 == 0 else per_row - 1 - column
        angle, scale = random.normal(0, 0.03), 1 + random.normal(0, 0.02)
        cos, sin = scale * np.cos(angle), scale * np.sin(angle)
        x, y = column * WIDTH * 0.35 + random.normal(0, 10), row * HEIGHT * 0.6 + random.normal(0, 10)
        lean = np.eye(3)
        lean[2, :2] = random.normal(0, tilt, 2)
        middle = np.array([[1, 0, -(WIDTH - 1) / 2], [0, 1, -(HEIGHT - 1) / 2], [0, 0, 1]])
        cameras.append(np.linalg.inv(np.array([[cos, -sin, x], [sin, cos, y], [0, 0, 1]]) @ lean @ middle))
    true = np.array(cameras) @ np.linalg.inv(cameras[0])
    true /= true[:, 2:, 2:]
    return _observed(true, random), true


def _observed(true: FloatArray, random: np.random.Generator) -> PlaneProblem:
    outlines = np.linalg.inv(true) @ CORNERS
    places = outlines[:, :2] / outlines[:, 2:]
    low, high = places.min(axis=(0, 2)), places.max(axis=(0, 2))
    points = random.uniform(low, high, (int(np.prod(high - low) / (WIDTH * HEIGHT) * 115), 2))
    cameras, indices, observed = [], [], []
    for number, camera in enumerate(true):
        seen, depth = projected(np.broadcast_to(camera, (len(points), 3, 3)), points)
        inside = np.flatnonzero((depth > 0) & (seen > 0).all(axis=1) & (seen < (WIDTH, HEIGHT)).all(axis=1))
        cameras.append(np.full(len(inside), number))
        indices.append(inside)
        observed.append(seen[inside] + random.normal(0, NOISE, (len(inside), 2)))
    camera_index, point_index = np.concatenate(cameras), np.concatenate(indices)
    places = np.concatenate(observed)
    often = np.bincount(point_index, minlength=len(points))[point_index] >= 2
    camera_index, places = camera_index[often], places[often]
    _, first, numbers = np.unique(point_index[often], return_index=True, return_inverse=True)
    start, drift = true.copy(), np.eye(3)
    for number in range(1, len(true)):
        error = np.eye(3)
        error[:2, 2], error[:2, :2] = random.normal(0, 0.5, 2), np.eye(2) + random.normal(0, 3e-4, (2, 2))
        drift = drift @ error
        start[number] = drift @ true[number]
    start /= start[:, 2:, 2:]
    back, _ = projected(np.linalg.inv(start)[camera_index[first]], places[first])
    fixed = np.arange(len(true)) == 0
    return PlaneProblem(start, back, camera_index, numbers.astype(np.int64), places, fixed)


def stopwatch(goal: float, began: float, reached: list[float]) -> Callable[..., None]:
    """Ends a solver once it is within a thousandth of a cost, and notes how long that took."""

    def watch(intermediate_result: scipy.optimize.OptimizeResult) -> None:
        if intermediate_result.cost <= goal * 1.001:
            reached.append(time.process_time() - began)
            raise StopIteration

    return watch


class Peer:
    """The same problem for scipy.optimize.least_squares."""

    def __init__(self, problem: PlaneProblem) -> None:
        self._problem = problem
        self._unit = WIDTH / 2
        lower = np.array([[1 / self._unit, 0, -1], [0, 1 / self._unit, -HEIGHT / WIDTH], [0, 0, 1]])
        cameras = lower @ problem.cameras @ np.linalg.inv(lower)
        self._cameras = cameras / cameras[:, 2:, 2:]
        self._points = problem.points / self._unit - [1, HEIGHT / WIDTH]
        self._observed = problem.observed / self._unit - [1, HEIGHT / WIDTH]
        self._free = np.flatnonzero(~problem.fixed)
        self._column = np.full(len(cameras), -1)
        self._column[self._free] = np.arange(len(self._free))

    def start(self) -> FloatArray:
        """All parameters in a row."""
        return np.concatenate([self._cameras[self._free].reshape(-1, 9)[:, :8].ravel(), self._points.ravel()])

    def _unpack(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        split = 8 * len(self._free)
        cameras = self._cameras.copy()
        elements = np.ones((len(self._free), 9))
        elements[:, :8] = values[:split].reshape(-1, 8)
        cameras[self._free] = elements.reshape(-1, 3, 3)
        return cameras, values[split:].reshape(-1, 2)

    def residuals(self, values: FloatArray) -> FloatArray:
        """Residuals in px, in a row."""
        cameras, points = self._unpack(values)
        seen, _ = projected(cameras[self._problem.camera_index], points[self._problem.point_index])
        return ((self._observed - seen) * self._unit).ravel()

    def jacobian(self, values: FloatArray) -> scipy.sparse.csr_array:
        """Their derivatives."""
        cameras, points = self._unpack(values)
        own, place = cameras[self._problem.camera_index], points[self._problem.point_index]
        seen, depth = projected(own, place)
        count = len(seen)
        camera = np.zeros((count, 2, 8))
        camera[:, 0, :2] = camera[:, 1, 3:5] = place / depth[:, np.newaxis]
        camera[:, 0, 2] = camera[:, 1, 5] = 1 / depth
        camera[:, :, 6:] = -seen[:, :, np.newaxis] * camera[:, :1, :2]
        point = (own[:, :2, :2] - seen[:, :, np.newaxis] * own[:, 2:, :2]) / depth[:, np.newaxis, np.newaxis]
        row = np.arange(2 * count).reshape(count, 2, 1)
        column = self._column[self._problem.camera_index]
        moves = column >= 0
        columns = (8 * column)[:, np.newaxis, np.newaxis] + np.arange(8)
        last = (8 * len(self._free) + 2 * self._problem.point_index)[:, np.newaxis, np.newaxis] + np.arange(2)
        parts = [
            (
                camera[moves],
                np.broadcast_to(row, (count, 2, 8))[moves],
                np.broadcast_to(columns, (count, 2, 8))[moves],
            ),
            (point, np.broadcast_to(row, (count, 2, 2)), np.broadcast_to(last, (count, 2, 2))),
        ]
        data, rows, places = (np.concatenate([part[number].ravel() for part in parts]) for number in range(3))
        shape = 2 * count, 8 * len(self._free) + 2 * len(points)
        return scipy.sparse.csr_array((-self._unit * data, (rows, places)), shape=shape)

    def solve(self, goal: float) -> tuple[float, float]:
        """Seconds until the cost is within a thousandth of `goal` (or it gives up), and the cost."""
        best = (np.inf, np.inf)
        for solver in ("lsmr", "exact") if len(self.start()) < 1500 else ("lsmr",):
            spent = time.process_time()
            reached: list[float] = []
            jacobian = self.jacobian if solver == "lsmr" else lambda values: self.jacobian(values).toarray()
            result = scipy.optimize.least_squares(
                self.residuals,
                self.start(),
                jac=jacobian,
                method="trf",
                x_scale="jac",
                tr_solver=solver,
                max_nfev=100,
                callback=stopwatch(goal, spent, reached),
            )
            took = reached[0] if reached else time.process_time() - spent
            best = min(best, (took, float(result.cost)))
        return best


def compare_with_scipy() -> None:
    """Table 1."""
    print(
        "| cameras | observations | points | ms | scipy ms | times faster | cost / best - 1 | rms / floor |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for count, per_row in ((6, 100), (10, 100), (15, 100), (20, 100), (40, 10), (60, 12), (100, 20)):
        problem, _ = survey(count, per_row, seed=count)
        times = []
        for _ in range(5):
            began = time.process_time()
            result = adjust(problem, QUICK)
            times.append(time.process_time() - began)
        best = adjust(problem, EXACT).cost
        peer_s, peer_cost = Peer(problem).solve(best)
        observations = len(problem.observed)
        freedom = 2 * observations - 8 * (count - 1) - 2 * len(problem.points)
        floor = NOISE * np.sqrt(2 * freedom / (2 * observations))
        ours = statistics.median(times)
        print(
            f"| {count} | {observations} | {len(problem.points)} | {ours * 1e3:.1f} | {peer_s * 1e3:.0f} "
            f"| {peer_s / ours:.1f} | {result.cost / min(best, peer_cost) - 1:.1e} "
            f"| {result.rmse / floor:.3f} |",
            flush=True,
        )


def window_of(whole: PlaneProblem, count: int) -> PlaneProblem:
    """The newest 12 of the first `count` cameras, held by the two before; the whole flight is handed over."""
    seen = (whole.camera_index >= count - 14) & (whole.camera_index < count)
    often = np.bincount(whole.point_index[seen], minlength=len(whole.points)) >= 2
    seen &= often[whole.point_index]
    fixed = np.ones(len(whole.cameras), dtype=bool)
    fixed[count - 12 : count] = False
    return replace(
        whole,
        camera_index=whole.camera_index[seen],
        point_index=whole.point_index[seen],
        observed=whole.observed[seen],
        fixed=fixed,
    )


def sliding_window() -> None:
    """Table 2."""
    print(
        "\n| cameras so far | window of 12, ms | steps | observations | per camera and step, ms "
        "| per 1000 observations and step, ms |\n|---|---|---|---|---|---|"
    )
    whole, _ = survey(WINDOW_FLIGHT, 10 * WINDOW_FLIGHT, seed=5, tilt=0.0)
    for count in (20, 50, 100, 200, WINDOW_FLIGHT):
        problem = window_of(whole, count)
        times = []
        for _ in range(5):
            began = time.process_time()
            steps = adjust(problem, AdjustmentSettings(ba_iterations=8, tolerance=1e-5)).iterations
            times.append(time.process_time() - began)
        cost, observations = statistics.median(times) * 1e3, len(problem.observed)
        print(
            f"| {count} | {cost:.1f} | {steps} | {observations} | {cost / 12 / steps:.3f} "
            f"| {cost / steps / observations * 1e3:.2f} |",
            flush=True,
        )


def end_error(problem: PlaneProblem, true: FloatArray, reference: int) -> float:
    """Worst corner of the first and the last picture on the plane of `reference`, px."""
    fixed = np.arange(len(true)) == reference
    rebased = problem.cameras @ np.linalg.inv(problem.cameras[reference])
    moved, _ = projected(
        np.broadcast_to(problem.cameras[reference], (len(problem.points), 3, 3)), problem.points
    )
    found = adjust(
        replace(problem, cameras=rebased / rebased[:, 2:, 2:], points=moved, fixed=fixed), EXACT
    ).cameras
    worst = 0.0
    for end in (0, len(true) - 1):
        exact = true[reference] @ np.linalg.inv(true[end]) @ CORNERS
        measured = np.linalg.inv(found[end]) @ CORNERS
        apart = exact[:2] / exact[2] - measured[:2] / measured[2]
        worst = max(worst, float(np.linalg.norm(apart, axis=0).max()))
    return worst


def compare_planes() -> None:
    """Table 3."""
    print(
        "\n| tilt per px | first plane, px | middle plane, px | ratio of medians | median ratio |"
        "\n|---|---|---|---|---|"
    )
    for tilt in (0.0, 1e-5, 3e-5):
        pairs = []
        for seed in range(25):
            problem, true = survey(21, 100, seed=1000 + seed, tilt=tilt)
            pairs.append((end_error(problem, true, 0), end_error(problem, true, 10)))
        first, middle = np.array(pairs).T
        print(
            f"| {tilt:.0e} | {np.median(first):.2f} | {np.median(middle):.2f} "
            f"| {np.median(first) / np.median(middle):.2f} | {np.median(first / middle):.2f} |",
            flush=True,
        )


def main() -> None:
    """Prints the three tables."""
    for table in (compare_with_scipy, sliding_window, compare_planes):
        table()


if __name__ == "__main__":
    main()
