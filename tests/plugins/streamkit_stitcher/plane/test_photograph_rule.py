"""Photographs against frames of a video."""

import numpy as np
import pytest

from streamkit.geometry.homography import IDENTITY, translation
from streamkit_stitcher.plane.photograph_rule import PhotographRule
from streamkit_stitcher.registration.motion_models import MotionModel
from streamkit_stitcher.registration.pairwise import PairwiseMotion, working_image

SHAPE = (360, 640)
UNKNOWN = PairwiseMotion(IDENTITY, None, False, 0, 0, 0.0)


@pytest.fixture
def images(ground):
    """Two views of different ground."""
    return [working_image((ground[y : y + 360, 100:740],), 0, 100) for y in (100, 900)]


def test_a_view_of_other_ground_is_a_photograph(images):
    """Unless frames were followed before, or it is like the last one, or its motion is known and small."""
    rule = PhotographRule(SHAPE)
    assert rule.is_photograph(*images, UNKNOWN)
    assert not rule.is_photograph(images[0], images[0], UNKNOWN)
    near = PairwiseMotion(translation(np.array([20.0, 0.0])), MotionModel.HOMOGRAPHY, False, 80, 80, 0.1)
    assert not rule.is_photograph(*images, near)
    rule.is_video = True
    assert not rule.is_photograph(*images, UNKNOWN)


def test_a_jump_is_a_seventh_of_the_width():
    """640 px wide: 90 px are none, 100 px are one."""
    rule = PhotographRule(SHAPE)
    assert not rule.is_jump(translation(np.array([90.0, 0.0])))
    assert rule.is_jump(translation(np.array([0.0, 100.0])))
