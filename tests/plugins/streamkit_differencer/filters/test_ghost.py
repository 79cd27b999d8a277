"""Ghosts of things that left."""

import numpy as np
import pytest

from streamkit_differencer.filters.ghost import ghost_mask
from streamkit_differencer.filters.pieces import Pieces

EVERYWHERE = np.full((60, 80), 255, np.uint8)
PLACE = np.s_[20:35, 30:55]


def road():
    """Ground with faint texture."""
    return np.random.default_rng(0).integers(98, 103, (60, 80)).astype(np.uint8)


def with_car():
    """The same with a bright car."""
    picture = road()
    picture[PLACE] = 220
    return picture


def mask_of(place):
    """Foreground there."""
    mask = np.zeros((60, 80), np.uint8)
    mask[place] = 255
    return mask


def test_a_car_in_the_background_that_left_is_a_ghost():
    """Its outline shows in the background only."""
    mask = mask_of(PLACE)
    np.testing.assert_array_equal(ghost_mask(road(), with_car(), Pieces.of(mask), EVERYWHERE), mask)


def test_a_car_in_the_frame_is_none():
    """Its outline shows in the frame."""
    assert ghost_mask(with_car(), road(), Pieces.of(mask_of(PLACE)), EVERYWHERE) is None


def test_each_piece_is_judged_by_itself():
    """A ghost beside a car goes, the car stays."""
    frame, other = road(), np.s_[45:55, 5:20]
    frame[other] = 20
    found = ghost_mask(frame, with_car(), Pieces.of(mask_of(PLACE) | mask_of(other)), EVERYWHERE)
    np.testing.assert_array_equal(found, mask_of(PLACE))


@pytest.mark.parametrize("mask", [np.zeros((60, 80), np.uint8), EVERYWHERE])
def test_equal_pictures_have_no_ghosts(mask):
    """Whatever is foreground."""
    assert ghost_mask(road(), road(), Pieces.of(mask), EVERYWHERE) is None


def test_what_borders_on_unknown_ground_is_not_judged():
    """A strip between a car and ground that is not known yet may be the car's front."""
    known = np.zeros((60, 80), np.uint8)
    known[:, 45:] = 255
    strip = mask_of(np.s_[20:35, 45:48])
    assert ghost_mask(road(), with_car(), Pieces.of(strip), known) is None
