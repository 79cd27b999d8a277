"""The filter with its weights inside the target."""

import copy

import numpy as np
import pytest
import scipy

from streamkit_tracker.appearance.background_aware_filter import BackgroundAwareFilter
from streamkit_tracker.appearance.region_features import GRID

EXTENT = np.array([0.25, 0.2])
MIDDLE = GRID // 2


def region(shift: tuple[int, int] = (0, 0), target: int = 1, ground: int = 0) -> np.ndarray:
    """Spectra of four channels: a target of 10 x 8 cells, moved by cells along and down, upon a ground."""
    channels = 0.5 * np.random.default_rng(ground).standard_normal((4, GRID, GRID))
    top, left = MIDDLE - 4 + shift[1], MIDDLE - 5 + shift[0]
    channels[:, top : top + 8, left : left + 10] = np.random.default_rng(target).standard_normal((4, 8, 10))
    return scipy.fft.rfft2(channels.astype(np.float32))


@pytest.mark.parametrize("shift", [(0, 0), (7, -4), (-12, 9)])
def test_a_target_is_found_upon_another_ground(shift: tuple[int, int]):
    """The peak is where it went, though it was learnt before one background only."""
    response = BackgroundAwareFilter(region(), EXTENT).respond(region(shift, ground=99))
    row, column = np.unravel_index(int(response.argmax()), response.shape)
    assert (column - MIDDLE, row - MIDDLE) == shift
    assert response.max() > 0.3


def test_the_ground_that_was_learnt_does_not_respond():
    """Without the target the response is a third of what it was at most."""
    learnt = BackgroundAwareFilter(region(), EXTENT)
    assert learnt.respond(region(target=7)).max() < learnt.respond(region()).max() / 3


def test_a_cover_of_ten_frames_does_not_replace_the_target():
    """A running mean of the regions: the target is known after the cover, and better than that."""
    learnt = BackgroundAwareFilter(region(), EXTENT)
    for _ in range(10):
        learnt.learn(region(target=7), 1.0)
    assert learnt.respond(region()).max() > learnt.respond(region(target=7)).max()


def test_a_new_look_is_learnt_in_time():
    """After a hundred frames the response is to the new look."""
    learnt = BackgroundAwareFilter(region(), EXTENT)
    for _ in range(100):
        learnt.learn(region(target=7), 1.0)
    assert learnt.respond(region(target=7)).max() > 2 * learnt.respond(region()).max()


def test_a_mixture_responds_as_the_mean_of_both():
    """By their weights, and neither of the two is changed."""
    earlier = BackgroundAwareFilter(region(), EXTENT)
    latest = copy.copy(earlier)
    latest.learn(region(target=7), 1.0)
    both = [each.respond(region()) for each in (latest, earlier)]
    mixed = latest.mixed(earlier, 0.3).respond(region())
    assert np.abs(both[0] - both[1]).max() > 0.01
    assert mixed == pytest.approx(0.7 * both[0] + 0.3 * both[1], abs=1e-5)
    assert latest.respond(region()) == pytest.approx(both[0])


def test_a_flat_region_gives_a_flat_response():
    """Nothing is divided by its power."""
    nothing = np.zeros((4, GRID, GRID // 2 + 1), np.complex64)
    assert not BackgroundAwareFilter(nothing, EXTENT).respond(nothing).any()
