"""Covered ground."""

import numpy as np
import pytest

from streamkit.geometry.homography import translation
from streamkit_stitcher.mosaic.coverage import Coverage

SMALL = (360, 640)


def shift(x, y=0.0):
    """The homography of a shift."""
    return translation(np.array([float(x), float(y)]))


def test_uncovered_is_the_new_part_of_a_frame():
    """All at first, half after half a frame's way, nothing where it was."""
    ground = Coverage()
    assert ground.is_empty
    assert ground.uncovered(SMALL, np.eye(3)) == 1.0
    assert ground.add(SMALL, np.eye(3))
    assert not ground.is_empty
    assert ground.uncovered(SMALL, np.eye(3)) < 0.02
    assert ground.uncovered(SMALL, shift(320)) == pytest.approx(0.5, abs=0.05)
    assert ground.uncovered(SMALL, shift(0, 180)) == pytest.approx(0.5, abs=0.07)


def test_the_covered_area_counts_shared_ground_once():
    """Two frames that share half are one and a half."""
    ground = Coverage()
    ground.add(SMALL, np.eye(3))
    ground.add(SMALL, shift(320))
    assert ground.covered_px == pytest.approx(1.5 * 360 * 640, rel=0.08)


def test_it_follows_the_plane():
    """After a change of plane the same ground has other coordinates."""
    ground = Coverage()
    ground.add(SMALL, np.eye(3))
    ground.move_plane(shift(1000, 200))
    assert ground.uncovered(SMALL, shift(1000, 200)) < 0.02
    assert ground.uncovered(SMALL, np.eye(3)) == 1.0


@pytest.mark.parametrize("shape", [(16, 16), (40, 300), (2160, 3840)])
def test_any_size_of_frame_has_an_outline(shape):
    """One of a few pixels, too."""
    ground = Coverage()
    assert ground.add(shape, np.eye(3))
    assert ground.uncovered(shape, np.eye(3)) < 0.3
    assert ground.uncovered(shape, shift(2 * shape[1])) == 1.0


@pytest.mark.parametrize(
    "place",
    [np.full((3, 3), np.nan), np.diag([9.0, 9.0, 1.0]), np.diag([-1.0, 1.0, 1.0]), shift(600_000)],
    ids=["nan", "huge", "mirrored", "far"],
)
def test_frames_that_a_mosaic_refuses_are_refused(place):
    """Degenerate homographies cover nothing."""
    ground = Coverage()
    ground.add(SMALL, np.eye(3))
    before = ground.covered_px
    assert not ground.add(SMALL, place)
    assert ground.covered_px == before
