"""Blocks are cut row by row and joined again."""

import numpy as np
import pytest

from streamkit_wavelet_eigen.feature_space import cut_blocks, join_blocks


def test_blocks_run_row_by_row() -> None:
    """Block 1 is right of block 0; the pixels of a block are row by row too."""
    image = np.arange(24, dtype=np.float32).reshape(1, 4, 6)
    blocks = cut_blocks(image, 2)
    assert blocks[0].tolist() == [
        [0, 1, 2, 6, 7, 8], [3, 4, 5, 9, 10, 11], [12, 13, 14, 18, 19, 20], [15, 16, 17, 21, 22, 23],
    ]  # fmt: skip


@pytest.mark.parametrize("blocks", [1, 2, 4])
@pytest.mark.parametrize("count", [0, 1, 5])
def test_joined_blocks_are_the_image(blocks: int, count: int) -> None:
    """Cutting and joining gives every image back, none included."""
    images = np.random.default_rng(blocks).normal(size=(count, 8, 12)).astype(np.float32)
    np.testing.assert_array_equal(join_blocks(cut_blocks(images, blocks), (8, 12)), images)
