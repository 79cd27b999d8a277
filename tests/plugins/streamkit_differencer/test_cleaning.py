"""Cleaning of foreground."""

import cv2
import numpy as np
import pytest

from streamkit_differencer.cleaning import cleaned


def ring():
    """A ring with a hole, and a lone pixel."""
    mask = np.zeros((40, 40), np.uint8)
    mask[5:25, 5:25] = 255
    mask[12:18, 12:18] = 0
    mask[33, 33] = 255
    return mask


def test_a_median_takes_lone_pixels_and_keeps_holes():
    """Objects keep their marks."""
    mask = ring()
    mask[5:25, 5:10] = 128
    result = cleaned(mask, 5, False)
    assert result[33, 33] == 0
    assert result[15, 15] == 0
    assert set(np.unique(result)) == {0, 128, 255}


@pytest.mark.parametrize("width", [3, 5, 7])
@pytest.mark.parametrize("share", [0.02, 0.5])
def test_the_median_is_that_of_the_marks(width, share):
    """Of all marks together, as OpenCV sorts them."""
    random = np.random.default_rng(width)
    mask = np.where(random.random((45, 70)) < share, random.choice([50, 128, 255], (45, 70)), 0).astype(
        np.uint8
    )
    mask[20:30, 20:40] = random.choice([50, 128, 255], (10, 20))
    np.testing.assert_array_equal(cleaned(mask, width, False), cv2.medianBlur(mask, width))


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
