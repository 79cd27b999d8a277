"""Equalisation against OpenCV's, patch by patch."""

import cv2
import numpy as np
import pytest

from streamkit_wavelet_eigen.preprocessing_kernels import equalise


@pytest.mark.parametrize("levels", [1, 2, 7, 256])
def test_equalised_levels_are_those_of_opencv(levels: int) -> None:
    """Every grey level is the one that cv2.equalizeHist gives, for images of few levels and of many."""
    generator = np.random.default_rng(levels)
    shades, chosen = generator.integers(0, 256, (40, levels)), generator.integers(0, levels, (40, 240))
    patches = np.take_along_axis(shades, chosen, axis=1).reshape(40, 12, 20).astype(np.uint8)
    equalised = patches.astype(np.float32)
    equalise(equalised)
    np.testing.assert_array_equal(equalised, np.stack([cv2.equalizeHist(patch) for patch in patches]))


def test_levels_between_are_rounded_and_held_in_range() -> None:
    """Levels are rounded first, and what lies beyond 0 and 255 counts as these."""
    given = np.array([[[-3.0, 0.4, 90.6, 91.2, 255.4, 300.0]]], np.float32)
    rounded = np.array([[[0, 0, 91, 91, 255, 255]]], np.uint8)
    equalise(given)
    np.testing.assert_array_equal(given[0], cv2.equalizeHist(rounded[0]))
