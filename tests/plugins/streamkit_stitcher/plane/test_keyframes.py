"""Keyframes that frames can be matched with."""

from dataclasses import replace

import numpy as np
import pytest

from streamkit.geometry.homography import IDENTITY, translation
from streamkit_stitcher.plane.keyframe_map import KeyframeMap
from streamkit_stitcher.plane.settings import PlaneSettings


@pytest.fixture
def store():
    """A map of at most three keyframes."""
    store = KeyframeMap(replace(PlaneSettings(), max_keyframes=3))
    yield store
    store.close()


def stored(store, frame, to_reference=IDENTITY):
    """Adds a frame to a map."""
    return store.add((frame,), to_reference, 0, [])


def test_overlapping_keyframes_come_nearest_first(ground, store):
    """Only those that share ground at a similar scale are listed, greatest overlap first."""
    for left in (0, 300, 900):
        stored(store, ground[:360, left : left + 640], translation(np.array([left, 0.0])))
    found = store.overlapping(translation(np.array([250.0, 0.0])), (360, 640), 0.25)
    assert [keyframe.index for keyframe in found] == [1, 0]
    assert store.overlapping(np.diag([3.0, 3.0, 1.0]), (360, 640), 0.0) == []


def test_the_store_is_bounded_and_drops_what_is_seen_twice(ground, store):
    """Of the two nearest keyframes the older goes; the first always stays."""
    for left in (0, 400, 420, 900, 1300):
        stored(store, ground[:360, left : left + 640], translation(np.array([left, 0.0])))
    assert [keyframe.index for keyframe in store.stored] == [0, 2, 4]
    assert len(store) == 5
