"""Choice of keyframes, and return to earlier ones."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from streamkit.geometry.homography import IDENTITY, corner_shift, normalised, translation
from streamkit_stitcher.plane.anchoring import KeyframeAnchor
from streamkit_stitcher.plane.frame_registration import OK_STD
from streamkit_stitcher.plane.keyframe_content import LEVELS
from streamkit_stitcher.plane.placement import Placement
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
    found = anchor.place(images, None, Placement(predicted, 0.0, motion=motion), 0.0, is_photograph=False)
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


def matched(anchor, ground, left, share, error):
    """A frame whose left edge is at `left`, and its match with such a share and predicted error."""
    images = view(ground, left)
    found = anchor.place(images, None, Placement(shift(left), 0.0), 0.0, is_photograph=False)
    assert found.match is not None
    return images, replace(found, match=replace(found.match, share=share, corner_std=error))


@pytest.mark.parametrize(
    ("left", "share", "error", "key"),
    [
        (60, 0.9, 0.7, True),
        (60, 0.9, 0.5, False),  # fits well
        (60, 0.9, 1.1, False),  # would hand on an error that is not ok
        (60, 0.8, 0.7, False),  # the new one would show movers
        (20, 0.9, 0.7, False),  # a keyframe from here would be no better
    ],
)
def test_a_keyframe_that_fits_badly_is_replaced_while_the_frame_is_ok(
    anchor, ground, left, share, error, key
):
    """Over relief patches leave the plane long before they leave the frame."""
    assert anchor.keep(*matched(anchor, ground, left, share, error)).is_keyframe is key


@pytest.mark.parametrize(("error", "key"), [(0.7, False), (0.05, True)])
def test_an_earlier_keyframe_takes_over_only_where_it_fits_better(anchor, ground, error, key):
    """Else two that fit about as badly would take turns."""
    anchor.add(view(ground, 400), shift(400.0))
    found = anchor.keep(*matched(anchor, ground, 140, 0.9, error))
    assert found.is_keyframe is key
    assert anchor.keyframes.active.index == (2 if key else 0)


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


def crowded(images, seed, columns):
    """The frame, hidden but for some columns by what no other frame shows."""
    frame = images[0].copy()
    random = np.random.default_rng(seed)
    frame[:, columns:] = cv2.resize(
        random.integers(0, 255, (90, 160), dtype=np.uint8), (640, 360), interpolation=cv2.INTER_CUBIC
    )[:, columns:]
    return pyramid((frame,), LEVELS)


def test_a_crowd_does_not_carry_the_camera_off(anchor, ground):
    """Where a tenth of the scene is seen, the area decides, not the corners of a crowd 12 px off."""
    frame = crowded(view(ground, 4), 1, 64)
    near = anchor.match_near(frame, shift(3.0), 0.3, shift(4.0))
    assert near is not None
    assert near.share < 0.12
    crowd = Placement(shift(16.0), 0.5, motion=HOMOGRAPHY)
    found = anchor.place(frame, near, crowd, 0.3, is_photograph=False)
    assert found.match is not None
    assert corner_shift(shift(-4.0) @ found.to_reference, (360, 640)) < 3 * found.std


def test_the_corners_lead_back_to_the_scene(anchor, ground):
    """The motion of the corners is taken where the expected one explains nothing of the area."""
    frame = crowded(view(ground, 40), 2, 128)
    lost = anchor.match_near(frame, shift(0.0), 0.3, shift(0.0))
    corners = Placement(shift(41.0), 0.5, motion=HOMOGRAPHY)
    found = anchor.place(frame, lost, corners, 0.3, is_photograph=False)
    assert found.match is not None
    assert corner_shift(shift(-40.0) @ found.to_reference, (360, 640)) < 3 * found.std


def test_a_doubtful_frame_that_leaves_the_keyframe_is_none_at_once(anchor, ground):
    """A blurred frame may be matched with a wrong tilt; the twelfth in a row becomes a keyframe."""
    sure = anchor.place(view(ground, 60), None, Placement(shift(61.0), 0.0, motion=HOMOGRAPHY), 0.0, False)
    doubtful = replace(sure, to_reference=shift(300.0), match=replace(sure.match, share=0.1))
    made = [anchor.keep(other(ground), doubtful).is_keyframe for _ in range(12)]
    assert made == [False] * 11 + [True]


@pytest.mark.parametrize(("error", "kept"), [(0.45, 0.0), (0.6, 0.6)])
def test_a_keyframe_keeps_an_error_that_counts(anchor, ground, error, kept):
    """Frames that are measured against it are off by as much, and their prediction says so."""
    sure = anchor.place(view(ground, 250), None, Placement(shift(251.0), 0.0, motion=HOMOGRAPHY), 0.0, False)
    anchor.keep(view(ground, 250), replace(sure, field_error=error, is_due=True))
    assert anchor.keyframes.active.corner_std == pytest.approx(kept, abs=0.05)
    near = Placement(shift(261.0), 0.0, motion=HOMOGRAPHY)
    assert anchor.place(view(ground, 260), None, near, 0.0, False).std == pytest.approx(kept, abs=0.2)


def test_fields_that_jump_apart_are_a_keyframe_only_if_nothing_better_comes(anchor, ground):
    """Every frame that is measured against it would be as far off: that is part of their predicted error."""
    sure = anchor.place(view(ground, 250), None, Placement(shift(251.0), 0.0, motion=HOMOGRAPHY), 0.0, False)
    combed = replace(sure, field_error=3.0)
    made = [anchor.keep(view(ground, 250), combed).is_keyframe for _ in range(12)]
    assert made == [False] * 11 + [True]
    assert anchor.keyframes.active.corner_std == pytest.approx(3.0, abs=0.1)
    assert anchor.keep(view(ground, 250), replace(sure, is_due=True)).is_keyframe
    assert anchor.keyframes.active.corner_std == 0.0


def test_a_keyframe_is_as_doubtful_as_the_one_that_it_is_tied_to(ground):
    """However precise the tie is: a chain of precise ties hid that the first of them was lost."""
    anchor = KeyframeAnchor(PlaneSettings(), 0)
    anchor.add(view(ground, 0), IDENTITY, corner_std=30.0)
    placed = anchor.place(
        view(ground, 250), None, Placement(shift(251.0), 0.0, motion=HOMOGRAPHY), 0.0, False
    )
    assert anchor.keep(view(ground, 250), replace(placed, is_due=True)).is_keyframe
    assert anchor.keyframes.active.corner_std == pytest.approx(30.0, abs=0.1)
    anchor.keyframes.close()


def test_a_doubtful_frame_that_becomes_a_keyframe_is_placed_by_its_best_tie(anchor, ground):
    """Whose predicted error it takes: not the place that was doubted with the error of another one."""
    sure = anchor.place(view(ground, 60), None, Placement(shift(61.0), 0.0, motion=HOMOGRAPHY), 0.0, False)
    doubtful = replace(sure, to_reference=shift(62.0), std=9.0, is_due=True)
    kept = anchor.keep(view(ground, 60), doubtful)
    assert kept.is_keyframe
    assert kept.to_reference == pytest.approx(shift(60.0), abs=0.1)
    assert anchor.keyframes.active.corner_std == 0.0


def test_a_camera_returns_from_a_doubtful_keyframe_to_an_earlier_one(anchor, ground):
    """Frames that continue on one that was taken 400 px off also show the first, whose place is known."""
    anchor.add(view(ground, 60), shift(460.0), corner_std=300.0)
    kept = []
    for left in range(62, 94, 2):
        images = view(ground, left)
        found = anchor.place(images, None, Placement(shift(left + 401.0), 300.0), 300.0, False)
        assert found.match is not None
        kept.append(anchor.keep(images, found))
    assert [found.change is None for found in kept] == [True] * 15 + [False]
    assert kept[-1].to_reference == pytest.approx(shift(92.0), abs=0.3)
    assert kept[-1].change == pytest.approx(shift(-400.0), abs=0.3)
    assert anchor.keyframes.active.index == 0


def test_a_frame_whose_place_is_unknown_is_no_keyframe(anchor, ground):
    """Frames that match it would be `ok`, wherever it is."""
    unknown = Placement(shift(500.0), 70.0, motion=HOMOGRAPHY, is_adrift=True)
    assert not any(anchor.keep(other(ground), unknown).is_keyframe for _ in range(20))
    assert anchor.keep(other(ground), replace(unknown, is_adrift=False)).is_keyframe


@pytest.fixture
def matched_in_a_corner(ground):
    """An anchor, and a frame that overlaps its keyframe in a corner."""
    black = np.zeros((360, 640), np.uint8)
    key, frame = black.copy(), black.copy()
    key[237:, 420:] = ground[620:743, 380:600]
    frame[237:, 420:] = ground[612:735, 370:590]
    anchor = KeyframeAnchor(PlaneSettings(), 0)
    anchor.add(pyramid((key,), LEVELS), IDENTITY)
    frame = pyramid((frame,), LEVELS)
    yield anchor, frame
    anchor.keyframes.close()


@pytest.mark.parametrize("consecutive", [False, True])
def test_a_frame_matched_in_a_corner_is_registered_only_if_consecutive(matched_in_a_corner, consecutive):
    """The corner leaves the rest unknown: of a video it is not measured, of photographs in a row not sure."""
    anchor, frame = matched_in_a_corner
    found = anchor.recognise(frame, consecutive)
    assert found.is_recognised
    assert (found.match is not None) is consecutive
    placed = anchor.keep(frame, replace(found, motion=HOMOGRAPHY))
    assert placed.std > OK_STD
    assert consecutive or not placed.is_keyframe


@pytest.mark.parametrize("is_video", [False, True])
def test_a_video_does_not_continue_another_plane_by_a_match_in_a_corner(
    matched_in_a_corner, ground, is_video
):
    """More ties may join the two planes; photographs are adjusted together in the end."""
    anchor, frame = matched_in_a_corner
    anchor.keyframes.plane, anchor.is_video = 1, is_video
    anchor.add(other(ground), IDENTITY)
    found = anchor.recognise(frame, False)
    assert (found.is_elsewhere, found.is_recognised) == (is_video, not is_video)
    assert anchor.keyframes.plane == (1 if is_video else 0)
