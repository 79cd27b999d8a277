"""A lens of known focal length in the adjustment."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from streamkit.geometry.homography import normalised
from streamkit_stitcher.bundle_adjustment.adjustment import AdjustmentSettings, adjust
from streamkit_stitcher.bundle_adjustment.lens import Lens
from streamkit_stitcher.bundle_adjustment.problem import PlaneProblem, projected

WIDTH, HEIGHT, FOCAL = 1200.0, 900.0, 900.0
LENS = Lens(FOCAL, np.array([(WIDTH - 1) / 2, (HEIGHT - 1) / 2]))
MATRIX = np.array([[FOCAL, 0, (WIDTH - 1) / 2], [0, FOCAL, (HEIGHT - 1) / 2], [0, 0, 1]])
EXACT = AdjustmentSettings(ba_iterations=60, tolerance=1e-9)


def camera(place, turn):
    """The homography from a level plane to pixels; `place` x y and height, `turn` a rotation vector, rad."""
    down = np.diag([1.0, -1.0, -1.0])
    rotation = cv2.Rodrigues(np.array(turn))[0] @ down
    x, y, height = place
    columns = np.array([[1, 0, -x], [0, 1, -y], [0, 0, -height]])
    return normalised(MATRIX @ rotation @ columns)


@pytest.fixture
def strip():
    """Twelve leaning cameras in a row, 1 px of noise and a tie point everywhere; and their places."""
    random = np.random.default_rng(3)
    places = [(450.0 * number, random.normal(0, 30), 1000.0 + random.normal(0, 20)) for number in range(12)]
    true = np.array([camera(place, (*random.normal(0, 0.05, 2), 0.1)) for place in places])
    points = np.column_stack([random.uniform(-800, 5800, 3000), random.uniform(-700, 700, 3000)])
    cameras, indices, seen = [], [], []
    for number, matrix in enumerate(true):
        pixels, depth = projected(np.broadcast_to(matrix, (len(points), 3, 3)), points)
        inside = (pixels > 0).all(axis=1) & (pixels < (WIDTH, HEIGHT)).all(axis=1) & (depth > 0)
        cameras.append(np.full(int(inside.sum()), number))
        indices.append(np.flatnonzero(inside))
        seen.append(pixels[inside] + random.normal(0, 1, (int(inside.sum()), 2)))
    start = np.array([camera(place, (0.0, 0.0, 0.1)) for place in places])
    fixed = np.arange(12) == 0
    problem = PlaneProblem(
        start, points, np.concatenate(cameras), np.concatenate(indices), np.concatenate(seen), fixed
    )
    return problem, np.array(places)[:, :2]


def misfit(cameras, places):
    """Root mean square distance of the points below the cameras from their places, after a similarity."""
    found = np.array([LENS.foot(matrix) for matrix in cameras]) @ [1, 1j]
    true = places @ [1, 1j]
    found, true = found - found.mean(), true - true.mean()
    return float(np.sqrt((abs(true - found * (found.conj() @ true) / (found.conj() @ found)) ** 2).mean()))


def test_a_camera_above_a_level_plane_agrees():
    """Its shape is exact and its tilt the angle; the point below it is its place."""
    matrix = camera((300.0, -200.0, 800.0), (0.08, 0.0, 0.0))
    shape, tilt = np.split(LENS.residuals(matrix[np.newaxis])[0], 2)
    assert shape == pytest.approx(np.zeros(2), abs=1e-9)
    assert np.hypot(*tilt) == pytest.approx(np.sin(0.08) / 0.1, rel=0.01)
    assert LENS.foot(matrix) == pytest.approx(np.array([300.0, -200.0]))


def test_the_slopes_are_those_of_the_residuals():
    """Against central differences."""
    matrix = LENS.seen_through(np.diag([1 / 600.0, 1 / 600.0, 1.0])).rays(np.eye(3)[np.newaxis]) + 0.1
    found = LENS.slopes(matrix)
    for element in range(8):
        step = np.zeros(9)
        step[element] = 1e-5
        ahead, behind = (LENS.residuals(matrix + sign * step.reshape(3, 3)) for sign in (1, -1))
        assert found[:, :, element] == pytest.approx((ahead - behind) / 2e-5, abs=1e-3 * abs(found).max())


def test_a_strip_stays_straight(strip):
    """Homographies alone bend it; 15 % more focal length makes no difference."""
    problem, places = strip
    free = replace(problem, fixed=np.zeros_like(problem.fixed))
    bent = misfit(adjust(problem, EXACT).cameras, places)
    for lens in (LENS, Lens(1.15 * FOCAL, LENS.middle)):
        result = adjust(replace(free, lens=lens), EXACT)
        assert misfit(result.cameras, places) < 0.5 * bent
        assert result.rmse < 1.5


def test_something_holds_the_plane(strip):
    """Without a lens a keyframe must."""
    problem, _ = strip
    with pytest.raises(ValueError, match="fixed"):
        adjust(replace(problem, fixed=np.zeros_like(problem.fixed)))
