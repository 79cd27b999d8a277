"""Finding a target anywhere in the frame."""

from types import ModuleType

import numpy as np
import pytest

from streamkit_tracker.appearance.background_classifier import BackgroundClassifier
from streamkit_tracker.appearance.frame_detector import FrameDetector, ScoreMap
from streamkit_tracker.appearance.window_sampling import WindowSampler

DRAWN = np.array([150.0, 120, 40, 34, 0.0])


def scores_of(
    scenes: ModuleType, shown: np.ndarray, asked: np.ndarray, drawn: np.ndarray = DRAWN
) -> ScoreMap:
    """What a detector that was started at `drawn` says of a frame with the target at `shown`."""
    generator = np.random.default_rng(4)
    ground, texture = scenes.ground(generator, 240, 320), scenes.blob_texture(generator)
    sampler = WindowSampler()
    sampler.set_frame(scenes.grey(scenes.paint(ground, texture, drawn), generator, 2.0))
    detector = FrameDetector(sampler, drawn)
    sampler.set_frame(scenes.grey(scenes.paint(ground, texture, shown), generator, 2.0))
    return detector.score(sampler, asked)


@pytest.mark.parametrize("place", [(40, 40), (280, 60), (60, 200), (150, 121)])
def test_a_target_is_found_far_from_where_it_is_looked_for(scenes: ModuleType, place: tuple[float, float]):
    """To half a cell, and nothing else is half as much like it."""
    shown = DRAWN.copy()
    shown[:2] = place
    score_map = scores_of(scenes, shown, DRAWN)
    assert np.hypot(*(score_map.best_position() - place)) <= 5.0
    here, elsewhere = score_map.best_scores(shown[:2])
    assert here > 2 * max(elsewhere, 0.0)


def test_a_larger_turned_target_is_found_at_its_size_and_turn(scenes: ModuleType):
    """The frame is read as the window is."""
    shown = np.array([220.0, 150, 60, 51, 0.4])
    asked = np.array([150.0, 120, 60, 51, 0.4])
    score_map = scores_of(scenes, shown, asked)
    assert np.hypot(*(score_map.best_position() - shown[:2])) <= 8.0


def test_places_beyond_the_frame_do_not_count(scenes: ModuleType):
    """A turned region reaches beyond it."""
    asked = np.array([150.0, 120, 40, 34, 0.8])
    score_map = scores_of(scenes, DRAWN, asked)
    x, y = score_map.positions[np.isfinite(score_map.scores)].T
    assert not np.isfinite(score_map.scores).all()
    assert min(x.min(), y.min()) >= 0
    assert x.max() <= 319
    assert y.max() <= 239


def test_the_scores_of_look_and_background_are_one_and_zero():
    """Whatever both are; a part of the look that the background has, too, counts little."""
    generator = np.random.default_rng(0)
    background = generator.standard_normal((300, 20)).astype(np.float32) + 2
    background[:, 3] *= 30
    look = np.full(20, 5.0, np.float32)
    classifier = BackgroundClassifier(look, background)
    classifier.learn(look, background)
    assert look @ classifier.weights + classifier.bias == pytest.approx(1.0, abs=1e-3)
    assert background.mean(axis=0) @ classifier.weights + classifier.bias == pytest.approx(0.0, abs=1e-3)
    assert abs(classifier.weights[3]) < 0.5 * abs(classifier.weights).max()


def test_a_flat_background_is_told_from_the_target():
    """Nothing varies, and nothing is divided by zero."""
    background, look = np.zeros((50, 8), np.float32), np.ones(8, np.float32)
    classifier = BackgroundClassifier(look, background)
    assert look @ classifier.weights + classifier.bias == pytest.approx(1.0, abs=1e-3)
