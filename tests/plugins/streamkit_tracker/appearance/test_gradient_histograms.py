"""Histograms of oriented gradients."""

import numpy as np
import pytest

from streamkit_tracker.appearance.gradient_histograms import CHANNELS, HALF, gradient_channels


def ramp(angle: float) -> np.ndarray:
    """Grey levels that rise by 4 a sample along an angle, float32[32, 48]."""
    down, along = np.mgrid[:32, :48].astype(np.float32)
    return (4 * (np.cos(angle) * along + np.sin(angle) * down)).astype(np.float32)


@pytest.mark.parametrize("direction", range(2 * HALF))
def test_a_ramp_lies_in_its_direction(direction: int):
    """All inner cells have their gradient in one of 18 directions, and in the one of 9 without sign."""
    channels = gradient_channels(ramp(direction * np.pi / HALF)[None])[0]
    assert channels.shape == (CHANNELS, 8, 12)
    inner = channels[:, 2:-2, 2:-2]
    assert (inner[: 2 * HALF].argmax(axis=0) == direction).all()
    assert (inner[2 * HALF : 3 * HALF].argmax(axis=0) == direction % HALF).all()


def test_contrast_hardly_counts():
    """Half the contrast gives nearly the same channels."""
    patch = np.random.default_rng(1).uniform(-100, 100, (1, 32, 32)).astype(np.float32)
    np.testing.assert_allclose(gradient_channels(patch), gradient_channels(patch / 2), atol=0.01)


def test_a_flat_patch_has_no_gradient():
    """Nothing is divided by zero."""
    assert not gradient_channels(np.full((1, 16, 16), 7, np.float32)).any()
