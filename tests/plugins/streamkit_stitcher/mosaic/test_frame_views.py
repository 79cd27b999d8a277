"""A plane's position on the earth by the views of its frames."""

import math

import cv2
import numpy as np
import pytest

from streamkit.geometry.earth import metres_per_degree
from streamkit.geometry.homography import centre, inverse, normalised
from streamkit_stitcher.mosaic.frame_views import FrameView, focal_length, georeferenced
from streamkit_stitcher.mosaic.georeference import GroundView

SHAPE = (900, 1200)
FOCAL = 900.0
NORTH_M, EAST_M = metres_per_degree(46.0)


def view(number, place_m, focal_px=FOCAL):
    """A frame whose middle is taken to lie below its camera."""
    place = np.array([46.0 + place_m[1] / NORTH_M, 8.0 + place_m[0] / EAST_M])
    ground = GroundView(centre(SHAPE)[np.newaxis], place[np.newaxis], 3.0, None, focal_px, place)
    return FrameView(number, np.eye(3), SHAPE, ground)


@pytest.fixture
def survey():
    """Frames 100 m above the ground that lean by 5 deg in any direction: keyframes to plane, and views."""
    random = np.random.default_rng(5)
    middle = centre(SHAPE)
    lens = np.array([[FOCAL, 0, middle[0]], [0, FOCAL, middle[1]], [0, 0, 1]])
    homographies, views = {}, []
    for number in range(12):
        x, y = 40.0 * (number % 4), 40.0 * (number // 4)
        angle = random.uniform(0, 2 * math.pi)
        lean = np.radians(5) * np.array([math.cos(angle), math.sin(angle), 0])
        rotation = cv2.Rodrigues(lean)[0] @ np.diag([1.0, -1.0, -1.0])
        to_pixels = lens @ rotation @ np.array([[1, 0, -x], [0, 1, -y], [0, 0, -100]])
        # The plane has pixels of 10 cm, y down.
        to_plane = np.diag([10.0, -10.0, 1.0]) @ inverse(normalised(to_pixels))
        homographies[number] = normalised(to_plane)
        views.append(view(number, (x, y)))
    return homographies, views


def test_cameras_are_where_the_adjustment_has_them(survey):
    """The middles of frames that lean by 5 deg lie 9 m from below their cameras."""
    by_middles, _ = georeferenced(*survey, 30.0)
    by_cameras, _ = georeferenced(*survey, 30.0, FOCAL)
    assert by_middles.median_error_m > 3
    assert by_cameras.median_error_m < 0.1
    assert by_cameras.error_m < by_middles.error_m


def test_a_focal_length_is_that_of_all_frames():
    """None where a lens zooms, or where it is unknown for some of the frames with a position."""
    assert focal_length([view(0, (0, 0)), view(1, (9, 0), 1.01 * FOCAL)]) == pytest.approx(1.005 * FOCAL)
    assert focal_length([view(0, (0, 0)), view(1, (9, 0), 1.5 * FOCAL)]) == 0
    assert focal_length([view(0, (0, 0)), view(1, (9, 0), 0.0)]) == 0
    assert focal_length([view(0, (0, 0)), FrameView(1, np.eye(3), SHAPE, "no position")]) == FOCAL
    assert focal_length([]) == 0
