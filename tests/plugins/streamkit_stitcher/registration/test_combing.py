"""Interlaced frames."""

import numpy as np
import pytest

from streamkit.geometry.homography import IDENTITY, translation
from streamkit_stitcher.registration.combing import field_error, field_shift, is_combed


def interlaced(ground, x, y):
    """A frame whose odd rows were taken when the picture had moved by x, y px."""
    frame = ground[300:660, 300:940].copy()
    frame[1::2] = ground[300 - y : 660 - y, 300 - x : 940 - x][1::2]
    return frame


@pytest.mark.parametrize(("x", "y"), [(6, 0), (5, -4), (-9, 2)])
def test_the_motion_between_the_fields_is_found(ground, x, y):
    """To a pixel: the rows of a field are two apart."""
    assert field_shift(interlaced(ground, x, y)) == pytest.approx([x, y], abs=1.0)


@pytest.mark.parametrize("order", [1, -1])
def test_fields_of_an_even_motion_are_right_whichever_comes_first(ground, order):
    """A frame moves by twice what one field does; a jump of the fields alone is half of it off."""
    frame = interlaced(ground, 8, 0)
    moved = translation(np.array([-order * 16.0, 0.0]))
    assert field_error(frame, moved) < 0.5
    assert field_error(frame, IDENTITY) == pytest.approx(4.0, abs=0.5)
    assert field_error(interlaced(ground, 0, 0), moved) == 0.0


def test_a_progressive_frame_is_not_combed(ground):
    """Its neighbouring rows are the most alike, even in noise."""
    frame = interlaced(ground, 0, 0)
    noise = np.random.default_rng(1).normal(0, 30, frame.shape)
    for shown in (frame, np.clip(frame + noise, 0, 255).astype(np.uint8), frame[:5]):
        assert not is_combed(shown)
