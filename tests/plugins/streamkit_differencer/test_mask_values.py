"""Values of the foreground mask."""

import numpy as np
import pytest

from streamkit_differencer.mask_values import binary_mask, full_size


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


def test_shadow_is_no_thing():
    """What moves and what has stopped become 255, shadow and ground 0."""
    assert binary_mask(np.array([[0, 50, 128, 255]], np.uint8)).tolist() == [[0, 0, 255, 255]]
