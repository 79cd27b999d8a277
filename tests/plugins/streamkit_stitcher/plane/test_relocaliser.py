"""Registration to keyframes by features."""

from functools import partial

import cv2
import numpy as np
import pytest

from streamkit.geometry.homography import IDENTITY, corners, project
from streamkit_stitcher.plane.keyframe_content import keyframe_content
from streamkit_stitcher.plane.keyframes import KeyframeStore
from streamkit_stitcher.plane.relocaliser import Relocaliser
from streamkit_stitcher.registration.descriptors import describe

SHAPE = (450, 640)


@pytest.fixture
def keyframes(aerial_ground):
    """Keyframes of three places."""
    store = KeyframeStore()
    return [
        store.add(
            partial(keyframe_content, (aerial_ground[y : y + 450, x : x + 640],), 0), IDENTITY, SHAPE, 0
        )
        for x, y in ((200, 300), (1500, 400), (900, 1500))
    ]


def test_a_turned_view_is_found_among_the_keyframes(aerial_ground, keyframes):
    """By 70 degrees, 60 px aside: the likeliest keyframe is its own, and the corners are right to a pixel."""
    turn = np.vstack([cv2.getRotationMatrix2D((320.0, 225.0), 70.0, 1.0), [0, 0, 1]])
    to_key = turn @ np.array([[1, 0, 60.0], [0, 1, 0], [0, 0, 1]])
    to_ground = np.array([[1, 0, 1500.0], [0, 1, 400.0], [0, 0, 1]]) @ to_key
    view = cv2.warpPerspective(
        aerial_ground, to_ground, SHAPE[::-1], flags=cv2.WARP_INVERSE_MAP | cv2.INTER_LINEAR
    )
    relocaliser = Relocaliser()
    (likeliest,) = relocaliser.likeliest(describe(view), keyframes, 1)
    assert likeliest.index == keyframes[1].index
    match = relocaliser.match(describe(view), likeliest)
    assert match is not None
    assert np.abs(project(match.fit.matrix, corners(SHAPE)) - project(to_key, corners(SHAPE))).max() < 1.0
    assert relocaliser.match(describe(view), keyframes[0]) is None
