"""Tests of the test images."""

import numpy as np
import pytest

from streamkit_video.patterns import MOVING, Pattern, paint


@pytest.mark.parametrize("pattern", list(Pattern))
@pytest.mark.parametrize("size", [(320, 240), (7, 5), (1, 1)])
def test_every_pattern_in_any_size(pattern: Pattern, size: tuple[int, int]) -> None:
    """The layout is right down to one pixel, and painting again gives the same image."""
    width, height = size
    image = paint(pattern, width, height, 3, 0)
    assert image.shape == (height, width, 3)
    assert image.dtype == np.uint8
    np.testing.assert_array_equal(image, paint(pattern, width, height, 3, 0))


@pytest.mark.parametrize("pattern", list(Pattern))
def test_only_moving_patterns_move(pattern: Pattern) -> None:
    """Ball and snow change from frame to frame, the others never."""
    changed = not np.array_equal(paint(pattern, 64, 48, 0, 0), paint(pattern, 64, 48, 1, 0))
    assert changed == (pattern in MOVING)


def test_bars_are_the_seven_colours() -> None:
    """From left to right: white, yellow, cyan, green, magenta, red, blue."""
    bars = paint(Pattern.SMPTE, 70, 48, 0, 0)[0, 5::10] > 100
    assert bars.tolist() == [
        [True, True, True],
        [False, True, True],
        [True, True, False],
        [False, True, False],
        [True, False, True],
        [False, False, True],
        [True, False, False],
    ]


def test_snow_depends_on_the_seed() -> None:
    """Another seed is other snow; it is grey and fills the range."""
    snow = paint(Pattern.SNOW, 64, 48, 0, 0)
    assert not np.array_equal(snow, paint(Pattern.SNOW, 64, 48, 0, 1))
    assert (snow[:, :, 0] == snow[:, :, 2]).all()
    assert snow.min() < 5
    assert snow.max() > 250


def test_the_ball_is_white_and_whole() -> None:
    """It never leaves the image: the bright area is the same wherever it is."""
    areas = [
        int((paint(Pattern.BALL, 320, 240, index, 0)[:, :, 0] > 127).sum()) for index in range(0, 200, 9)
    ]
    assert max(areas) - min(areas) < 30
    assert abs(areas[0] - np.pi * 20.5**2) < 60


def test_plain_patterns() -> None:
    """Black, white, checkers of eight pixels, and a gradient from white to black."""
    assert paint(Pattern.BLACK, 4, 4, 0, 0).max() == 0
    assert paint(Pattern.WHITE, 4, 4, 0, 0).min() == 255
    checkers = paint(Pattern.CHECKERS_8, 32, 32, 0, 0)[:, :, 0]
    assert checkers[0, 0] == 0
    assert checkers[0, 8] == checkers[8, 0] == 255
    gradient = paint(Pattern.GRADIENT, 4, 256, 0, 0)[:, 0, 0]
    assert gradient.tolist() == list(range(255, -1, -1))
