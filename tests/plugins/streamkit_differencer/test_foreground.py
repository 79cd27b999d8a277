"""Foreground by equation 4, grown to the whole of objects."""

import numpy as np

from streamkit_differencer.foreground import find_foreground

SHAPE = (40, 60)


def found(image, tolerance=0, ratio=0.5, known=255):
    """The foreground of an image before a black ground, with thresholds of 20."""
    background, thresholds = np.zeros(SHAPE, np.uint8), np.full(SHAPE, 20, np.uint8)
    known = np.broadcast_to(np.uint8(known), SHAPE).copy()
    return find_foreground(image, background, thresholds, known, tolerance, ratio)


def test_weak_differences_count_beside_strong_ones():
    """With a tolerance a grey part that touches a bright one is foreground; one that stands alone is not."""
    image = np.zeros(SHAPE, np.uint8)
    image[10:16, 10:16], image[10:16, 16:20] = 200, 15
    image[30:36, 40:46] = 15
    mask = found(image, tolerance=1)
    assert mask[11:15, 11:19].all()
    assert not mask[25:].any()
    assert not found(image)[11:15, 16:].any()
    assert not found(image, tolerance=1, ratio=1.0)[11:15, 16:].any()


def test_lone_pixels_do_not_grow():
    """A median removes them, with a tolerance."""
    image = np.zeros(SHAPE, np.uint8)
    image[10, 10] = 200
    assert not found(image, tolerance=1).any()
    assert np.argwhere(found(image)).tolist() == [[10, 10]]


def test_unknown_ground_is_no_foreground():
    """Neither where it differs clearly, nor where foreground would grow onto it."""
    image, known = np.full(SHAPE, 200, np.uint8), np.zeros(SHAPE, np.uint8)
    known[:, 20:] = 255
    for tolerance in (0, 1):
        np.testing.assert_array_equal(found(image, tolerance, known=known), known)
