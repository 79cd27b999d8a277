"""Cleaning of foreground."""

import numpy as np

from streamkit_differencer.cleaning import cleaned


def ring():
    """A ring with a hole, and a lone pixel."""
    mask = np.zeros((40, 40), np.uint8)
    mask[5:25, 5:25] = 255
    mask[12:18, 12:18] = 0
    mask[33, 33] = 255
    return mask


def test_a_median_takes_lone_pixels_and_keeps_holes():
    """Things keep their marks."""
    mask = ring()
    mask[5:25, 5:10] = 128
    result = cleaned(mask, 5, False)
    assert result[33, 33] == 0
    assert result[15, 15] == 0
    assert set(np.unique(result)) == {0, 128, 255}


def test_holes_are_filled():
    """What is enclosed becomes foreground, what is outside does not."""
    result = cleaned(ring(), 0, True)
    assert result[5:25, 5:25].all()
    assert (result > 0).sum() == 400 + 1


def test_nothing_asked_nothing_done():
    """The mask is the same, in an array of its own."""
    mask = ring()
    same = cleaned(mask, 0, False)
    np.testing.assert_array_equal(same, mask)
    assert not np.shares_memory(same, mask)
