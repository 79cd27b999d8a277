"""The filter that keeps to the target's own sides."""

import numpy as np
import pytest
import scipy.fft

from streamkit_tracker.appearance.constrained_filter import ConstrainedFilter

GRID = 32
SCALE = (3.0, 3.0)


def wanted() -> np.ndarray:
    """A narrow peak where the target has not moved."""
    shifts = scipy.fft.fftfreq(GRID) * GRID
    peak = np.exp(-0.5 * (shifts / 1.0) ** 2)
    return scipy.fft.rfft2(np.outer(peak, peak)).astype(np.complex64)


def scene(ground_seed: int, shift: tuple[int, int] = (0, 0), target_seed: int = 1) -> np.ndarray:
    """Spectrum of two noisy channels: a target of a third of the patch upon a ground."""
    picture = np.random.default_rng(ground_seed).standard_normal((2, GRID, GRID)).astype(np.float32)
    target = np.random.default_rng(1000 + target_seed).standard_normal((2, 12, 12)).astype(np.float32)
    row, column = 10 + shift[0], 10 + shift[1]
    picture[:, row : row + 12, column : column + 12] = 1.5 * target
    return scipy.fft.rfft2(picture, axes=(1, 2)).astype(np.complex64)


def response(discriminator: ConstrainedFilter, spectrum: np.ndarray) -> np.ndarray:
    """float[grid, grid]."""
    return scipy.fft.irfft2(discriminator.respond(spectrum), s=(GRID, GRID))


@pytest.mark.parametrize("shift", [(0, 0), (3, -5), (-7, 6)])
def test_a_shift_is_found_on_another_ground(shift: tuple[int, int]):
    """The peak is where the target went, though nothing else of the patch was ever seen."""
    discriminator = ConstrainedFilter(scene(0), wanted(), SCALE)
    found = np.unravel_index(int(np.argmax(response(discriminator, scene(5, shift)))), (GRID, GRID))
    assert tuple((np.array(found) + GRID // 2) % GRID - GRID // 2) == shift


def test_coefficients_stay_inside_the_target():
    """Nearly all of the filter's energy lies within the sides of the target, once it is learnt."""
    discriminator = ConstrainedFilter(scene(0), wanted(), SCALE)
    flat = np.ones((GRID, GRID // 2 + 1), np.complex64)  # a single bright sample: answered with the filter
    alone = [flat * (np.arange(2) == channel)[:, None, None] for channel in range(2)]
    energy = np.sum([response(discriminator, each) ** 2 for each in alone], axis=0)
    assert energy[11:23, 11:23].sum() > 0.95 * energy.sum()


def test_many_patches_of_another_look_are_learnt():
    """A target that looks otherwise for long becomes that look."""
    discriminator = ConstrainedFilter(scene(0), wanted(), SCALE)
    before = response(discriminator, scene(40, target_seed=2))[0, 0]
    for ground in range(1, 30):
        discriminator.learn(scene(ground, target_seed=2))
    assert response(discriminator, scene(40, target_seed=2))[0, 0] > before + 0.3


def test_what_is_believed_less_moves_the_filter_less():
    """A patch of another look, learnt by a tenth, is answered less than one that is learnt in full."""
    heights = []
    for share in (0.1, 1.0):
        discriminator = ConstrainedFilter(scene(0), wanted(), SCALE)
        discriminator.learn(scene(1, target_seed=2), share)
        heights.append(response(discriminator, scene(40, target_seed=2))[0, 0])
    assert heights[0] < heights[1]


def test_a_flat_patch_gives_a_finite_filter():
    """Nothing divides by the power of a constant."""
    flat = np.zeros((2, GRID, GRID // 2 + 1), np.complex64)
    discriminator = ConstrainedFilter(flat, wanted(), SCALE)
    discriminator.learn(flat)
    assert not np.any(discriminator.respond(wanted() * np.ones((2, 1, 1), np.complex64)))
