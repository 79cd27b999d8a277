"""What the correlation filter sees."""

import numpy as np
import pytest

from streamkit_tracker.appearance.gradient_channels import (
    CHANNELS,
    DIRECTIONS,
    GRID,
    SAMPLES,
    gradient_channels,
)


def stripes(angle: float) -> np.ndarray:
    """A patch float32[1, samples, samples] that rises along an angle, step by step."""
    rows, columns = np.mgrid[:SAMPLES, :SAMPLES] - SAMPLES / 2
    along = columns * np.cos(angle) + rows * np.sin(angle)
    return (40 * np.tanh(3 * np.sin(along / 6)) + 20 * along / SAMPLES).astype(np.float32)[None]


@pytest.mark.parametrize("direction", range(DIRECTIONS))
def test_a_gradient_shows_most_in_its_own_direction(direction: int):
    """Eight directions, 45 degrees apart from +x towards +y: waves show in theirs and the opposite one."""
    power = np.square(gradient_channels(stripes(direction * np.pi / 4))[0, :DIRECTIONS]).sum(axis=(1, 2))
    assert set(np.argsort(power)[-2:]) == {direction, (direction + 4) % DIRECTIONS}


def test_each_patch_is_seen_by_itself():
    """What a patch shows does not depend on the ones beside it."""
    patches = np.random.default_rng(0).normal(0, 30, (3, SAMPLES, SAMPLES)).astype(np.float32)
    together = gradient_channels(patches)
    np.testing.assert_array_equal(together[1:2], gradient_channels(patches[1:2]))
    assert np.abs(together.mean(axis=(2, 3))).max() < 0.1


def test_a_flat_patch_gives_channels_of_nothing():
    """Nothing divides by the contrast of a constant."""
    channels = gradient_channels(np.full((2, SAMPLES, SAMPLES), 7.0, np.float32))
    assert channels.shape == (2, CHANNELS, GRID, GRID)
    np.testing.assert_allclose(channels, 0.0, atol=1e-5)
