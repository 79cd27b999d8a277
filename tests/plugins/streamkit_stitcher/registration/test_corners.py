"""Corner points spread over the frame."""

import numpy as np
import pytest

from streamkit_stitcher.registration.corners import even_corners


def test_every_cell_gives_its_best_corner(ground):
    """Of textured ground nearly all cells have a corner, and no part of the frame has many more."""
    points = even_corners(ground[:360, :640], 16, 9)
    assert 130 <= len(points) <= 144
    blocks = np.histogram2d(points[:, 0], points[:, 1], bins=(4, 3), range=[[0, 640], [0, 360]])[0]
    assert blocks.min() >= 8
    assert blocks.max() <= 16


def test_cells_of_mere_noise_give_no_corner(ground):
    """Where half of the frame is flat but for noise, the corners lie in the other half."""
    frame = ground[:360, :640].astype(float)
    frame[:, 320:] = 100
    noisy = np.clip(frame + np.random.default_rng(0).normal(0, 3, frame.shape), 0, 255).astype(np.uint8)
    points = even_corners(noisy, 16, 9)
    assert len(points) > 50
    assert (points[:, 0] > 330).sum() < 0.1 * len(points)


@pytest.mark.parametrize("shape", [(90, 160), (9, 9), (1, 500), (18, 400)])
def test_a_flat_or_tiny_frame_has_no_even_corners(shape):
    """An empty array of points, whatever the size."""
    assert even_corners(np.full(shape, 77, np.uint8), 25, 16).shape == (0, 2)
