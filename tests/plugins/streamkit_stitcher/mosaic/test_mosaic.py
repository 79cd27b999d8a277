"""The mosaic against the true ground."""

import cv2
import numpy as np
import pytest

from streamkit.geometry.homography import inverse, project, translation
from streamkit_stitcher.mosaic.mosaic import Mosaic
from streamkit_stitcher.plane.settings import ReferenceChoice

SMALL = (360, 640)


def difference_to_ground(mosaic, flight):
    """Median and 95th percentile of |mosaic - true ground| over the covered part, grey levels."""
    frame = mosaic.image()
    left, top, _, _ = mosaic.box
    from_reference = translation(np.array([-left, -top])) @ mosaic.from_plane
    to_ground = flight.to_ground[0] @ inverse(from_reference)
    size = (frame.shape[1], frame.shape[0])
    truth = cv2.warpPerspective(flight.ground, to_ground, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
    covered = cv2.erode((frame > 0).astype(np.uint8), np.ones((5, 5))) > 0
    error = np.abs(frame.astype(float) - truth)[covered]
    return np.median(error), np.percentile(error, 95)


def test_a_mosaic_of_measured_homographies_shows_the_true_ground(ground, make_flight, make_registrar):
    """Placed and joined, the frames match the ground: the error is that of noise, not of doubled edges."""
    flight = make_flight(ground, 24, SMALL, cars=0, laps=0.3)
    registrar, mosaic = make_registrar(reference=ReferenceChoice.FIRST, window=0), Mosaic(64_000_000)
    for frame in flight.frames():
        registered = registrar.register(frame)
        if registered.reference_change is not None:
            mosaic.move_plane(registered.reference_change)
        if registered.keyframe:
            assert mosaic.add(frame, registered.to_reference)
    median, high = difference_to_ground(mosaic, flight)
    assert mosaic.frames > 5
    assert np.count_nonzero(mosaic.image()) > 2 * SMALL[0] * SMALL[1]
    assert median < 3.0
    assert high < 9.0


def test_a_wrong_place_would_show(ground, make_flight):
    """The measure of the test above detects an error of 3 px in one frame."""
    flight = make_flight(ground, 240, SMALL, cars=0, noise=0.0)
    mosaic = Mosaic(64_000_000)
    mosaic.add(flight.frame(0), translation(np.array([3.0, 2.0])))
    assert difference_to_ground(mosaic, flight)[1] > 9.0


def test_a_long_flight_loses_resolution_and_not_ground(ground):
    """At its last limit the mosaic is halved and still covers everything, at the right position."""
    mosaic = Mosaic(20_000)
    for begin in range(0, 1300, 200):
        assert mosaic.add(ground[400:760, begin : begin + 640], translation(np.array([float(begin), 0.0])))
    frame = mosaic.image()
    assert mosaic.scale == 0.5
    assert frame.size <= 16 * 20_000
    assert 4 * np.count_nonzero(frame) == pytest.approx(360 * 1840, rel=0.04)
    left, top, _, _ = mosaic.box
    from_reference = translation(np.array([-left, -top])) @ mosaic.from_plane
    truth = cv2.resize(ground[400:760, :1840], (920, 180), interpolation=cv2.INTER_AREA)
    column, row = project(from_reference, np.array([[0.5, 0.5]]))[0].round().astype(int)
    part = frame[row : row + 179, column : column + 919]
    assert np.abs(part[4:-4, 4:-4].astype(float) - truth[4:175, 4:915]).mean() < 2.0


def test_gaps_are_filled_without_painting_over(ground):
    """What only fills gaps leaves the middle of the frames alone and reaches beyond them."""
    mosaic = Mosaic(64_000_000)
    mosaic.add(ground[400:760, :640], np.eye(3))
    mosaic.add(np.full(SMALL, 255, np.uint8), translation(np.array([300.0, 0.0])), fills_gaps=True)
    frame = mosaic.image()
    assert np.array_equal(frame[100:260, 100:560], ground[500:660, 100:560])
    assert (frame[50:310, 660:900] == 255).all()


@pytest.mark.parametrize(
    "place",
    [
        np.full((3, 3), np.nan),
        np.diag([9.0, 9.0, 1.0]),
        np.diag([-1.0, 1.0, 1.0]),
        translation(np.array([1e9, 0.0])),
    ],
    ids=["nan", "huge", "mirrored", "far"],
)
def test_degenerate_homographies_are_refused(ground, place):
    """A frame that cannot be placed never smears the mosaic."""
    mosaic = Mosaic(64_000_000)
    mosaic.add(ground[:360, :640], np.eye(3))
    before = mosaic.image().copy()
    assert not mosaic.add(ground[:360, :640], place)
    assert np.array_equal(mosaic.image(), before)
    assert mosaic.frames == 1


def test_colour_and_grey_may_follow_each_other(ground):
    """A later frame is turned into what the first one was."""
    colour = cv2.cvtColor(ground[:360, :640], cv2.COLOR_GRAY2BGR)
    for first, second, shape in ((colour, ground[:360, :640], 3), (ground[:360, :640], colour, 2)):
        mosaic = Mosaic(64_000_000)
        assert mosaic.add(first, np.eye(3))
        assert mosaic.add(second, translation(np.array([100.0, 0.0])))
        assert mosaic.image().ndim == shape


def test_an_empty_mosaic_has_no_frame():
    """Before the first frame there is None."""
    assert Mosaic(1_000_000).image() is None


def test_what_drives_shows_once_on_a_straight_flight():
    """Two frames that lie side by side mix along a short seam only, not over half of what they share."""
    first, second = (np.full((360, 640), 100, np.uint8) for _ in range(2))
    mosaic = Mosaic(64_000_000)
    mosaic.add(first, np.eye(3))
    mosaic.add(second + 100, translation(np.array([140.0, 0.0])))
    shared = mosaic.image()[:, 140:640].astype(int)
    mixed = (shared > 110) & (shared < 190)
    assert 0.01 < mixed.mean() < 0.15


@pytest.mark.parametrize("sign", [1, -1])
def test_a_frame_of_a_bent_plane_is_not_painted(ground, make_flight, sign):
    """A frame whose far side is stretched leaves the mosaic as it was."""
    flight = make_flight(ground, 2, SMALL, cars=0, noise=0.0)
    mosaic = Mosaic(64_000_000)
    assert mosaic.add(flight.frame(0), np.eye(3))
    box = mosaic.box
    tilted = np.eye(3)
    tilted[2, 0] = sign * (0.6 if sign < 0 else 1.5) / SMALL[1]
    assert not mosaic.add(flight.frame(1), tilted)
    assert (mosaic.frames, mosaic.box) == (1, box)
    tilted[2, 0] = 0.3 / SMALL[1]
    assert mosaic.add(flight.frame(1), tilted)
