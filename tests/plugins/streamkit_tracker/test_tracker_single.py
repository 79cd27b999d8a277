"""One target started by hand, on sequences with exact truth."""

from collections.abc import Iterable
from types import ModuleType

import numpy as np
import pytest

from streamkit.geometry.track import Track, TrackState
from streamkit_tracker.observation import FrameContinuity, Observation
from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.tracker import MultiTargetTracker
from streamkit_tracker.window_geometry import half_turn

STEP = Observation(0.04)
SETTINGS = TrackerSettings(auto_start=False)


def follow(
    sequence: Iterable[tuple[np.ndarray, np.ndarray]], settings: TrackerSettings | None = None
) -> list[tuple[np.ndarray, Track | None]]:
    """Starts on the first frame's truth; gives truth and report of every later frame."""
    tracker = MultiTargetTracker(settings)
    rows: list[tuple[np.ndarray, Track | None]] = []
    for index, (image, truth) in enumerate(sequence):
        if index == 0:
            tracker.start_target(image, truth, STEP)
        else:
            reports = tracker.step(image, STEP)
            rows.append((truth, reports[0] if reports else None))
    return rows


def errors(rows: list[tuple[np.ndarray, Track | None]]) -> tuple[float, float]:
    """Median error of the centre, px, and of the angle, degrees."""
    seen = [(truth, report.turned_box) for truth, report in rows if report is not None]
    assert len(seen) == len(rows), "the target was lost"
    centre = [np.hypot(*(window[:2] - truth[:2])) for truth, window in seen]
    angle = [abs(float(half_turn(window[4] - truth[4]))) for truth, window in seen]
    return float(np.median(centre)), float(np.degrees(np.median(angle)))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_turning_growing_blinking_target_is_followed(scenes: ModuleType, seed: int):
    """Median error of the centre at most 0.6 px, of the angle at most 2.5 degrees."""
    centre, angle = errors(follow(scenes.TurningScene(seed=seed, frames=60)))
    assert centre <= 0.6
    assert angle <= 2.5


def test_regions_of_motion_do_not_lead_a_drawn_target(scenes: ModuleType):
    """While it is recognised its windows are the same with them as without: they may show a part, or more."""
    trackers = [MultiTargetTracker(SETTINGS) for _ in range(2)]
    for index, (image, truth) in enumerate(scenes.TurningScene(seed=1, frames=20)):
        if index == 0:
            for tracker in trackers:
                tracker.start_target(image, truth, STEP)
            continue
        place, reach = truth[:2] + 4.0, 1.2 * truth[2:4].max()
        box = np.concatenate([place - reach, place + reach])
        seen = Observation(0.04, centroids=place[None], boxes=box[None])
        ((alone,), (led,)) = (t.step(image, o) for t, o in zip(trackers, (STEP, seen), strict=True))
        np.testing.assert_array_equal(alone.turned_box, led.turned_box)


def test_a_removed_target_is_lost_soon_and_once(scenes: ModuleType):
    """A target that vanishes coasts within five frames, ends after `coast`, once, and never comes back."""
    rows = follow(scenes.TurningScene(seed=1, frames=40, gone_from=25), TrackerSettings(coast=0.3))
    states = [None if report is None else report.state for _, report in rows]
    assert states.count(TrackState.LOST) == 1
    assert 24 <= states.index(TrackState.COASTING) <= 24 + 5
    assert states.index(TrackState.LOST) <= 24 + 5 + 8
    assert all(state is None for state in states[states.index(TrackState.LOST) + 1 :])
    assert all(state is TrackState.CONFIRMED for state in states[:24])


def test_the_same_seed_gives_the_same_tracks_bit_for_bit(scenes: ModuleType):
    """Everything random comes from (seed, id); another seed is another run."""
    runs = [
        np.stack(
            [
                report.turned_box
                for _, report in follow(scenes.TurningScene(frames=15), TrackerSettings(seed=seed))
            ]
        )
        for seed in (3, 3, 4)
    ]
    np.testing.assert_array_equal(runs[0], runs[1])
    assert np.any(runs[0] != runs[2])


def test_a_constant_image_does_not_confirm_anything(scenes: ModuleType):
    """Without texture there is nothing to see: the target coasts, then ends, and no number is NaN."""
    image = np.full((100, 120), 90, np.uint8)
    tracker = MultiTargetTracker()
    tracker.start_target(image, np.array([50.0, 50, 20, 20, 0]), STEP)
    reports = [report for _ in range(6) for report in tracker.step(image, STEP)]
    assert reports[-1].state is TrackState.LOST
    assert all(report.state is not TrackState.CONFIRMED for report in reports)
    assert all(np.isfinite(report.turned_box).all() for report in reports)


@pytest.mark.parametrize("window", [(-90.0, 50, 20, 20, 0), (50.0, 50, np.nan, 20, 0), (50.0, 50, 0, 20, 0)])
def test_windows_that_cannot_be_followed_are_refused(window: tuple[float, ...]):
    """Outside the frame, not finite or without area: a clear error, no target."""
    with pytest.raises(ValueError, match="a window"):
        MultiTargetTracker().start_target(np.zeros((100, 120), np.uint8), np.array(window), STEP)


def test_a_target_that_leaves_the_frame_is_lost(scenes: ModuleType):
    """Most of the window outside the frame ends the track."""
    texture = scenes.blob_texture(np.random.default_rng(0))
    backdrop = scenes.ground(np.random.default_rng(1), 160, 200)
    windows = [np.array([150.0 + 4 * index, 80, 40, 30, 0]) for index in range(25)]
    noise = np.random.default_rng(2)
    rows = follow((scenes.grey(scenes.paint(backdrop, texture, w), noise, 2.0), w) for w in windows)
    states = [report.state for _, report in rows if report is not None]
    assert states[-1] is TrackState.LOST
    assert len(states) < 20


def test_a_lost_registration_lets_the_target_coast(scenes: ModuleType):
    """Frames that cannot be placed are bridged by the velocity; the target is found again afterwards."""
    tracker = MultiTargetTracker()
    states, error = [], 0.0
    for index, (image, truth) in enumerate(scenes.TurningScene(seed=2, frames=30)):
        lost = 15 <= index < 18
        if index == 0:
            tracker.start_target(image, truth, STEP)
            continue
        report = tracker.step(image, Observation(0.04, FrameContinuity.LOST) if lost else STEP)[0]
        states.append(report.state)
        error = float(np.hypot(*(report.turned_box[:2] - truth[:2])))
    assert states[14:17] == [TrackState.COASTING] * 3
    assert states[-1] is TrackState.CONFIRMED
    assert error < 1.5


@pytest.mark.parametrize("how", ["cut", "size"])
def test_a_cut_or_a_new_size_ends_every_target(scenes: ModuleType, how: str):
    """What was followed cannot be in another scene."""
    frames = list(scenes.TurningScene(frames=3))
    tracker = MultiTargetTracker()
    tracker.start_target(*frames[0], STEP)
    tracker.step(frames[1][0], STEP)
    other = np.random.default_rng(3).integers(0, 255, frames[2][0].shape, np.uint8)
    image = other if how == "cut" else frames[2][0][:-10]
    continuity = FrameContinuity.NEW if how == "cut" else FrameContinuity.KNOWN
    reports = tracker.step(image, Observation(0.04, continuity))
    assert [report.state for report in reports] == [TrackState.LOST]
    assert tracker.step(image, STEP) == ()


def test_a_drawn_target_outlives_a_cut_that_is_none(scenes: ModuleType):
    """A failed registration is taken for a cut; the target coasts for that frame and is followed on."""
    frames = list(scenes.TurningScene(frames=6))
    tracker = MultiTargetTracker()
    tracker.start_target(*frames[0], STEP)
    states = []
    for index, (image, truth) in enumerate(frames[1:], 1):
        continuity = FrameContinuity.NEW if index == 3 else FrameContinuity.KNOWN
        (report,) = tracker.step(image, Observation(0.04, continuity))
        states.append(report.state)
        error = float(np.hypot(*(report.turned_box[:2] - truth[:2])))
    assert states[2] is TrackState.COASTING
    assert states[-1] is TrackState.CONFIRMED
    assert error < 1.5


def test_camera_motion_is_taken_out_before_prediction(scenes: ModuleType):
    """A camera that jumps 25 px at every frame does not lose a target when its registration is known."""
    generator = np.random.default_rng(8)
    backdrop = scenes.paint(
        scenes.ground(generator, 300, 700),
        scenes.blob_texture(generator),
        np.array([200.0, 150, 40, 28, 0.2]),
    )
    tracker = MultiTargetTracker()
    shift = np.eye(3)
    shift[0, 2] = 25.0
    for index in range(8):
        image = scenes.grey(backdrop[:, 25 * index : 25 * index + 300], generator, 2.0)
        truth = np.array([200.0 - 25 * index, 150.0, 40, 28, 0.2])
        if index == 0:
            tracker.start_target(image, truth, STEP)
            continue
        to_reference = shift.copy()
        to_reference[0, 2] = 25.0 * index
        (report,) = tracker.step(image, Observation(0.04, to_previous=shift, to_reference=to_reference))
        assert np.hypot(*(report.turned_box[:2] - truth[:2])) < 1.0
    assert np.hypot(*report.velocity) < 10.0


def test_a_target_comes_out_of_cover_larger_and_turned(scenes: ModuleType):
    """It coasts with the speed it had, and is found where it comes out though its look there is another."""
    generator = np.random.default_rng(4)
    texture, ground = scenes.blob_texture(generator), scenes.ground(generator, 240, 400)
    tracker = MultiTargetTracker(SETTINGS)
    hidden, report = range(25, 40), None
    for index in range(50):
        changed = index >= hidden.stop
        truth = np.array([60.0 + 5 * index, 120.0, 40, 32, 0.0]) * [1, 1, 1.12, 1.12, 1] ** np.float64(
            changed
        )
        truth[4] = 0.2 * changed
        picture = ground.copy() if index in hidden else scenes.paint(ground.copy(), texture, truth)
        image = scenes.grey(picture, generator, 2.0)
        if index == 0:
            tracker.start_target(image, truth, STEP)
            continue
        (report,) = tracker.step(image, STEP)
        if index in hidden:
            assert report.state is TrackState.COASTING
            assert np.hypot(*(report.turned_box[:2] - truth[:2])) < 12
    assert report is not None
    assert report.state is TrackState.CONFIRMED
    assert np.hypot(*(report.turned_box[:2] - truth[:2])) < 2
    assert report.turned_box[2] == pytest.approx(truth[2], rel=0.1)


def test_the_reported_covariance_agrees_with_the_errors(scenes: ModuleType):
    """The squared error in units of the covariance is neither a hundredth nor ten times its expectation."""
    rows = follow(scenes.TurningScene(seed=3, frames=60), SETTINGS)
    squared = []
    for truth, report in rows:
        assert report is not None
        error = report.turned_box[:2] - truth[:2]
        squared.append(float(error @ np.linalg.solve(report.covariance, error)) / 2)
    assert 0.05 < np.mean(squared) < 5.0
