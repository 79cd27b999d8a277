"""Regions of interest."""

import cv2
import numpy as np
import pytest

from streamkit_differencer.region import region_mask


def test_polygons_in_pixels():
    """Corners are inside, and several polygons join."""
    mask = region_mask("10,10 19,10 19,29 10,29; 50,0 59,0 59,9 50,9", 80, 60)
    expected = np.zeros((60, 80), np.uint8)
    expected[10:30, 10:20] = expected[0:10, 50:60] = 255
    np.testing.assert_array_equal(mask, expected)


def test_shares_of_the_frame():
    """Numbers up to 1 are shares, whatever the frame's size."""
    for width, height in ((80, 60), (1280, 720)):
        mask = region_mask("0,0 0.5,0 0.5,1 0,1", width, height)
        assert abs((mask > 0).mean() - 0.5) < 0.02


def test_a_picture(tmp_path):
    """White is inside; it is brought to the frame's size."""
    picture = np.zeros((30, 40), np.uint8)
    picture[:, 20:] = 255
    cv2.imwrite(str(tmp_path / "roi.bmp"), picture)
    mask = region_mask(str(tmp_path / "roi.bmp"), 80, 60)
    assert not mask[:, :40].any()
    assert mask[:, 40:].all()


@pytest.mark.parametrize("text", ["1,2 3,4", "a,b c,d e,f", ";", "1,2 3,4 5", "10 20 30 40 50 60"])
def test_words_that_are_no_polygon(text):
    """The error says what is needed, with an example."""
    with pytest.raises(ValueError, match=r"write for example roi='0,0 640,0 640,200', or name an image"):
        region_mask(text, 80, 60)


def test_a_picture_that_is_not_there(tmp_path):
    """The error names it."""
    with pytest.raises(ValueError, match=r"none\.png: not an image that can be read"):
        region_mask(str(tmp_path / "none.png"), 80, 60)
