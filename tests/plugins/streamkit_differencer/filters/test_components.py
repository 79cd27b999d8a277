"""Connected pieces of a mask."""

import cv2
import numpy as np
import pytest

from streamkit_differencer.filters.components import components_of, remove_blocks

SHAPE = (61, 83)


def random_mask(seed, share):
    """Blobs and specks."""
    random = np.random.default_rng(seed)
    mask = np.where(random.random(SHAPE) < share, 255, 0).astype(np.uint8)
    return cv2.dilate(mask, np.ones((2, 3), np.uint8))


@pytest.mark.parametrize("share", [0.0, 0.01, 0.05, 0.2, 1.0])
@pytest.mark.parametrize("seed", range(3))
def test_pieces_are_connected_components_of_blocks(seed, share):
    """Those of OpenCV, whatever their numbers; an odd last line or column is left out."""
    mask = random_mask(seed, share)
    blocks, count = components_of(mask)
    inside = mask[:60, :82].reshape(30, 2, 41, 2).max(axis=(1, 3))
    expected_count, labels = cv2.connectedComponents(inside, connectivity=8)
    assert count == expected_count - 1
    assert len(blocks) == np.count_nonzero(inside)
    pairs = {(labels[row // 2, column // 2], piece) for row, column, piece in blocks.tolist()}
    assert len(pairs) == count
    assert 0 not in {label for label, _ in pairs}


def test_blocks_that_are_removed_are_learnt():
    """Where they are quiet; other components stay foreground and teach nothing."""
    mask, quiet = np.zeros(SHAPE, np.uint8), np.zeros(SHAPE, np.uint8)
    mask[30:34, 12:16] = mask[30:34, 52:56] = 255
    quiet[:, 14:] = 255
    image, background = np.full(SHAPE, 9, np.uint8), np.full(SHAPE, 1.0, np.float32)
    blocks, count = components_of(mask)
    assert count == 2
    remove_blocks(blocks[blocks[:, 2] == 0], mask, quiet, image, background)
    assert not mask[:, :40].any()
    assert mask[30:34, 52:56].all()
    assert (background[30:34, 14:16] == 9).all()
    assert np.count_nonzero(background == 9) == 8
