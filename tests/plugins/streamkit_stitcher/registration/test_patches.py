"""Sub-pixel alignment of patches."""

import cv2
import numpy as np
import pytest

from streamkit.geometry.homography import project, resized, translation
from streamkit_stitcher.registration.corners import even_corners
from streamkit_stitcher.registration.joint_alignment import align_coarsely, align_jointly
from streamkit_stitcher.registration.patches import cut_patches, prepare, pyramid, spread_order

TURN = np.array(
    [[1.1 * np.cos(0.3), -1.1 * np.sin(0.3), 90], [1.1 * np.sin(0.3), 1.1 * np.cos(0.3), -40], [0, 0, 1]]
)


def level_of(frame):
    """Prepared patches around the corners of a frame."""
    points = even_corners(frame, 20, 11)
    return prepare(cut_patches(frame, points), points)


@pytest.mark.parametrize("gain", [1.0, 0.6])
def test_patches_are_found_in_a_turned_and_dimmed_frame(ground, gain):
    """Rotation, scale and brightness cost no accuracy: the median error is below a tenth of a pixel."""
    key = ground[300:660, 300:940]
    frame = cv2.warpPerspective(ground[300:660, 300:940], TURN, (640, 360), flags=cv2.INTER_CUBIC)
    frame = (frame * gain + 10).astype(np.uint8)
    level = level_of(key)
    guess = translation(np.array([1.2, -0.9])) @ TURN
    coarse = align_coarsely(level, frame, guess, most=220, passes=8, settled=0.3)
    found = align_jointly(level, frame, coarse, 1.0)
    error = np.hypot(*(found.frame_points - project(TURN, found.key_points)).T)
    assert 60 < len(found.numbers) <= found.visible_count <= len(level.centres)
    assert np.median(error) < 0.1


def test_patches_of_other_ground_are_not_found(ground):
    """Other ground yields chance matches only, which fix no motion."""
    assert align_jointly(level_of(ground[:360, :640]), ground[900:1260, 1000:1640], np.eye(3), 1.0) is None


def test_leading_parts_are_spread():
    """Each number comes once, and of the first eighth no two are close together."""
    order = spread_order(100)
    assert sorted(order) == list(range(100))
    assert np.diff(np.sort(order[:12])).min() >= 4
    assert spread_order(1).tolist() == [0]


def test_flat_patches_are_not_used():
    """A patch without contrast takes no part and raises nothing."""
    flat = np.full((100, 100), 90, np.uint8)
    centres = np.array([[50.0, 50.0]])
    level = prepare(cut_patches(flat, centres), centres)
    assert not level.usable.any()
    assert align_jointly(level, flat, np.eye(3), 1.0) is None


def test_a_pyramid_keeps_pixel_centres():
    """Pixel x of level k lies at full-size x * 2**k + (2**k - 1) / 2, odd sides included."""
    ramp = np.tile(np.arange(101, dtype=np.uint8), (51, 1))
    levels = pyramid((ramp,), 3)
    assert [level.shape for level in levels] == [(51, 101), (25, 50), (12, 25)]
    assert levels[2][0, :4] == pytest.approx(np.arange(4) * 4 + 1.5, abs=1.0)
    assert resized(translation(np.array([8.0, 4.0])), 1 / 4)[:2, 2] == pytest.approx([2.0, 1.0])


def test_a_pyramid_of_a_tiny_frame_ends_early():
    """No level has an empty side."""
    assert [level.shape for level in pyramid((np.zeros((3, 5), np.uint8),), 4)] == [(3, 5), (1, 2)]
