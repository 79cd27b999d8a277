"""What is too unlike for a target."""

import math

import numpy as np
import pytest

from streamkit_tracker.appearance.mean_features import MIN_LIMIT, USUAL_TIMES, MeanFeatures


def turned(angle: float) -> np.ndarray:
    """A unit vector at an angle to the first axis, rad."""
    return np.array([np.cos(angle), np.sin(angle)])


def difference(features: MeanFeatures, vector: np.ndarray) -> float:
    """One minus the cosine between the mean and a unit vector."""
    return float(1 - features.mean @ vector / np.linalg.norm(features.mean))


def learn(features: MeanFeatures, vector: np.ndarray) -> None:
    """One detection of the target."""
    features.learn(vector, difference(features, vector), 0.05)


def test_the_limit_follows_the_usual_difference():
    """A target that looks the same in each frame is known better than one that varies."""
    steady, varied = MeanFeatures(turned(0), 0), MeanFeatures(turned(0), 0)
    for index in range(100):
        learn(steady, turned(0))
        learn(varied, turned(0.6 * (-1) ** index))
    assert steady.limit == pytest.approx(MIN_LIMIT, abs=1e-4)
    assert varied.limit == pytest.approx(MIN_LIMIT + USUAL_TIMES * (1 - np.cos(0.6)), abs=0.05)


def test_nothing_is_too_unlike_while_the_usual_difference_is_not_known():
    """A target may vary much from its first frame on, as where noise is all that it shows."""
    features = MeanFeatures(turned(0), 0)
    assert features.limit == math.inf
    for index in range(20):
        learn(features, turned(0.7 * (-1) ** index))
        assert features.limit > 1 - np.cos(0.7)


def test_the_mean_moves_by_the_rate():
    """What covers a target for a few frames does not become its features."""
    features = MeanFeatures(turned(0), 3)
    for _ in range(5):
        learn(features, turned(np.pi / 2))
    assert difference(features, turned(0)) < 0.05
    assert features.version == 3
