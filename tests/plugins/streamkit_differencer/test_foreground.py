"""Foreground by equation 4, grown to the whole of objects, cleaned, and its values."""

import cv2
import numpy as np
import pytest

from streamkit_differencer.foreground import cleaned, find_foreground, full_size
from streamkit_differencer.ground import CanvasFrame, Ground
from streamkit_differencer.settings import BackgroundSettings

SHAPE = (40, 60)


def found(image, tolerance=0, ratio=0.5, known=255):
    """The foreground of an image before a black ground, with thresholds of 20."""
    ground = Ground.unknown(SHAPE[::-1])
    ground.valid[:] = known
    settings = BackgroundSettings(
        foreground_threshold=20.0, noise_gain=0.0, tolerance=tolerance, hysteresis_ratio=ratio
    )
    frame = CanvasFrame(image, (0, SHAPE[0], 0, SHAPE[1]), np.full((SHAPE[0], 2), (0, SHAPE[1])), True)
    return find_foreground(frame, ground, settings)[-1]


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


def ring():
    """A ring with a hole, and a lone pixel."""
    mask = np.zeros((40, 40), np.uint8)
    mask[5:25, 5:25] = 255
    mask[12:18, 12:18] = 0
    mask[33, 33] = 255
    return mask


def test_a_median_takes_lone_pixels_and_keeps_holes():
    """A hole that is wider than the median stays; objects keep their marks."""
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
    mask = np.where(random.random((45, 70)) < share, random.choice([50, 128, 255], (45, 70)), 0)
    mask = mask.astype(np.uint8)
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


@pytest.mark.parametrize(("width", "height"), [(8, 6), (9, 7)])
def test_each_working_pixel_becomes_its_square(width, height):
    """An odd last row or column takes its neighbour's mark."""
    small = np.array([[0, 255, 0, 0], [0, 0, 0, 128], [50, 0, 0, 0]], np.uint8)
    large = full_size(small, width, height)
    assert large.shape == (height, width)
    np.testing.assert_array_equal(large[:6, :8], small.repeat(2, axis=0).repeat(2, axis=1))


def test_a_frame_that_was_not_judged_is_black():
    """Its size is the frame's all the same."""
    assert full_size(None, 5, 4).shape == (4, 5)
    assert not full_size(None, 5, 4).any()
