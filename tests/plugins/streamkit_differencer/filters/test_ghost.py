"""Ghosts of objects that left."""

import numpy as np
import pytest

from streamkit_differencer.equations import LONGEST_WAIT
from streamkit_differencer.filters.components import components_of
from streamkit_differencer.filters.ghost import find_ghosts

EVERYWHERE = np.full((60, 80), 255, np.uint8)
AT_REST = np.zeros((60, 80), np.uint8)
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


def ghosts_in(frame, background, mask, known=EVERYWHERE, waiting=AT_REST):
    """Which pieces are ghosts, by the corner where they begin."""
    blocks, count = components_of(mask)
    found = find_ghosts(frame, background, known, waiting, mask, blocks, count)
    return {
        tuple(blocks[blocks[:, 2] == piece, :2].min(axis=0).tolist()): bool(found[piece])
        for piece in range(count)
    }


def test_a_car_in_the_background_that_left_is_a_ghost():
    """Its outline shows in the background only."""
    assert ghosts_in(road(), with_car(), mask_of(PLACE)) == {(20, 30): True}


def test_what_still_changes_is_none():
    """Leaves that pass out of focus hide the edges of what they cover, as a car that left does."""
    waiting = np.full((60, 80), LONGEST_WAIT, np.uint8)
    assert ghosts_in(road(), with_car(), mask_of(PLACE), waiting=waiting) == {(20, 30): False}


def test_a_car_in_the_frame_is_none():
    """Its outline shows in the frame."""
    assert ghosts_in(with_car(), road(), mask_of(PLACE)) == {(20, 30): False}


def test_each_piece_is_judged_by_itself():
    """A ghost beside a car goes, the car stays."""
    frame, other = road(), np.s_[44:55, 6:20]
    frame[other] = 20
    found = ghosts_in(frame, with_car(), mask_of(PLACE) | mask_of(other))
    assert found == {(20, 30): True, (44, 6): False}


@pytest.mark.parametrize("mask", [np.zeros((60, 80), np.uint8), EVERYWHERE])
def test_equal_pictures_have_no_ghosts(mask):
    """Whatever is foreground."""
    assert not any(ghosts_in(road(), road(), mask).values())


def test_what_borders_on_unknown_ground_is_not_judged():
    """A strip between a car and ground that is not known yet may be the car's front."""
    known = np.zeros((60, 80), np.uint8)
    known[:, 45:] = 255
    strip = mask_of(np.s_[20:35, 45:48])
    assert not any(ghosts_in(road(), with_car(), strip, known).values())
