"""Squares cut in one pass against two steps on real numbers."""

import cv2
import numpy as np
import pytest

from streamkit_wavelet_eigen.square_windows import DEVIATION, SIDE, cut_squares


def _in_two_steps(image: np.ndarray, x: float, y: float, side: int, patch: int) -> np.ndarray:
    """The square between the pixels, then its scaled copy, without any rounding."""
    height, width = image.shape
    left, top = x - (side - 1) / 2, y - (side - 1) / 2
    columns = np.clip(np.floor(left) + np.arange(side + 1), 0, width - 1).astype(int)
    rows = np.clip(np.floor(top) + np.arange(side + 1), 0, height - 1).astype(int)
    square = image[np.ix_(rows, columns)].astype(np.float64)
    square = square[:, :-1] * (1 - left % 1) + square[:, 1:] * (left % 1)
    square = square[:-1] * (1 - top % 1) + square[1:] * (top % 1)
    interpolation = cv2.INTER_AREA if side > patch else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(square, (patch, patch), interpolation=interpolation))


@pytest.mark.parametrize("side", [1, 7, 16, 17, 40, 63, 100])
def test_a_square_is_shifted_and_scaled_and_only_then_rounded(side: int) -> None:
    """A patch is within half a grey level of both steps one by one, between pixels and beyond borders."""
    image = np.random.default_rng(1).integers(0, 256, (120, 160), np.uint8)
    middles = np.random.default_rng(side).uniform((-10, -10), (170, 130), (30, 2))
    boxes = np.column_stack([middles, np.full((30, 2), float(side)), np.zeros(30)])
    patches, squares = np.zeros((30, 16, 16), np.float32), np.empty((30, 7))
    cut_squares(image, boxes, 1.0, patches, squares)
    expected = np.stack([_in_two_steps(image, x, y, side, 16) for x, y in middles.tolist()])
    assert np.abs(patches - expected).max() < 0.51
    np.testing.assert_array_equal(squares[:, SIDE], side)
    np.testing.assert_allclose(squares[:, DEVIATION], patches.std(axis=(1, 2)), atol=1e-3)
