"""Tall things under a moving camera."""

import cv2
import numpy as np
import pytest

from streamkit_differencer.equations import foreground, local_bounds
from streamkit_differencer.filters.parallax import (
    EARLY_PX,
    LAG,
    Bounds,
    along,
    known_around,
    reach,
    slide,
    sliding_mask,
)
from streamkit_differencer.filters.pieces import Pieces

SHAPE = (120, 160)
CAMERA_STEP = np.array([8.0, 0.0])
EVERYWHERE = np.full(SHAPE, 255, np.uint8)
WAY = slide(CAMERA_STEP, 0.25)


def view(x, width=40, tone=220):
    """Textured ground with a bright thing whose left edge is at x."""
    ground = np.random.default_rng(2).integers(70, 110, (30, 40)).astype(np.uint8)
    picture = cv2.resize(ground, (160, 120), interpolation=cv2.INTER_LINEAR)
    picture[40:70, x : x + width] = tone
    return picture


def judged(now, before, learnt, known=EVERYWHERE):
    """The share of the foreground that slides, of pictures now, of tau before and in the background."""
    mask = foreground(now, learnt, 12.0, tolerance=1) & known
    assert mask.any()
    whole = [np.s_[0:120, 0:160]]
    reliable = known_around(known, np.empty_like(known), whole, 0)
    bounds = [Bounds(*local_bounds(picture, 1), reliable) for picture in (learnt, before)]
    found = sliding_mask(now, *bounds, Pieces.of(mask), 12.0, WAY)
    if found is None:
        return 0.0
    assert not (found & ~mask).any()
    return np.count_nonzero(found) / np.count_nonzero(mask)


def test_a_roof_that_slides_against_the_camera_is_left_out():
    """By two pixels in tau frames, and by eight since its ground was learnt: both of its edges go."""
    assert judged(view(60), view(62), view(68)) > 0.95


@pytest.mark.parametrize(
    ("now", "before", "learnt"),
    [(68, 66, 60), (60, 70, 90), (60, 69, 68)],
    ids=["along-the-camera", "faster-than-tall", "learnt-by-mistake"],
)
def test_what_does_not_slide_like_that_stays(now, before, learnt):
    """A thing that goes the camera's way, one that is too fast, and one whose old place was learnt."""
    assert judged(view(now), view(before), view(learnt)) < 0.05


def test_a_thing_that_is_new_stays():
    """Nothing of it is in the background."""
    assert judged(view(60), view(62), view(60, width=0)) < 0.05


def test_unknown_ground_explains_nothing():
    """What comes in from the border was on the unknown ground before, too."""
    known = EVERYWHERE.copy()
    known[:, 66:] = 0
    assert judged(view(60), view(62), view(66), known) < 0.05


def test_each_piece_is_judged_by_itself():
    """A roof goes, a car that has just come stays."""
    now, before, learnt = view(60), view(62), view(66)
    now[90:100, 20:40] = 230
    mask = foreground(now, learnt, 12.0, tolerance=1)
    bounds = (Bounds(*local_bounds(picture, 1), EVERYWHERE) for picture in (learnt, before))
    found = sliding_mask(now, *bounds, Pieces.of(mask), 12.0, WAY)
    assert found[40:70].any()
    assert not found[85:105].any()


def test_a_camera_that_stands_sees_no_parallax():
    """Nor does one that hardly moved, and a share of 0 turns the filter off."""
    assert slide(np.zeros(2), 0.3) is None
    assert slide(np.array([1.0, 0.5]), 0.3) is None
    assert slide(CAMERA_STEP, 0.0) is None
    np.testing.assert_allclose(WAY, [2.0, 0.0])


@pytest.mark.parametrize("way", [(2.0, 0.0), (-7.3, 4.1), (0.4, -0.3)])
def test_the_reach_takes_in_all_that_is_looked_at(way):
    """What is known near the foreground within the reach gives what is known everywhere would give."""
    random = np.random.default_rng(5)
    known = np.where(random.random(SHAPE) < 0.02, 0, 255).astype(np.uint8)
    mask = np.zeros(SHAPE, np.uint8)
    mask[50:60, 70:90] = 255
    way = np.array(way)
    near = known_around(known, np.full(SHAPE, 77, np.uint8), [np.s_[50:60, 70:90]], reach(way))
    everywhere = known_around(known, np.empty_like(known), [np.s_[0:120, 0:160]], 0)
    rows, columns = np.nonzero(mask)
    for line in (way * LAG, way * (1.0 + EARLY_PX / np.linalg.norm(way))):
        found, expected = (
            along(Bounds(*local_bounds(view(60), 1), usable), rows, columns, line)
            for usable in (near, everywhere)
        )
        np.testing.assert_array_equal(found, expected)
