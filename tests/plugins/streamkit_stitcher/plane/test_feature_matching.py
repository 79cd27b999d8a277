"""Registration to keyframes by features."""

from functools import cache, partial

import cv2
import numpy as np
import pytest

from streamkit.geometry.homography import IDENTITY, corners, project
from streamkit_stitcher.plane.feature_matching import likeliest, match_by_features
from streamkit_stitcher.plane.keyframe_content import keyframe_content
from streamkit_stitcher.plane.keyframes import Keyframe
from streamkit_stitcher.registration.descriptors import describe

SHAPE = (450, 640)


@pytest.fixture
def keyframes(aerial_ground):
    """Keyframes of three places."""
    return [
        Keyframe(
            index,
            IDENTITY,
            SHAPE,
            1,
            cache(partial(keyframe_content, (aerial_ground[y : y + 450, x : x + 640],), 0)),
        )
        for index, (x, y) in enumerate(((200, 300), (1500, 400), (900, 1500)))
    ]


def test_a_turned_view_is_found_among_the_keyframes(aerial_ground, keyframes):
    """By 70 degrees, 60 px aside: the likeliest keyframe is its own, and the corners are right to a pixel."""
    turn = np.vstack([cv2.getRotationMatrix2D((320.0, 225.0), 70.0, 1.0), [0, 0, 1]])
    to_key = turn @ np.array([[1, 0, 60.0], [0, 1, 0], [0, 0, 1]])
    to_ground = np.array([[1, 0, 1500.0], [0, 1, 400.0], [0, 0, 1]]) @ to_key
    view = cv2.warpPerspective(
        aerial_ground, to_ground, SHAPE[::-1], flags=cv2.WARP_INVERSE_MAP | cv2.INTER_LINEAR
    )
    (found,) = likeliest(describe(view), keyframes, 1)
    assert found.index == keyframes[1].index
    match = match_by_features(describe(view), found)
    assert match is not None
    assert np.abs(project(match.fit.matrix, corners(SHAPE)) - project(to_key, corners(SHAPE))).max() < 1.0
    assert match_by_features(describe(view), keyframes[0]) is None


def keyframe_of(frame):
    """A frame as a keyframe."""
    content = cache(partial(keyframe_content, (np.ascontiguousarray(frame),), 0))
    return Keyframe(0, IDENTITY, frame.shape, 1, content)


def test_a_frame_is_recognised_after_a_long_way_and_a_turn(aerial_ground):
    """40 % of common ground, turned by a radian and zoomed, is enough for a pixel's accuracy."""
    view = aerial_ground[600:960, 800:1440]
    cos, sin = 1.1 * np.cos(1.0), 1.1 * np.sin(1.0)
    turn = np.array([[cos, -sin, 320.0], [sin, cos, 180.0], [0, 0, 1]])
    centred = turn @ np.array([[1, 0, -1120.0 - 150], [0, 1, -780.0 - 60], [0, 0, 1]])
    moved = cv2.warpPerspective(aerial_ground, centred, (640, 360))
    found = match_by_features(describe(view), keyframe_of(moved))
    true = centred @ np.array([[1, 0, 800.0], [0, 1, 600.0], [0, 0, 1]])
    assert found is not None
    error = np.hypot(*(found.key_points - project(true, found.frame_points)).T)
    assert np.median(error) < 1.0
    assert len(found.patches) == len(found.frame_points) == found.fit.count


def test_features_lie_where_they_are(ground):
    """Rotated by 180 degrees, as in the next strip of a survey, features have no offset."""
    view = np.ascontiguousarray(ground[300:660, 300:940])
    found = match_by_features(describe(view), keyframe_of(view[::-1, ::-1]))
    outline = corners((360, 640))
    assert found is not None
    assert np.hypot(*(project(found.fit.matrix, outline) - (639, 359) + outline).T).max() < 0.1


def test_other_ground_is_not_recognised(ground):
    """Frames without common ground give None."""
    other = keyframe_of(ground[900:1260, 1000:1640])
    assert match_by_features(describe(ground[:360, :640]), other) is None


def test_a_flat_frame_has_no_features():
    """Nothing to describe is no error."""
    flat = np.full((100, 100), 90, np.uint8)
    assert len(describe(flat).points) == 0
    assert match_by_features(describe(flat), keyframe_of(flat)) is None
