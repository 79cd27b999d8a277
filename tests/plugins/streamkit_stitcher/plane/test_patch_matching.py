"""Registration to a keyframe by its patches."""

import cv2
import numpy as np
import pytest

from streamkit.geometry.homography import IDENTITY, project, translation
from streamkit_stitcher.plane.keyframe_content import LEVELS, keyframe_content, patch_level
from streamkit_stitcher.plane.keyframes import Keyframe
from streamkit_stitcher.plane.patch_matching import PatchMatcher
from streamkit_stitcher.registration.model_selection import MotionRule
from streamkit_stitcher.registration.motion_models import FitLimits, MotionModel
from streamkit_stitcher.registration.patches import pyramid

LIMITS = FitLimits(ransac_threshold=2.0, max_step=1.0)


def stored(frame, level):
    """A frame as a keyframe, with corners of its `level`."""
    content = keyframe_content(pyramid((frame,), level + 1), level)
    return Keyframe(0, IDENTITY, frame.shape, 2**level, lambda: content)


@pytest.fixture(scope="module")
def flight(ground, make_flight):
    """Frames of 720p with six cars."""
    return make_flight(ground, 100, cars=6, noise=3.0)


def follow(flight, index, wrong, **options):
    """The match of a frame on the first one, from a guess that is `wrong` px off."""
    key = stored(flight.frame(0), 1)
    images = pyramid((flight.frame(index),), LEVELS)
    guess = translation(np.array(wrong)) @ flight.to_first(index)
    return PatchMatcher().match(key, images, guess, LIMITS, 220, **options)


def test_a_frame_is_registered_to_a_tenth_of_a_pixel(flight):
    """From 8 px off at 720p, three frames on; points of the match lie where the truth says."""
    match = follow(flight, 3, (7.0, -4.0))
    assert flight.error(match.fit.matrix, 3) < 0.1
    assert len(match.frame_points) == len(match.key_points) == len(match.patches) == match.fit.count
    apart = project(flight.to_first(3), match.frame_points) - match.key_points
    assert np.median(np.hypot(*apart.T)) < 0.15
    assert match.deviation < 0.2


def test_other_ground_is_not_followed(ground, flight):
    """A frame of something else gives None."""
    key = stored(flight.frame(0), 1)
    images = pyramid((ground[700:1420, 700:1980],), LEVELS)
    assert PatchMatcher().match(key, images, IDENTITY, LIMITS, 220) is None


def test_a_guess_far_off_is_left_to_others(flight):
    """60 px off: nothing rather than something wrong."""
    match = follow(flight, 3, (60.0, 0.0))
    assert match is None or flight.error(match.fit.matrix, 3) < 0.3


def test_the_model_restricts_the_motion(flight):
    """A similarity has no perspective and equal diagonal elements."""
    matrix = follow(flight, 1, (0.0, 0.0), rule=MotionRule(MotionModel.SIMILARITY)).fit.matrix
    assert matrix[2, :2] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert matrix[0, 0] == pytest.approx(matrix[1, 1])


def test_a_keyframe_without_corners_is_not_followed(flight):
    """Flat ground cannot be followed, and that is no error."""
    key = stored(np.full((720, 1280), 90, np.uint8), 1)
    images = pyramid((flight.frame(0),), LEVELS)
    assert PatchMatcher().match(key, images, IDENTITY, LIMITS, 220) is None


@pytest.mark.parametrize(
    ("shape", "level"),
    [((240, 320), 0), ((360, 640), 1), ((720, 1280), 1), ((1080, 1920), 1), ((2160, 3840), 2)],
)
def test_patches_are_of_half_size_or_less(shape, level):
    """Small ones at full size, most at half size, large ones at 960 px or less."""
    assert patch_level(shape) == level


def test_roofs_seen_off_the_plane_are_left_out(ground, make_flight):
    """Tall roofs with parallax are left out from the third frame on."""
    flight = make_flight(ground, 100, cars=0, noise=3.0)
    matcher = PatchMatcher()
    stored_key, asked = stored(with_roofs(flight, 0), 1), []
    for index in range(1, 5):
        images = pyramid((with_roofs(flight, index),), LEVELS)
        match = matcher.match(stored_key, images, flight.to_first(index), LIMITS, 220)
        assert flight.error(match.fit.matrix, index) < 0.4
        asked.append(sum(on_roof(point) for point in match.key_points))
    assert asked[0] > 15
    assert asked[-1] < asked[0] / 3


def with_roofs(flight, index):
    """A frame of a flight with nine bright roofs that slide over the ground by a pixel a frame."""
    frame = flight.frame(index)
    for x in (200, 600, 1000):
        for y in (120, 320, 520):
            outline = np.array([[x, y], [x + 110, y], [x + 110, y + 80], [x, y + 80]]) + np.array(
                [index, 0.0]
            )
            seen = project(np.linalg.inv(flight.to_first(index)), outline)
            cv2.fillPoly(frame, [np.rint(seen * 16).astype(np.int32)], 240, cv2.LINE_AA, 4)
    return frame


def on_roof(point):
    """Whether a point of the keyframe lies on one of its roofs."""
    return (point[0] - 200 + 8) % 400 < 126 and (point[1] - 120 + 8) % 200 < 96


@pytest.mark.parametrize("off", [(10.0, 0.0), (20.0, 0.0)])
def test_rows_of_trees_one_period_off_are_not_a_match(ground, off):
    """The patches of an orchard fit a period further, too; most of those in view must agree, not of those."""
    down, across = np.mgrid[:110, :640]
    orchard = ground[:400, :700].copy()
    orchard[120:230, :640] = np.where((across % 10 < 5) & (down % 10 < 5), 60, 150)
    key = stored(orchard[:360, :640], 0)
    noise = np.random.default_rng(1).normal(0, 2, (360, 640))
    images = pyramid((np.clip(orchard[2:362, 3:643] + noise, 0, 255).astype(np.uint8),), LEVELS)
    true = translation(np.array([3.0, 2.0]))
    found = PatchMatcher().match(key, images, true, LIMITS, 220)
    assert found.fit.matrix[:2, 2] == pytest.approx([3.0, 2.0], abs=0.1)
    assert PatchMatcher().match(key, images, translation(np.array(off)) @ true, LIMITS, 220) is None
