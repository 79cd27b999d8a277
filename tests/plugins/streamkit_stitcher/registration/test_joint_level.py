"""The order of patches, and parts of them."""

import numpy as np
import pytest

from streamkit_stitcher.registration.joint_alignment import joint_level, spread_order


@pytest.fixture
def level():
    """A hundred patches of noise all over a frame."""
    random = np.random.default_rng(4)
    centres = np.rint(random.uniform([10, 10], [630, 350], (100, 2)))
    return joint_level(random.integers(0, 255, (100, 17, 17), np.uint8), centres, np.arange(100))


def test_leading_parts_are_spread():
    """Each number comes once, and of the first eighth no two are close together."""
    order = spread_order(100)
    assert sorted(order) == list(range(100))
    assert np.diff(np.sort(order[:12])).min() >= 4
    assert spread_order(1).tolist() == [0]


def test_patches_left_out_are_not_usable(level):
    """The rest keep what they were, and a part keeps the numbers of what it is made of."""
    left_out = np.arange(100) < 40
    assert np.array_equal(level.without(left_out).patches.usable, level.patches.usable & ~left_out)
    assert level.part(np.array([5, 9])).numbers.tolist() == [5, 9]
