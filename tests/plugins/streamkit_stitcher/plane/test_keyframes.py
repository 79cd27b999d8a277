"""Keyframes, and registration of frames to them."""

import numpy as np
import pytest

from streamkit.geometry.homography import IDENTITY, translation
from streamkit_stitcher.plane.following import KeyframeFollower
from streamkit_stitcher.plane.keyframe_content import LEVELS, patches_around
from streamkit_stitcher.plane.keyframe_matcher import KeyframeMatcher
from streamkit_stitcher.plane.keyframes import KeyframeStore
from streamkit_stitcher.registration.corners import even_corners
from streamkit_stitcher.registration.motion_models import FitLimits
from streamkit_stitcher.registration.patches import pyramid

LIMITS = FitLimits(max_step=1.0)


def stored(store, frame, to_reference=IDENTITY):
    """A frame added to a store, with its corners."""
    content = patches_around(even_corners(frame, 24, 13), pyramid((frame,), LEVELS), 0)
    return store.add(lambda: content, to_reference, frame.shape, 0)


@pytest.mark.parametrize(("offset", "top_level"), [(1.5, 0), (12.0, 3)])
def test_a_frame_is_registered_to_a_tenth_of_a_pixel(ground, make_flight, offset, top_level):
    """From a prediction 1.5 px off at full size, or 12 px off from coarse to fine."""
    flight = make_flight(ground, 100, (360, 640), cars=4)
    store = KeyframeStore()
    key = stored(store, flight.frame(0))
    wrong = translation(np.array([offset, -offset / 2])) @ flight.to_first(4)
    images = pyramid((flight.frame(4),), LEVELS)
    match = KeyframeMatcher().match(key, images, wrong, LIMITS, top_level=top_level, max_points=300)
    assert flight.error(match.fit.matrix, 4) < 0.15
    assert len(match.frame_points) == match.fit.count


def test_other_ground_is_not_matched(ground):
    """A frame of something else gives None."""
    store = KeyframeStore()
    key = stored(store, ground[:360, :640])
    images = pyramid((ground[900:1260, 1000:1640],), LEVELS)
    assert KeyframeMatcher().match(key, images, IDENTITY, LIMITS, top_level=3, max_points=300) is None


@pytest.mark.parametrize("off", [(10.0, 0.0), (20.0, 0.0)])
def test_rows_of_trees_one_period_off_are_not_a_match(ground, off):
    """The patches of an orchard fit a period further, too; most of those in view must agree, not of those."""
    down, across = np.mgrid[:110, :640]
    orchard = ground[:400, :700].copy()
    orchard[120:230, :640] = np.where((across % 10 < 5) & (down % 10 < 5), 60, 150)
    store = KeyframeStore()
    key = stored(store, orchard[:360, :640])
    noise = np.random.default_rng(1).normal(0, 2, (360, 640))
    images = pyramid((np.clip(orchard[2:362, 3:643] + noise, 0, 255).astype(np.uint8),), LEVELS)
    true = translation(np.array([3.0, 2.0]))
    found = KeyframeFollower().follow(key, images, true, LIMITS, 220)
    assert found.fit.matrix[:2, 2] == pytest.approx([3.0, 2.0], abs=0.1)
    assert KeyframeFollower().follow(key, images, translation(np.array(off)) @ true, LIMITS, 220) is None


def test_overlapping_keyframes_come_nearest_first(ground):
    """Only those that share ground at a similar scale are listed, greatest overlap first."""
    store = KeyframeStore()
    for left in (0, 300, 900):
        stored(store, ground[:360, left : left + 640], translation(np.array([left, 0.0])))
    found = store.overlapping(translation(np.array([250.0, 0.0])), (360, 640), 0.25)
    assert [keyframe.index for _, keyframe in found] == [1, 0]
    assert store.overlapping(np.diag([3.0, 3.0, 1.0]), (360, 640), 0.0) == []


def test_the_store_is_bounded_and_drops_what_is_seen_twice(ground):
    """Of the two nearest keyframes the older goes; the first always stays."""
    store = KeyframeStore(capacity=3)
    for left in (0, 400, 420, 900, 1300):
        stored(store, ground[:360, left : left + 640], translation(np.array([left, 0.0])))
    assert [keyframe.index for keyframe in store.keyframes] == [0, 2, 4]
    assert len(store) == 3
