"""Transforms of small grids."""

import numpy as np
import pytest

from streamkit_tracker.appearance.grid_spectra import Cutter, images_of, spectra_of


def pictures(side: int) -> np.ndarray:
    """Four noisy pictures."""
    return np.random.default_rng(0).standard_normal((2, 2, side, side)).astype(np.float32)


@pytest.mark.parametrize("side", [8, 32])
def test_spectra_are_those_of_the_fast_transform(side: int):
    """The same numbers in the same order as of numpy, and back again."""
    spectra = spectra_of(pictures(side))
    np.testing.assert_allclose(spectra, np.fft.rfft2(pictures(side)), atol=1e-4)
    np.testing.assert_allclose(images_of(spectra), pictures(side), atol=1e-5)


def test_a_rectangle_is_cut_out_among_spectra():
    """As if the picture had been set to zero outside."""
    down, along = np.arange(32) % 30 > 17, np.arange(32) < 11
    cut = images_of(Cutter(down, along)(spectra_of(pictures(32)[0])))
    np.testing.assert_allclose(cut, pictures(32)[0] * np.outer(down, along), atol=1e-5)
