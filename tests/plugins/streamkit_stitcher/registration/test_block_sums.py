"""The compiled comparison of textures against plain numpy."""

import numpy as np
import pytest

from streamkit_stitcher.registration.block_sums import BLOCK, compare_blocks


@pytest.mark.parametrize("shape", [(8, 8), (17, 30), (64, 96)])
def test_means_of_blocks(shape):
    """Of what is in whole blocks; a remainder is left out."""
    random = np.random.default_rng(1)
    moved, texture, across, down = random.normal(size=(4, *shape)).astype(np.float32)
    difference = moved - texture
    rows, columns = shape[0] // BLOCK, shape[1] // BLOCK
    expected = [
        values[: rows * BLOCK, : columns * BLOCK].reshape(rows, BLOCK, columns, BLOCK).mean(axis=(1, 3))
        for values in (difference**2, moved**2, difference * across, difference * down)
    ]
    assert compare_blocks(moved, texture, across, down) == pytest.approx(np.array(expected), abs=1e-5)


def test_a_block_that_the_frame_does_not_fill_is_nan():
    """One pixel of it is enough; the others are compared."""
    texture, moved = np.zeros((16, 16), np.float32), np.zeros((16, 16), np.float32)
    moved[15, 0] = np.nan
    means = compare_blocks(moved, texture, texture, texture)
    assert np.isnan(means).all(axis=0).tolist() == [[False, False], [True, False]]


def test_an_image_smaller_than_a_block_is_one_block():
    """Its mean is over the pixels there are."""
    moved, none = np.full((5, 6), 2.0, np.float32), np.zeros((5, 6), np.float32)
    assert compare_blocks(moved, none, none, none)[:, 0, 0].tolist() == [4.0, 4.0, 0.0, 0.0]
