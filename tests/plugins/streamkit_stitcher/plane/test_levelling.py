"""Levelling of a plane that its first keyframe sees obliquely."""

import numpy as np

from streamkit.geometry.homography import inverse, normalised, scale_change, translation
from streamkit_stitcher.plane.levelling import levelling

SHAPE = (600, 800)


def survey(tilt):
    """Level keyframes in two rows, seen from the plane of a tilted first one."""
    lean = np.eye(3)
    lean[2, :2] = tilt
    level = [translation(np.array([300.0 * column, 400.0 * row])) for row in range(2) for column in range(4)]
    return [normalised(lean @ matrix) for matrix in level]


def test_a_tilted_first_keyframe_is_levelled():
    """All frames have the same scale then, to a thousandth."""
    tilted = survey((2e-4, 1e-4))
    change = levelling(tilted, SHAPE)
    scales = [scale_change(normalised(change @ matrix), SHAPE) for matrix in tilted]
    assert np.ptp(np.log([scale_change(matrix, SHAPE) for matrix in tilted])) > 0.1
    assert np.ptp(np.log(scales)) < 1e-3


def test_a_level_plane_stays():
    """Nothing but a shift of the origin."""
    change = levelling(survey((0.0, 0.0)), SHAPE)
    assert np.allclose(change[:2, :2], np.eye(2), atol=1e-9)
    assert np.allclose(change[2, :2], 0, atol=1e-9)


def test_a_frame_behind_the_horizon_cannot_be_levelled():
    """None, rather than a plane with infinite places."""
    beyond = np.eye(3)
    beyond[2, 0] = -1 / 400
    assert levelling([np.eye(3), inverse(beyond), beyond], SHAPE) is None
