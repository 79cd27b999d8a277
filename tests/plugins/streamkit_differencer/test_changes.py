"""Equations 1 and 2 on the canvas."""

import cv2
import numpy as np
import pytest

from streamkit_differencer.changes import LONGEST_WAIT, update_waiting
from tests.plugins.streamkit_differencer.paper_equations import dynamic_matrix, logical_matrix

SHAPE = (33, 50)
REGION = (3, 31, 5, 47)
INSIDE = np.s_[3:31, 5:47]


def pictures(seed, shape=SHAPE):
    """Two random images and two masks."""
    random = np.random.default_rng(seed)
    first, second = cv2.blur(
        random.integers(0, 256, (2, *shape), np.uint8).transpose(1, 2, 0), (3, 3)
    ).transpose(2, 0, 1)
    masks = np.where(random.random((2, *shape)) < 0.9, 255, 0).astype(np.uint8)
    return [np.ascontiguousarray(picture) for picture in (first, second, *masks)]


@pytest.mark.parametrize("gain", [0.0, 0.3])
@pytest.mark.parametrize("seed", range(3))
def test_the_pass_is_equations_1_and_2(seed, gain):
    """Within the region D is that of the equations, where edges raise the threshold; else nothing changes."""
    image, earlier, seen, earlier_seen = pictures(seed)
    random, quiet_frames = np.random.default_rng(seed + 9), 7
    dynamic = random.integers(0, quiet_frames + 1, SHAPE).astype(np.uint8)
    waiting = dynamic + np.uint8(LONGEST_WAIT - quiet_frames)
    before, quiet = waiting.copy(), np.full(SHAPE, 77, np.uint8)
    update_waiting(image, seen, earlier, earlier_seen, waiting, quiet, REGION, 18.0, gain, quiet_frames)
    inside, square = earlier[INSIDE], np.ones((3, 3), np.uint8)
    borne = cv2.convertScaleAbs(cv2.morphologyEx(inside, cv2.MORPH_GRADIENT, square), alpha=gain)
    difference = cv2.subtract(cv2.absdiff(image[INSIDE], inside), borne)
    changed, both = np.where(difference > 18, 255, 0).astype(np.uint8), (seen & earlier_seen)[INSIDE]
    if gain == 0.0:
        np.testing.assert_array_equal(changed, logical_matrix(image[INSIDE], inside, 18.0))
    expected = dynamic_matrix(dynamic[INSIDE], changed | ~both, quiet_frames)
    found = np.maximum(waiting[INSIDE], LONGEST_WAIT - quiet_frames) - (LONGEST_WAIT - quiet_frames)
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(quiet[INSIDE] > 0, expected == 0)
    outside = np.ones(SHAPE, bool)
    outside[INSIDE] = False
    assert (quiet[outside] == 77).all()
    np.testing.assert_array_equal(waiting[outside], before[outside])


def test_gradient_gain_raises_the_threshold_at_edges_only():
    """Near an edge of 100 levels a gain of 0.5 bears 50 levels more, elsewhere nothing more."""
    earlier = np.zeros((10, 40), np.uint8)
    earlier[:, 20:] = 100
    seen, waiting, quiet = (
        np.full((10, 40), 255, np.uint8),
        np.zeros((10, 40), np.uint8),
        np.zeros((10, 40), np.uint8),
    )
    update_waiting(earlier + np.uint8(40), seen, earlier, seen, waiting, quiet, (0, 10, 0, 40), 18.0, 0.5, 12)
    assert quiet[:, 19:21].all()
    assert not quiet[:, :18].any()
    assert not quiet[:, 22:].any()
