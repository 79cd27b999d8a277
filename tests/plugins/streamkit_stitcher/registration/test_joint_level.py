"""The order of patches, and the step that suits their shifts."""

import numpy as np
import pytest

from streamkit_stitcher.homographies import project
from streamkit_stitcher.registration.joint_level import joint_level, solved_step, spread_order, step_matrix

STEP = np.array([[1 + 2e-4, -1e-4, 0.3], [1e-4, 1 - 1e-4, -0.2], [2e-7, -1e-7, 1.0]])


@pytest.fixture
def level():
    """A hundred patches of noise all over a picture."""
    random = np.random.default_rng(4)
    centres = np.rint(random.uniform([10, 10], [630, 350], (100, 2)))
    return joint_level(random.integers(0, 255, (100, 17, 17), np.uint8), centres, np.arange(100))


def test_leading_parts_are_spread():
    """Each number comes once, and of the first eighth no two are close together."""
    order = spread_order(100)
    assert sorted(order) == list(range(100))
    assert np.diff(np.sort(order[:12])).min() >= 4
    assert spread_order(1).tolist() == [0]


@pytest.mark.parametrize("told", ["evenly", "by covariances"])
def test_the_step_moves_the_patches_as_they_were_shifted(level, told):
    """Shifts of a small homography are explained to a thousandth of a pixel, whatever counts how much."""
    shift = (project(STEP, level.patches.centres) - level.patches.centres).T
    weights = np.random.default_rng(5).uniform(0.5, 2.0, (3, 100))
    weights[1] *= 0.2
    parameters, moves, normal = solved_step(level, shift, weights if told == "by covariances" else weights[0])
    assert moves == pytest.approx(shift, abs=1e-3)
    assert step_matrix(level.scaling, parameters) == pytest.approx(STEP, abs=1e-3)
    assert normal == pytest.approx(normal.T)


def test_what_counts_more_is_followed_more(level):
    """One patch in x and another in y, told for certain: the step goes to them."""
    shift = np.zeros((2, 100))
    shift[0, 3], shift[1, 7] = 0.5, -0.4
    weights = np.full((3, 100), 1e-6)
    weights[1] = 0.0
    weights[0, 3] = weights[2, 7] = 1e3
    _, moves, _ = solved_step(level, shift, weights)
    assert moves[0, 3] == pytest.approx(0.5, abs=1e-3)
    assert moves[1, 7] == pytest.approx(-0.4, abs=1e-3)


def test_patches_left_out_are_not_usable(level):
    """The rest keep what they were, and a part keeps the numbers of what it is made of."""
    left_out = np.arange(100) < 40
    assert np.array_equal(level.without(left_out).patches.usable, level.patches.usable & ~left_out)
    assert level.part(np.array([5, 9])).numbers.tolist() == [5, 9]
