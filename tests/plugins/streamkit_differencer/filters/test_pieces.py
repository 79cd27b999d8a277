"""Connected pieces of a mask."""

import numpy as np
import pytest

from streamkit_differencer.filters.pieces import MOST_POINTS, Pieces, points_of


def two_squares(shape=(61, 83)):
    """A mask with two squares and a lone pixel in the last row and column."""
    mask = np.zeros(shape, np.uint8)
    mask[10:20, 10:30] = mask[40:50, 50:60] = mask[-1, -1] = 255
    return mask


def test_pieces_are_told_apart():
    """Each pixel knows its piece, and a piece can be had alone; an odd last row has none."""
    mask = two_squares()
    pieces = Pieces.of(mask)
    assert pieces.count == 3
    first = int(pieces.owners(np.array([15]), np.array([15]))[0])
    chosen = np.arange(pieces.count) == first
    expected = mask.copy()
    expected[30:] = 0
    np.testing.assert_array_equal(pieces.only(chosen), expected)


@pytest.mark.parametrize("seed", range(3))
def test_points_lie_in_the_mask_and_know_their_piece(seed):
    """One pixel of a square of two by two speaks for it."""
    random = np.random.default_rng(seed)
    mask = np.where(random.random((60, 80)) < 0.2, 255, 0).astype(np.uint8)
    pieces = Pieces.of(mask)
    rows, columns, owner = pieces.points()
    assert mask[rows, columns].all()
    np.testing.assert_array_equal(owner, pieces.owners(rows, columns))
    assert set(owner.tolist()) <= set(range(1, pieces.count))


def test_no_more_points_than_are_asked():
    """Of large foreground every so-manieth pixel is taken, of none none."""
    assert len(points_of(np.full((400, 400), 255, np.uint8))[0]) <= MOST_POINTS
    assert len(points_of(np.zeros((40, 40), np.uint8))[0]) == 0
    assert len(Pieces.of(np.full((400, 400), 255, np.uint8)).points()[0]) <= MOST_POINTS
    assert len(Pieces.of(np.zeros((40, 40), np.uint8)).points()[0]) == 0
