"""How well the place of the last frames is known."""

from types import SimpleNamespace

import numpy as np
import pytest

from streamkit.geometry.homography import translation
from streamkit_stitcher.plane.localisation import Localisation
from streamkit_stitcher.plane.placement import Placement

SHAPE = (90, 160)
FAR = 20.0  # px, more than ties correct at this width


def moved(x):
    """A shift to the right."""
    return translation(np.array([x, 0.0]))


def motion(std, model="homography", is_cut=False):
    """A motion of the corners with a predicted error, px."""
    return SimpleNamespace(matrix=moved(2.0), model=model, is_cut=is_cut, corner_std=lambda _: std)


def test_a_lost_frame_is_where_the_motion_leads_and_less_sure():
    """Each adds its own step and a pixel to the predicted error; a placed frame ends that."""
    place = Localisation(SHAPE)
    for _ in range(8):
        place.place(moved(4.0), 0.5, is_measured=True)
    assert place.is_known
    first = place.lost_place(moved(100.0))
    second = place.lost_place(first.to_reference)
    assert 100.0 < first.to_reference[0, 2] < second.to_reference[0, 2]
    assert 0.5 + 1.0 < first.std < second.std
    assert place.predicted == 2
    place.place(moved(1.0), 0.4, is_measured=True)
    assert (place.predicted, place.std) == (0, 0.4)


def test_a_frame_without_a_motion_is_predicted():
    """Where the corners lead nowhere, the velocity does; the error adds to that of the previous frame."""
    place = Localisation(SHAPE)
    place.place(moved(0.0), 0.5, is_measured=True)
    known = place.predicted_by(motion(0.25), moved(10.0), moved(9.0))
    unknown = place.predicted_by(motion(0.25, model=None), moved(10.0), moved(9.0))
    assert (known.to_reference[0, 2], known.std) == (11.0, 0.75)
    assert unknown.to_reference[0, 2] == pytest.approx(10.0)
    assert unknown.std > known.std


def test_a_step_that_may_be_far_off_leaves_the_place_unknown_until_a_match_is_better():
    """A large error that has added up in small steps does not."""
    place, doubtful = Localisation(SHAPE), Placement(np.eye(3), FAR)
    assert not place.stays_adrift(doubtful, motion(0.5))
    assert not place.is_adrift
    assert not place.stays_adrift(doubtful, motion(FAR))
    assert place.is_adrift
    assert place.stays_adrift(doubtful, motion(0.5))
    assert not place.stays_adrift(Placement(np.eye(3), 0.5), motion(0.5))
    assert not place.is_adrift


def test_features_are_tried_more_rarely_where_the_motion_is_known():
    """At every second frame first, later at every sixteenth; at a cut always."""
    place, tried = Localisation(SHAPE), []
    for index in range(40):
        if place.is_search_due(motion(0.5)):
            tried.append(index)
        place.place(moved(2.0), 2.0, is_measured=False)
    assert tried == [0, 2, 4, 16, 32]
    assert place.is_search_due(motion(0.5, is_cut=True))


def test_frames_are_lost_for_a_second():
    """After 25 that nothing places, a plane begins."""
    place = Localisation(SHAPE)
    assert [place.lose() for _ in range(26)] == [False] * 25 + [True]


def test_the_corners_are_searched_rarely_once_they_have_confirmed_many_weak_matches():
    """One that places a frame better, a certain frame or an unknown place ends that."""
    place = Localisation(SHAPE)
    for _ in range(8):
        assert place.is_corner_search_due()
        place.searched(is_vain=True)
    assert [place.is_corner_search_due() for _ in range(4)] == [False, False, False, True]
    place.searched(is_vain=True)
    assert not place.is_corner_search_due()
    place.is_adrift = True
    assert place.is_corner_search_due()
    place.is_adrift = False
    place.place(moved(0.0), 0.5, is_measured=True)
    assert place.is_corner_search_due()
    for _ in range(9):
        place.searched(is_vain=True)
    place.searched(is_vain=False)
    assert place.is_corner_search_due()
