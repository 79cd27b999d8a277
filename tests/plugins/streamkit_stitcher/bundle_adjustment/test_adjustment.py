"""The bundle adjustment of homographies and plane points."""

from dataclasses import replace

import numpy as np
import pytest
import scipy

from streamkit_stitcher.bundle_adjustment.adjustment import AdjustmentSettings, adjust
from streamkit_stitcher.bundle_adjustment.problem import PlaneProblem, projected, robust_cost
from streamkit_stitcher.registration.motion_models import MotionModel

EXACT = AdjustmentSettings(huber=1e9, ba_iterations=50, tolerance=1e-10)


def strip(count=5, noise=0.5, seed=0, tilt=1e-5, density=60):
    """A strip of frames over scattered points: the problem with a poor start, and the true cameras."""
    random = np.random.default_rng(seed)
    cameras = []
    for number in range(count):
        angle = random.normal(0, 0.03)
        cos, sin = np.cos(angle), np.sin(angle)
        pose = np.array([[cos, -sin, 450.0 * number], [sin, cos, random.normal(0, 10)], [0, 0, 1]])
        lean = np.eye(3)
        lean[2, :2] = random.normal(0, tilt, 2)
        cameras.append(np.linalg.inv(pose @ lean))
    true = np.array(cameras) @ np.linalg.inv(cameras[0])
    true /= true[:, 2:, 2:]
    points = random.uniform([0, 0], [450.0 * count + 900, 720], (density * count, 2))
    seen = [projected(np.broadcast_to(camera, (len(points), 3, 3)), points)[0] for camera in true]
    inside = [np.flatnonzero(((view > 0) & (view < (1280, 720))).all(axis=1)) for view in seen]
    camera_index = np.repeat(np.arange(count), [len(own) for own in inside])
    point_index = np.concatenate(inside)
    observed = np.concatenate([view[own] for view, own in zip(seen, inside, strict=True)])
    observed = observed + random.normal(0, noise, observed.shape)
    twice = np.bincount(point_index, minlength=len(points))[point_index] > 1
    start = true.copy()
    start[1:, :2, 2] += random.normal(0, 3, (count - 1, 2))
    return (
        PlaneProblem(
            start,
            points + random.normal(0, 2, points.shape),
            camera_index[twice],
            point_index[twice],
            observed[twice],
            np.arange(count) == 0,
        ),
        true,
    )


def residuals(problem, cameras, points):
    """Residuals, float64[k, 2]."""
    seen, _ = projected(cameras[problem.camera_index], points[problem.point_index])
    return problem.observed - seen


@pytest.mark.parametrize("huber", [1e9, 0.7])
def test_the_cost_is_that_of_scipy(huber):
    """The same minimum of the same cost, robust or not, to a thousandth.

    SciPy starts near the end, for it takes a hundred steps to where ours takes ten; it would leave for less.
    """
    problem, _ = strip(4, density=12)
    ours = adjust(problem, replace(EXACT, huber=huber))
    used = np.unique(problem.point_index)
    split = 8 * 3

    def unpack(values):
        cameras, points = problem.cameras.copy(), problem.points.copy()
        elements = np.ones((3, 9))
        elements[:, :8] = values[:split].reshape(3, 8) / [1, 1, 1e-3, 1, 1, 1e-3, 1e3, 1e3]
        cameras[1:] = elements.reshape(3, 3, 3)
        points[used] = values[split:].reshape(-1, 2)
        return cameras, points

    def whitened(values):
        own = residuals(problem, *unpack(values))
        lengths = np.linalg.norm(own, axis=1, keepdims=True)
        robust = np.sqrt(np.where(lengths > huber, 2 * huber * lengths - huber**2, lengths**2))
        return (own / np.maximum(lengths, 1e-12) * robust).ravel()

    random = np.random.default_rng(1)
    begin = ours.cameras[1:].reshape(3, 9)[:, :8] * [1, 1, 1e-3, 1, 1, 1e-3, 1e3, 1e3]
    begin[:, [2, 5]] += random.normal(0, 3e-4, (3, 2))
    points = ours.points[used] + random.normal(0, 0.3, (len(used), 2))
    peer = scipy.optimize.least_squares(
        whitened, np.concatenate([begin.ravel(), points.ravel()]), method="lm"
    )
    assert ours.cost == pytest.approx(peer.cost, rel=1e-3)


def test_the_residual_is_the_noise():
    """With 0.5 px of noise the root mean square is at the floor that the free parameters leave."""
    problem, _ = strip(8)
    result = adjust(problem, EXACT)
    used = len(np.unique(problem.point_index))
    freedom = 2 * len(problem.observed) - 8 * 7 - 2 * used
    assert result.rmse == pytest.approx(0.5 * np.sqrt(freedom / len(problem.observed)), rel=0.08)
    assert result.rmse == pytest.approx(
        np.sqrt((residuals(problem, result.cameras, result.points) ** 2).sum(axis=1).mean())
    )


def test_without_noise_the_truth_comes_back():
    """Exact observations give the exact cameras, with the gauge where it was held."""
    problem, true = strip(6, noise=0.0)
    result = adjust(problem, EXACT)
    assert np.array_equal(result.cameras[0], problem.cameras[0])
    assert result.cameras == pytest.approx(true, abs=1e-4)


def test_gross_errors_weigh_little():
    """One observation in twenty that is 60 px off moves the cameras by less than it does without Huber."""
    problem, true = strip(4, noise=0.2)
    wrong = problem.observed.copy()
    wrong[::20] += 60.0
    dirty = replace(problem, observed=wrong)
    robust = adjust(dirty, replace(EXACT, huber=1.0)).cameras
    plain = adjust(dirty, EXACT).cameras
    assert np.abs(robust - true)[:, :2, 2].max() < 0.2 * np.abs(plain - true)[:, :2, 2].max()


@pytest.mark.parametrize("model", [MotionModel.AFFINE, MotionModel.SIMILARITY])
def test_simpler_models_stay_what_they_are(model):
    """Affine and similar cameras keep their form, and drift less where the truth is like that."""
    last = np.array([[640.0, 360.0]])
    drifts = []
    for seed in range(5):
        problem, true = strip(8, noise=0.5, tilt=0.0, seed=seed)
        place = projected(np.linalg.inv(true[-1:]), last)[0]
        results = [adjust(problem, replace(EXACT, model=own)) for own in (model, MotionModel.HOMOGRAPHY)]
        cameras = results[0].cameras
        assert np.abs(cameras[:, 2, :2]).max() < 1e-15
        if model is MotionModel.SIMILARITY:
            assert cameras[:, 0, 0] == pytest.approx(cameras[:, 1, 1], abs=1e-12)
        found = [projected(np.linalg.inv(result.cameras[-1:]), last)[0] for result in results]
        drifts.append([np.linalg.norm(own - place) for own in found])
    simple, free = np.median(drifts, axis=0)
    assert simple < 0.7 * free


def test_fixed_cameras_hold_still():
    """Only what is free moves, as in a sliding window."""
    problem, _ = strip(6)
    fixed = np.array([True, True, True, False, False, True])
    result = adjust(replace(problem, fixed=fixed), EXACT)
    assert np.array_equal(result.cameras[fixed], problem.cameras[fixed])
    assert not np.allclose(result.cameras[~fixed], problem.cameras[~fixed])


def test_nothing_to_do_is_no_error():
    """No observation, or no free camera, gives back what came."""
    problem, _ = strip(3)
    empty = PlaneProblem(
        problem.cameras, problem.points, np.zeros(0, int), np.zeros(0, int), np.zeros((0, 2)), problem.fixed
    )
    for case in (empty, replace(problem, fixed=np.ones(3, bool))):
        result = adjust(case)
        assert np.array_equal(result.cameras, problem.cameras)
        assert result.iterations == 0


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"fixed": np.zeros(3, bool)}, "a camera that holds still"),
        ({"camera_index": np.zeros(2, int)}, "need as many camera and point indices"),
        ({"fixed": np.ones(2, bool)}, "one flag per camera"),
    ],
)
def test_contradictions_are_refused(changes, reason):
    """The error names the rule."""
    problem, _ = strip(3)
    with pytest.raises(ValueError, match=reason):
        adjust(replace(problem, **changes))


def test_an_index_out_of_range_is_refused():
    """The error names the range and the value."""
    problem, _ = strip(3)
    with pytest.raises(ValueError, match="camera_index must lie in 0 to 2, got 1 to 3"):
        adjust(replace(problem, camera_index=problem.camera_index + 1))


def test_huber_grows_linearly():
    """Quadratic up to the bound, linear beyond, with weights that fall."""
    cost, weights = robust_cost(np.array([[0.6, 0.8], [6.0, 8.0]]), 2.0)
    assert cost == pytest.approx(0.5 * (1.0 + (2 * 2 * 10 - 4)))
    assert weights == pytest.approx([1.0, 0.2])
