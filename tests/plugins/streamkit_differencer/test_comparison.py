"""Frames compared with an earlier one and with the background, where edges may be misplaced."""

import numpy as np
import pytest

from streamkit_differencer.comparison import compare_with_background, find_quiet_ground
from streamkit_differencer.ground import KNOWN, CanvasFrame, Ground


def whole_canvas(image):
    """A frame that covers its canvas."""
    height, width = image.shape
    return CanvasFrame(image, (0, height, 0, width), np.full((height, 2), (0, width)), is_resampled=True)


def foreground(image, background, threshold, tolerance):
    """Equation 4 with one threshold and a tolerance."""
    ground = Ground.unknown(image.shape[::-1])
    ground.background[:], ground.valid[:] = background, KNOWN
    return compare_with_background(whole_canvas(image), ground, 0.0, float(threshold), tolerance)[-1]


def is_quiet(image, earlier, gain):
    """The pixels without a change, with lambda of one frame."""
    ground = Ground.unknown(image.shape[::-1])
    ground.waiting[:] -= 1
    return find_quiet_ground(whole_canvas(image), earlier, ground, 18.0, gain, 1) > 0


def test_gradient_gain_raises_the_threshold_at_edges_only():
    """By that share of the local range of the earlier image; elsewhere nothing changes."""
    earlier = np.full((6, 40), 100, np.uint8)
    earlier[:, 30:] = 144
    later = earlier + np.uint8(40)
    assert not is_quiet(later, earlier, 0.0).any()
    found = is_quiet(later, earlier, 0.5)
    assert found[:, 29:31].all()
    assert not found[:, :29].any()
    assert not found[:, 31:].any()
    assert is_quiet(earlier + np.uint8(18), earlier, 0.0).all()


def test_what_is_not_in_both_frames_has_changed():
    """Also at an edge."""
    earlier = np.full((6, 40), 100, np.uint8)
    earlier[:, 20:] = 0
    assert is_quiet(earlier + np.uint8(1), earlier, 4.0)[:, :20].all()
    assert not is_quiet(earlier + np.uint8(1), earlier, 4.0)[:, 20:].any()


@pytest.mark.parametrize("tolerance", [1, 2])
def test_a_registration_error_within_the_tolerance_is_no_difference(tolerance):
    """An edge that is off by the tolerance is within the background's range; one by more is not."""
    background, within, beyond = np.full((3, 20, 40), 10, np.uint8)
    background[:, 20:] = within[:, 20 + tolerance :] = beyond[:, 21 + tolerance :] = 200
    assert not foreground(within, background, 0, tolerance).any()
    assert foreground(beyond, background, 0, tolerance).any()
    assert foreground(within, background, 0, 0).any()
