"""Eigen-images: the mean and the eigenvectors as grey images."""

import numpy as np
import pytest

from streamkit_wavelet_eigen.eigen_images import eigen_images, image_grid
from streamkit_wavelet_eigen.feature_space import learn_space
from streamkit_wavelet_eigen.recipe import Basis, Mode, Preprocessing, Recipe


def _windows(count: int = 12) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (count, 16, 16)).astype(np.float32)


@pytest.mark.parametrize(
    ("blocks", "basis", "side"), [(1, Basis.SHARED, 16), (4, Basis.SHARED, 4), (4, Basis.PER_BLOCK, 16)]
)
def test_mean_and_eigenvectors(blocks: int, basis: Basis, side: int) -> None:
    """The mean first; then each eigenvector around middle grey, its strongest pixel black or white."""
    space = learn_space(_windows(), Recipe(16, Preprocessing(Mode.RAW), blocks, basis, 5))
    images = eigen_images(space, 3)
    assert images.shape == (4, side, side)
    assert images.dtype == np.uint8
    if blocks == 1:
        np.testing.assert_allclose(images[0], _windows().mean(axis=0), atol=0.51)
        expected = space.spaces[0].basis[0] / np.abs(space.spaces[0].basis[0]).max() * 127 + 128
        np.testing.assert_allclose(images[1].ravel(), expected, atol=0.51)
    assert all(
        max(255 - int(image.max()), int(image.min()) - 1) == 0 or image.max() == 255 for image in images[1:]
    )


def test_a_space_without_directions_shows_its_mean() -> None:
    """One window has no eigenvector to show."""
    space = learn_space(_windows(1), Recipe(16, Preprocessing(Mode.RAW), components=4))
    np.testing.assert_allclose(eigen_images(space), _windows(1), atol=0.51)


def test_images_lie_side_by_side() -> None:
    """Row by row with white between and at the end."""
    sheet = image_grid(np.zeros((3, 4, 5), np.uint8), columns=2)
    assert sheet.shape == (10, 12)
    assert (sheet[:4, :5] == 0).all()
    assert (sheet[:4, 5:7] == 255).all()
    assert (sheet[6:, 7:] == 255).all()
