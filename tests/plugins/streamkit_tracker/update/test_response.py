"""Where the filter is asked, and what the particles are to expect."""

import math
from types import ModuleType

import numpy as np
import pytest

from streamkit_tracker.appearance.correlation_filter import CorrelationFilter, Response
from streamkit_tracker.appearance.window_sampling import WindowSampler
from streamkit_tracker.update.evidence import Evidence
from streamkit_tracker.update.layered_filter import SEARCH
from streamkit_tracker.update.response import expect_response, find_response

WINDOW = np.array([100.0, 80, 40, 10, 0.3])


def test_the_softer_the_target_the_more_the_filter_counts():
    """A rigid target is rather free to turn; a soft one is held to the filter's size and the drawn angle."""
    response = Response(np.array([101.0, 79.0, 40.0, 10.0, 0.3]), 0.7, 20.0)
    rigid, soft = rows = np.zeros(2, SEARCH)
    for row, tolerance in zip(rows, (1.0, 9.0), strict=True):
        expect_response(row, response, tolerance, 0.3)
    assert rigid["heading_precision"] < 0.3**-2
    assert soft["heading_precision"] > 0.05**-2
    assert soft["sides_precision"] == pytest.approx(9 * rigid["sides_precision"])
    assert soft["seed_std"] == pytest.approx(rigid["seed_std"] / 3)
    assert rows["seed"].tolist() == [[101.0, 79.0]] * 2


def found(
    scenes: ModuleType,
    drawn: np.ndarray,
    now: np.ndarray,
    predicted: np.ndarray,
    unmoved: np.ndarray | None = None,
    *,
    is_unseen: bool = False,
) -> Response | None:
    """Evidence of a textured target that trembled for ten frames where it was drawn, and is elsewhere."""
    generator = np.random.default_rng(4)
    backdrop, texture = scenes.ground(generator, 240, 320), scenes.blob_texture(generator)
    sampler, evidence = WindowSampler(), Evidence(lost_threshold=0.6, update_threshold=0.85)
    sampler.set_frame(scenes.grey(scenes.paint(backdrop, texture, drawn), generator, 2.0))
    discriminator = CorrelationFilter(sampler, drawn)
    for _ in range(10):
        near = drawn + generator.normal(0, 2, 5) * [1, 1, 0, 0, 0]
        sampler.set_frame(scenes.grey(scenes.paint(backdrop, texture, near), generator, 2.0))
        usual = discriminator.respond(sampler, drawn)
        evidence.judge(0.02, usual, informative=True)
    sampler.set_frame(scenes.grey(scenes.paint(backdrop, texture, now), generator, 2.0))
    unmoved = predicted if unmoved is None else unmoved
    return find_response(discriminator, evidence, sampler, predicted, unmoved, is_unseen=is_unseen)


@pytest.mark.parametrize("step", [(30.0, 0.0), (-12.0, 26.0)])
def test_a_jump_by_most_of_a_side_is_followed(scenes: ModuleType, step: tuple[float, float]):
    """Within half a pixel: what is too faint to be believed from afar is asked for again from near by."""
    drawn = np.array([150.0, 120, 40, 34, 0.0])
    now = drawn + np.array([*step, 0, 0, 0])
    response = found(scenes, drawn, now, drawn)
    assert response is not None
    assert math.dist(response.window[:2], now[:2]) < 0.5


def test_a_target_that_stops_is_found_where_it_was(scenes: ModuleType):
    """Though it was expected to go on by more than a side."""
    drawn = np.array([150.0, 120, 40, 34, 0.0])
    response = found(scenes, drawn, drawn, drawn + np.array([44.0, 0, 0, 0, 0]))
    assert response is not None
    assert math.dist(response.window[:2], drawn[:2]) < 1.0


def test_a_target_that_stands_on_the_ground_is_found_where_the_camera_has_moved_it(scenes: ModuleType):
    """By more than a side in one frame."""
    drawn = np.array([150.0, 120, 40, 34, 0.0])
    now = drawn + np.array([52.0, 0, 0, 0, 0])
    response = found(scenes, drawn, now, now, unmoved=drawn)
    assert response is not None
    assert math.dist(response.window[:2], now[:2]) < 1.0


def test_an_unseen_target_is_found_again_where_it_was_last_in_the_picture(scenes: ModuleType):
    """The camera has followed it, while the ground has carried the prediction away."""
    drawn = np.array([150.0, 120, 40, 34, 0.0])
    away = drawn + np.array([120.0, 60, 0, 0, 0])
    response = found(scenes, drawn, drawn, away, unmoved=drawn, is_unseen=True)
    assert response is not None
    assert math.dist(response.window[:2], drawn[:2]) < 1.0


@pytest.mark.parametrize("grown", [0.97, 1.02, 1.045])
def test_sizes_between_those_asked_at_are_found(scenes: ModuleType, grown: float):
    """Within 1.5 per cent, with one aspect."""
    drawn = np.array([150.0, 120, 60, 50, 0.0])
    response = found(scenes, drawn, drawn * [1, 1, grown, grown, 1], drawn)
    assert response is not None
    assert response.window[2] == pytest.approx(60 * grown, rel=0.015)
    assert response.window[2] / response.window[3] == pytest.approx(1.2)


def test_a_target_that_the_camera_follows_is_found_where_it_was(scenes: ModuleType):
    """The ground beneath it has moved by three sides, the target has not moved in the picture."""
    drawn = np.array([150.0, 120, 40, 34, 0.0])
    response = found(scenes, drawn, drawn, drawn + np.array([110.0, 0, 0, 0, 0]), drawn)
    assert response is not None
    assert math.dist(response.window[:2], drawn[:2]) < 1.0


@pytest.mark.parametrize(("x", "is_found"), [(3.0, True), (-3.0, False), (323.0, False)])
def test_a_peak_beyond_the_picture_is_no_response(
    scenes: ModuleType, monkeypatch: pytest.MonkeyPatch, x: float, is_found: bool
):
    """However sharp: the region only repeats the picture's edge there."""
    drawn = np.array([150.0, 120, 40, 34, 0.0])
    peak = Response(np.array([x, 120.0, 40.0, 34.0, 0.0]), 0.8, 20.0)
    monkeypatch.setattr(CorrelationFilter, "respond", lambda *_: peak)
    assert (found(scenes, drawn, drawn, drawn) is not None) == is_found
