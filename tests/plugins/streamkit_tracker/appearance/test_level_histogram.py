"""The grey levels that tell a target from its ground."""

import numpy as np
import pytest

from streamkit_tracker.appearance.gradient_channels import CELL, GRID, SAMPLES
from streamkit_tracker.appearance.level_histogram import LevelHistogram

SCALE = (3.0, 3.0)
SIDE = SAMPLES // 3


def scene(shift: tuple[int, int] = (0, 0), target: float = -60.0, ground: float = 40.0, seed: int = 0):
    """A patch with a dark target, `shift` cells down and along, upon a bright ground."""
    patch = ground + 10 * np.random.default_rng(seed).standard_normal((SAMPLES, SAMPLES))
    row, column = (SAMPLES - SIDE) // 2 + CELL * shift[0], (SAMPLES - SIDE) // 2 + CELL * shift[1]
    patch[row : row + SIDE, column : column + SIDE] += target - ground
    return patch.astype(np.float32).ravel()


@pytest.mark.parametrize("shift", [(0, 0), (4, -6), (-7, 3)])
def test_a_target_is_found_by_its_levels(shift: tuple[int, int]):
    """The highest share is where it went, within a cell, with as much of it as was learnt."""
    answer = LevelHistogram(scene(), SCALE).respond(scene(shift, seed=1))
    row, column = np.unravel_index(int(np.argmax(answer.shares)), (GRID, GRID))
    there = answer.relative_share(shift[0] % GRID, shift[1] % GRID)
    assert np.abs((np.array([row, column]) + GRID // 2) % GRID - GRID // 2 - shift).max() <= 2
    assert answer.trust == 1.0
    assert there == pytest.approx(1.0, abs=0.05)


def test_a_place_with_the_levels_of_the_ground_is_unlike():
    """What covers a target with ground leaves less than half of its relative_share."""
    assert LevelHistogram(scene(), SCALE).respond(scene(target=40.0)).relative_share(0, 0) < 0.5


def test_a_new_light_says_nothing():
    """When the ground has other levels too, nothing is concluded, neither for nor against."""
    answer = LevelHistogram(scene(), SCALE).respond(scene(target=20.0, ground=110.0))
    assert answer.trust == 0.0
    assert answer.relative_share(0, 0) == 1.0


def test_a_new_light_is_learnt():
    """After some frames of other levels these are trusted, and the target is told from its ground again."""
    levels = LevelHistogram(scene(), SCALE)
    for seed in range(80):
        levels.learn(scene(target=20.0, ground=110.0, seed=seed))
    answer = levels.respond(scene((5, 5), target=20.0, ground=110.0))
    assert answer.trust == 1.0
    assert answer.shares[5, 5] > 0.8
    assert answer.shares[-8, -8] < 0.2


@pytest.mark.parametrize("level", [-128.0, 0.0, 127.9])
def test_a_flat_patch_gives_no_place(level: float):
    """Target and ground alike: every place that the patch holds has the same finite share."""
    flat = np.full(SAMPLES * SAMPLES, level, np.float32)
    shares = LevelHistogram(flat, SCALE).respond(flat).shares
    np.testing.assert_allclose(shares[:8, :8], shares[0, 0], rtol=1e-5)
    assert np.isfinite(shares).all()
