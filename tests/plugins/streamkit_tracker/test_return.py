"""A target drawn by hand that was lost and is in view again."""

import math
from types import ModuleType

import numpy as np
import pytest

from streamkit.geometry.track import Track, TrackState
from streamkit_tracker.appearance.correlation_filter import CorrelationFilter
from streamkit_tracker.appearance.filter_copies import FilterCopies
from streamkit_tracker.appearance.window_sampling import WindowSampler
from streamkit_tracker.observation import Observation
from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.tracker import MultiTargetTracker
from streamkit_tracker.update.redetection import CONTRADICTING, DETECT_EVERY, Redetector

STEP = Observation(0.04)
SETTINGS = TrackerSettings(auto_start=False)
BEFORE, GONE, AFTER = 40, 15, 45
RETURN = (290.0, 60.0)


def reports_of(scenes: ModuleType, back: tuple[float, float] | None, seed: int) -> list[Track | None]:
    """A target that moves, is gone, and comes back at another place, or not at all."""
    generator = np.random.default_rng(seed)
    ground, texture = scenes.ground(generator, 240, 360), scenes.blob_texture(generator)
    other = scenes.blob_texture(generator)
    tracker, reports = MultiTargetTracker(SETTINGS), []
    for index in range(BEFORE + GONE + AFTER):
        window = np.array([60.0 + index, 170, 36, 30, 0.0])
        picture = scenes.paint(ground, other, np.array([200.0, 40, 36, 30, 0.0]))
        if index >= BEFORE + GONE:
            window[:2] = back or (-100.0, -100.0)
        if not BEFORE <= index < BEFORE + GONE:
            picture = scenes.paint(picture, texture, window)
        image = scenes.grey(picture, generator, 2.0)
        if index == 0:
            reports.append(tracker.start_target(image, window, STEP))
        else:
            reports.append(next(iter(tracker.step(image, STEP)), None))
    return reports


def test_it_is_confirmed_again_far_from_where_it_was_lost(scenes: ModuleType):
    """Six sides away, within 25 frames, under its old id."""
    for seed in range(2):
        found = reports_of(scenes, RETURN, seed)[BEFORE + GONE + 25 :]
        assert all(report is not None and report.id == 1 for report in found)
        right = [
            report.state is TrackState.CONFIRMED and math.dist(report.turned_box[:2], RETURN) < 6
            for report in found
            if report is not None
        ]
        assert np.mean(right) > 0.9


def test_the_longer_it_is_not_sure_the_farther_it_may_be(scenes: ModuleType):
    """The filter goes on at a position that it believes; the target may have gone elsewhere."""
    reports = [report for report in reports_of(scenes, None, 0)[BEFORE:] if report is not None]
    confirmed, coasting = (
        [np.sqrt(report.covariance.trace() / 2) for report in reports if report.state is state]
        for state in (TrackState.CONFIRMED, TrackState.COASTING)
    )
    side = math.sqrt(36 * 30)
    assert max(confirmed, default=0.0) < 0.5 * side
    assert coasting[-1] > 2 * side


def test_another_object_is_not_taken_for_it(scenes: ModuleType):
    """One of its size with another look."""
    for seed in range(2):
        reports = reports_of(scenes, None, seed)[BEFORE + 10 :]
        assert not any(report is not None and report.state is TrackState.CONFIRMED for report in reports)


def test_detections_elsewhere_contradict_until_one_is_where_the_target_is_followed(scenes: ModuleType):
    """One detection elsewhere is chance, `CONTRADICTING` in a row are not; one in place ends it."""
    generator = np.random.default_rng(3)
    ground, texture = scenes.ground(generator, 240, 360), scenes.blob_texture(generator)
    followed, elsewhere = np.array([90.0, 150, 36, 30, 0.0]), np.array([270.0, 80, 36, 30, 0.0])
    sampler = WindowSampler()

    def show(window: np.ndarray) -> None:
        sampler.set_frame(scenes.grey(scenes.paint(ground, texture, window), generator, 2.0))

    show(followed)
    copies, redetector = FilterCopies(CorrelationFilter(sampler, followed)), Redetector(sampler, followed)
    contradicted = []
    for place, detections in ((followed, 10), (elsewhere, CONTRADICTING), (followed, 1)):
        for _ in range(detections * DETECT_EVERY):
            show(place)
            redetector.detect(sampler, followed, copies, is_seen=True)
            contradicted.append(redetector.contradicts)
    expected = range((10 + CONTRADICTING) * DETECT_EVERY - 1, (11 + CONTRADICTING) * DETECT_EVERY - 1)
    assert [frame for frame, is_so in enumerate(contradicted) if is_so] == list(expected)


@pytest.mark.parametrize(
    "window", [(32.0, 24, 64, 48), (32.0, 24, 60, 44), (2.0, 2, 12, 10), (32.0, 24, 64, 2)]
)
@pytest.mark.parametrize("flat", [False, True])
@pytest.mark.filterwarnings("error")
def test_a_target_without_background_or_look_is_never_found_elsewhere(
    window: tuple[float, float, float, float], flat: bool
):
    """One that fills the frame, lies at its corner, or is as flat as its ground."""
    image = np.full((48, 64), 90, np.uint8)
    if not flat:
        image[:] = np.random.default_rng(0).integers(0, 255, image.shape)
    tracker = MultiTargetTracker(SETTINGS)
    tracker.start_target(image, np.array([*window, 0.0]), STEP)
    for _ in range(40):
        for report in tracker.step(image, STEP):
            assert math.dist(report.turned_box[:2], window[:2]) < 30
