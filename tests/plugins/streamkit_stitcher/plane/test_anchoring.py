"""Choice of keyframes, and return to earlier ones."""

import cv2
import numpy as np
import pytest

from streamkit.geometry.homography import IDENTITY, normalised, translation
from streamkit_stitcher.plane.anchoring import KeyframeAnchor
from streamkit_stitcher.plane.settings import PlaneSettings


def view(ground, left):
    """The frame whose left edge is at `left`, as the only level of a pyramid."""
    return (ground[400:760, left : left + 640],)


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
    placed = anchor.register(view(ground, 60), shift(62.0), trusted=True)
    assert placed.measured
    assert not placed.keyframe
    assert placed.to_reference == pytest.approx(shift(60.0), abs=0.1)


def test_leaving_the_keyframe_makes_another(anchor, ground):
    """Below 65 % overlap the frame becomes a keyframe, registered to the previous one."""
    placed = anchor.register(view(ground, 260), shift(261.0), trusted=True)
    assert placed.keyframe
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
    placed = anchor.register((np.asarray(seen, dtype=np.uint8),), there, trusted=True)
    assert placed.measured
    assert placed.keyframe == key


def test_coming_back_hands_over_to_the_earlier_keyframe(anchor, ground):
    """Where an earlier keyframe overlaps enough, it takes over and undoes the drift."""
    for left in (200, 260, 400, 520):
        anchor.register(view(ground, left), shift(float(left)), trusted=True)
    drifted = shift(96.0)
    placed = anchor.register(view(ground, 90), drifted, trusted=True)
    assert placed.reference_change is not None
    assert not placed.keyframe
    assert placed.to_reference == pytest.approx(shift(90.0), abs=0.1)


def test_an_untrusted_place_never_makes_a_keyframe(anchor, ground):
    """Ground that matches nothing, carried on by a guess, is passed on as it is."""
    for _ in range(5):
        placed = anchor.register((ground[1000:1360, 1200:1840],), shift(30.0), trusted=False)
        assert not placed.measured
        assert not placed.keyframe
        assert np.array_equal(placed.to_reference, shift(30.0))


@pytest.mark.parametrize(("carried", "misses"), [(300.0, 3), (30.0, 12)])
def test_a_lost_keyframe_is_replaced(anchor, ground, carried, misses):
    """Other ground becomes a keyframe: soon where the old one was left, late where it should be seen."""
    made = [
        anchor.register((ground[1000:1360, 1200:1840],), shift(carried), trusted=True).keyframe
        for _ in range(misses)
    ]
    assert made == [False] * (misses - 1) + [True]


def test_a_keyframe_is_not_made_where_the_way_there_was_a_guess(anchor, ground):
    """One untrusted step makes all that follow it a guess, until a keyframe is seen again."""
    other = (ground[1000:1360, 1200:1840],)
    made = [anchor.register(other, shift(300.0), trusted=step > 0).keyframe for step in range(8)]
    assert not any(made)


@pytest.fixture
def matched_in_a_corner(ground):
    """An anchor, a frame that overlaps its keyframe in a corner, and the match."""
    black = np.zeros((360, 640), np.uint8)
    key, frame = black.copy(), black.copy()
    key[237:, 420:] = ground[620:743, 380:600]
    frame[237:, 420:] = ground[612:735, 370:590]
    anchor = KeyframeAnchor(PlaneSettings(), 0)
    anchor.add((key,), IDENTITY)
    seen = anchor.recognise((frame,))
    assert seen is not None
    assert seen.deviation > 1.0
    yield anchor, frame, seen
    anchor.keyframes.close()


@pytest.mark.parametrize("consecutive", [False, True])
def test_a_frame_matched_in_a_corner_is_registered_only_if_consecutive(matched_in_a_corner, consecutive):
    """The corner leaves the rest unknown: of a video it is not measured, of photographs in a row not sure."""
    anchor, frame, seen = matched_in_a_corner
    placed = anchor.register((frame,), shift(0.0), trusted=True, recognised=seen, consecutive=consecutive)
    assert placed.measured is consecutive
    assert not placed.fixes_whole_frame
    assert consecutive or not placed.keyframe
