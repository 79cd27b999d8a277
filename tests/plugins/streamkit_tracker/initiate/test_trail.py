"""Trails."""

import numpy as np

from streamkit_tracker.initiate.trail import LONGEST, Trail


def test_straightness_tells_travel_from_trembling():
    """A line has straightness 1, a tremble near 0."""
    line, tremble = Trail((0.0, 0.0)), Trail((0.0, 0.0))
    generator = np.random.default_rng(0)
    for index in range(1, 15):
        line.add((2.0 * index, 1.0 * index))
        x, y = generator.standard_normal(2)
        tremble.add((float(x), float(y)))
    assert line.straightness > 0.99
    assert tremble.straightness < 0.3
    assert line.travelled > 5 * tremble.travelled


def test_a_trail_is_bounded():
    """The oldest positions go."""
    trail = Trail((0.0, 0.0))
    for index in range(100):
        trail.add((float(index), 0.0))
    assert len(trail.positions) == LONGEST


def test_only_a_long_straight_path_is_steady():
    """Trembling, or a path of a few frames, says nothing about the next second."""
    line, short, tremble = Trail((0.0, 0.0)), Trail((0.0, 0.0)), Trail((0.0, 0.0))
    generator = np.random.default_rng(0)
    short.add((2.0, 1.0))
    for index in range(1, LONGEST):
        line.add((2.0 * index, 1.0 * index))
        x, y = generator.standard_normal(2)
        tremble.add((float(x), float(y)))
    assert line.steadiness == 1.0
    assert short.steadiness == tremble.steadiness == 0.0
