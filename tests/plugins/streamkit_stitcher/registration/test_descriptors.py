"""Recognising a frame without a guess."""

import cv2
import numpy as np

from streamkit.geometry.homography import corners, project
from streamkit_stitcher.registration.descriptors import describe, recognise


def test_a_frame_is_recognised_after_a_long_way_and_a_turn(aerial_ground):
    """40 % of common ground, turned by a radian and zoomed, is enough for a pixel's accuracy."""
    view = aerial_ground[600:960, 800:1440]
    cos, sin = 1.1 * np.cos(1.0), 1.1 * np.sin(1.0)
    turn = np.array([[cos, -sin, 320.0], [sin, cos, 180.0], [0, 0, 1]])
    centred = turn @ np.array([[1, 0, -1120.0 - 150], [0, 1, -780.0 - 60], [0, 0, 1]])
    moved = cv2.warpPerspective(aerial_ground, centred, (640, 360))
    source, target = describe(view), describe(moved)
    found = recognise(source, target, 20)
    true = centred @ np.array([[1, 0, 800.0], [0, 1, 600.0], [0, 0, 1]])
    assert found is not None
    fit, own, other = found
    error = np.hypot(*(target.points[other] - project(true, source.points[own])).T)
    assert np.median(error) < 1.0
    assert len(own) == len(other) == fit.count


def test_features_lie_where_they_are(ground):
    """Rotated by 180 degrees, as in the next strip of a survey, features have no offset."""
    view = np.ascontiguousarray(ground[300:660, 300:940])
    found = recognise(describe(view), describe(np.ascontiguousarray(view[::-1, ::-1])), 20)
    outline = corners((360, 640))
    assert found is not None
    assert np.hypot(*(project(found[0].matrix, outline) - (639, 359) + outline).T).max() < 0.1


def test_other_ground_is_not_recognised(ground):
    """Frames without common ground give None."""
    assert recognise(describe(ground[:360, :640]), describe(ground[900:1260, 1000:1640]), 20) is None


def test_a_flat_frame_has_no_features():
    """Nothing to describe is no error."""
    flat = describe(np.full((100, 100), 90, np.uint8))
    assert len(flat.points) == 0
    assert recognise(flat, flat, 20) is None
