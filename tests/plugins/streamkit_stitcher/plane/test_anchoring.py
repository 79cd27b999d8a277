"""Choice of keyframes, and return to earlier ones."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from streamkit.geometry.homography import IDENTITY, normalised, translation
from streamkit_stitcher.plane.anchoring import KeyframeAnchor, Placement
from streamkit_stitcher.plane.frame_registration import OK_STD
from streamkit_stitcher.plane.keyframe_content import LEVELS
from streamkit_stitcher.plane.settings import PlaneSettings
from streamkit_stitcher.registration.motion_models import MotionModel
from streamkit_stitcher.registration.pairwise import PairwiseMotion
from streamkit_stitcher.registration.patches import pyramid


def view(ground, left):
    """The frame whose left edge is at `left`, and its halvings."""
    return pyramid((ground[400:760, left : left + 640],), LEVELS)


def other(ground):
    """A frame of other ground, and its halvings."""
    return pyramid((ground[1000:1360, 1200:1840],), LEVELS)


HOMOGRAPHY = PairwiseMotion(IDENTITY, MotionModel.HOMOGRAPHY, False, 100, 90, 0.1)
GUESS = PairwiseMotion(IDENTITY, None, False, 100, 10, 0.1)


def place(anchor, images, predicted, motion=HOMOGRAPHY):
    """Places a frame, and chooses keyframes."""
    found = anchor.place(images, Placement(predicted, 0.0, motion=motion), is_photograph=False)
    return anchor.keep(images, found)


def shift(pixels):
    """The homography of a shift along x."""
    return translation(np.array([pixels, 0.0]))


@pytest.fixture
def anchor(ground):
    """An anchor on a keyframe at 0."""
    anchor = KeyframeAnchor(PlaneSettings(), 0)
    anchor.add(view(ground, 0), IDENTITY)
    yield anchor
    anchor.keyframes.close()


def test_a_prediction_is_corrected(anchor, ground):
    """A prediction 2 px off is corrected."""
    placed = place(anchor, view(ground, 60), shift(62.0))
    assert placed.match is not None
    assert not placed.is_keyframe
    assert placed.to_reference == pytest.approx(shift(60.0), abs=0.1)


def test_leaving_the_keyframe_makes_another(anchor, ground):
    """Below 65 % overlap the frame becomes a keyframe, registered to the previous one."""
    placed = place(anchor, view(ground, 260), shift(261.0))
    assert placed.is_keyframe
    assert placed.to_reference == pytest.approx(shift(260.0), abs=0.1)


@pytest.mark.parametrize(("lean", "key"), [(3e-4, False), (7e-4, True)])
def test_a_frame_seen_much_more_aslant_is_a_keyframe(anchor, ground, lean, key):
    """An oblique camera that turns keeps its overlap, but the perspective changes."""
    middle = translation(np.array([320.0, 180.0]))
    across = np.array([[1.0, 0, 0], [0, 1.0, 0], [lean, 0, 1.0]])
    there = normalised(middle @ across @ np.linalg.inv(middle))
    seen = cv2.warpPerspective(
        ground,
        translation(np.array([0.0, 400.0])) @ there,
        (640, 360),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
    )
    placed = place(anchor, pyramid((np.asarray(seen, dtype=np.uint8),), LEVELS), there)
    assert placed.match is not None
    assert placed.is_keyframe == key


def test_coming_back_hands_over_to_the_earlier_keyframe(anchor, ground):
    """Where an earlier keyframe overlaps enough, it takes over and undoes the drift."""
    for left in (200, 260, 400, 520):
        place(anchor, view(ground, left), shift(float(left)))
    drifted = shift(96.0)
    placed = place(anchor, view(ground, 90), drifted)
    assert placed.change is not None
    assert not placed.is_keyframe
    assert placed.to_reference == pytest.approx(shift(90.0), abs=0.1)


def test_an_untrusted_place_never_makes_a_keyframe(anchor, ground):
    """Ground that matches nothing, carried on by a guess, is passed on as it is."""
    for _ in range(5):
        placed = place(anchor, other(ground), shift(30.0), GUESS)
        assert placed.match is None
        assert not placed.is_keyframe
        assert np.array_equal(placed.to_reference, shift(30.0))


@pytest.mark.parametrize(("carried", "misses"), [(300.0, 3), (30.0, 12)])
def test_a_lost_keyframe_is_replaced(anchor, ground, carried, misses):
    """Other ground becomes a keyframe: soon where the old one was left, late where it should be seen."""
    made = [place(anchor, other(ground), shift(carried)).is_keyframe for _ in range(misses)]
    assert made == [False] * (misses - 1) + [True]


def test_a_keyframe_is_not_made_where_the_way_there_was_a_guess(anchor, ground):
    """One untrusted step makes all that follow it a guess, until a keyframe is seen again."""
    frame = other(ground)
    made = [
        place(anchor, frame, shift(300.0), HOMOGRAPHY if step else GUESS).is_keyframe for step in range(8)
    ]
    assert not any(made)


@pytest.fixture
def matched_in_a_corner(ground):
    """An anchor, a frame that overlaps its keyframe in a corner, and the match."""
    black = np.zeros((360, 640), np.uint8)
    key, frame = black.copy(), black.copy()
    key[237:, 420:] = ground[620:743, 380:600]
    frame[237:, 420:] = ground[612:735, 370:590]
    anchor = KeyframeAnchor(PlaneSettings(), 0)
    anchor.add(pyramid((key,), LEVELS), IDENTITY)
    frame = pyramid((frame,), LEVELS)
    seen = anchor.recognise(frame)
    assert seen is not None
    assert seen.deviation > 1.0
    yield anchor, frame, seen
    anchor.keyframes.close()


@pytest.mark.parametrize("consecutive", [False, True])
def test_a_frame_matched_in_a_corner_is_registered_only_if_consecutive(matched_in_a_corner, consecutive):
    """The corner leaves the rest unknown: of a video it is not measured, of photographs in a row not sure."""
    anchor, frame, seen = matched_in_a_corner
    found = anchor.place_recognised(frame, seen, consecutive)
    assert (found.match is not None) is consecutive
    placed = anchor.keep(frame, replace(found, motion=HOMOGRAPHY))
    assert placed.std > OK_STD
    assert consecutive or not placed.is_keyframe
