"""What is too unlike for a target."""

import numpy as np
import pytest

from streamkit_tracker.appearance.look import FIRST_DIFFERENCE, MIN_LIMIT, USUAL_TIMES, Look, differences


def turned(angle: float) -> np.ndarray:
    """A unit vector at an angle to the first axis, rad."""
    return np.array([np.cos(angle), np.sin(angle)])


def test_the_limit_follows_the_usual_difference():
    """A target that looks the same in each frame is known better than one that varies."""
    steady, varied = Look(turned(0), 0), Look(turned(0), 0)
    assert steady.limit == MIN_LIMIT + USUAL_TIMES * FIRST_DIFFERENCE
    for index in range(100):
        steady.learn(turned(0), 0.05)
        varied.learn(turned(0.6 * (-1) ** index), 0.05)
    assert steady.limit == pytest.approx(MIN_LIMIT, abs=1e-4)
    assert varied.limit == pytest.approx(MIN_LIMIT + USUAL_TIMES * (1 - np.cos(0.6)), abs=0.05)


def test_the_mean_moves_by_the_rate():
    """What covers a target for a few frames does not become its look."""
    look = Look(turned(0), 3)
    for _ in range(5):
        look.learn(turned(np.pi / 2), 0.05)
    unlike = differences([look], turned(0)[None].astype(np.float32))
    assert unlike[0, 0] < 0.05
    assert look.version == 3
