"""Trails."""

import numpy as np

from streamkit_tracker.trail import MAX_POSITIONS, extended, span, steadiness, straightness


def path(steps: np.ndarray) -> np.ndarray:
    """A trail that begins at 0 and goes on at these positions, float64[n, 2]."""
    trail = np.zeros((1, 2))
    for position in steps:
        trail = extended(trail, position)
    return trail


def line(frames: int) -> np.ndarray:
    """A straight trail."""
    return path(np.arange(1, frames)[:, None] * [2.0, 1.0])


def tremble(frames: int) -> np.ndarray:
    """A trail about one place."""
    return path(np.random.default_rng(0).standard_normal((frames - 1, 2)))


def test_straightness_tells_travel_from_trembling():
    """A line has straightness 1, a tremble near 0."""
    assert straightness(line(15)) > 0.99
    assert straightness(tremble(15)) < 0.3
    assert np.hypot(*span(line(15))) > 5 * np.hypot(*span(tremble(15)))


def test_a_trail_is_bounded():
    """The oldest positions go."""
    assert len(line(100)) == MAX_POSITIONS


def test_only_a_long_straight_path_is_steady():
    """Trembling, or a path of a few frames, says nothing about the next second."""
    assert steadiness(line(MAX_POSITIONS)) == 1.0
    assert steadiness(line(2)) == steadiness(tremble(MAX_POSITIONS)) == 0.0
