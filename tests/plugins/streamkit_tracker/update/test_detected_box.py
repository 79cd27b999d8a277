"""How a window follows detections."""

import numpy as np
import pytest

from streamkit_tracker.targets import CONFIRMED, TARGET, TargetRows
from streamkit_tracker.update.detected_box import (
    check_windows,
    follow_boxes,
    follow_detections,
)
from streamkit_tracker.window_geometry import FloatArray, upright_sides

STEP_S = 0.04


def sighting(x: float, y: float, width: float = 30.0, height: float = 14.0) -> FloatArray:
    """A detection with its centroid in the middle of its box."""
    return np.array([x, y, x - width / 2, y - height / 2, x + width / 2, y + height / 2])


def row(width: float, height: float) -> TargetRows:
    """A confirmed target that was detected once, and is detected in this frame by the first detection."""
    target = np.zeros(1, TARGET)
    target["box"], target["state"] = (width, height), CONFIRMED
    target["detection_std"] = 2.0
    return target


def remember(target: TargetRows, seen: FloatArray, step_s: float) -> None:
    """Lets the box follow one detection."""
    follow_detections(target, seen[None], step_s)


def window_at(x: float, y: float) -> FloatArray:
    """The window of a settled target that moves to the right."""
    return np.array([x, y, 30.0, 14.0, 0.0])


def better(
    target: TargetRows, window: FloatArray, seen: FloatArray, *, std: float = 1.0
) -> FloatArray | None:
    """Where the window of a target restarts, or None."""
    target["window"], target["recognised"], target["detection_std"] = window, True, std
    target["mean"], target["covariance"] = 0.0, np.eye(4)
    check_windows(target, seen[None], STEP_S)
    return target["restart_window"][0].copy() if target["restart"][0] else None


def settled() -> TargetRows:
    """The row of a target that was detected for more than a second."""
    shape = row(30.0, 14.0)
    for _ in range(30):
        remember(shape, sighting(0, 0), STEP_S)
    return shape


def test_a_young_target_is_as_large_as_its_detection():
    """First detections show a part: the box follows at once."""
    shape = row(10.0, 8.0)
    remember(shape, sighting(0, 0, 24, 12), STEP_S)
    assert shape["box"][0].tolist() == [24.0, 12.0]
    remember(shape, sighting(0, 0, 6, 12), STEP_S)
    assert shape["box"][0].tolist() == [6.0, 12.0]


def test_a_detection_that_shows_others_too_teaches_nothing():
    """A blob of two cars is not the size of one."""
    shape = settled()
    shape["crowded"], shape["detection_std"] = True, 20.0
    remember(shape, sighting(0, 0, 80, 60), STEP_S)
    np.testing.assert_allclose(shape["box"][0], (30, 14))


def test_a_window_that_agrees_is_left_alone():
    """Detections that tremble by a pixel do not move the window of a settled target."""
    shape = settled()
    window = window_at(100, 100)
    noise = np.random.default_rng(0).normal(0, 0.7, (50, 2))
    assert all(better(shape, window, sighting(100 + dx, 100 + dy)) is None for dx, dy in noise)


def test_a_window_beside_its_detections_begins_again_on_them():
    """Where they lie half beside it, with the second one."""
    shape, window = settled(), window_at(100, 100)
    answers = [better(shape, window, sighting(109, 102), std=99.0) for _ in range(2)]
    assert answers[0] is None
    assert answers[1] is not None
    np.testing.assert_allclose(answers[1][:2], (109, 102))


def test_one_detection_of_an_odd_size_changes_nothing():
    """With the second one the target is that large."""
    shape, window = settled(), window_at(100, 100)
    answers = [better(shape, window, sighting(100, 100, 44, 40), std=99.0) for _ in range(2)]
    assert answers[0] is None
    assert answers[1] is not None
    assert answers[1][3] > 35


@pytest.mark.parametrize("per_second", [5, 10, 50])
def test_the_box_follows_by_the_clock(per_second: int):
    """Half a second after a target was seen larger its box is as large, whatever the rate of frames."""
    usual, other = settled(), settled()
    for _ in range(12):
        remember(usual, sighting(0, 0, 45, 21), STEP_S)
    for _ in range(round(0.48 * per_second)):
        remember(other, sighting(0, 0, 45, 21), 0.48 / round(0.48 * per_second))
    np.testing.assert_allclose(other["box"], usual["box"], rtol=1e-9)


def test_many_targets_are_judged_as_each_alone():
    """Only the window that lies beside its detection restarts."""
    targets = np.concatenate([settled(), settled(), settled()])
    targets["window"] = window_at(100.0, 100.0)
    targets["mean"], targets["covariance"] = [100.0, 100, 0, 0], np.eye(4)
    targets["recognised"], targets["detection"] = [True, False, True], [0, 1, 2]
    targets["detection_std"] = 1.0
    check_windows(targets, np.array([sighting(100, 100), sighting(100, 100), sighting(130, 100)]), STEP_S)
    assert targets["restart"].tolist() == [False, False, True]


def test_a_large_target_follows_the_boxes_of_its_regions():
    """From 32 px on, until it has shrunk below 26 px; one drawn by hand never does."""
    target = row(30.0, 20.0)
    remember(target, sighting(0, 0, 30, 20), STEP_S)
    assert not target["whole"][0]
    remember(target, sighting(0, 0, 60, 30), STEP_S)
    assert target["whole"][0]
    target["box"] = 29.0, 29.0
    target["detection"] = -1
    follow_detections(target, sighting(0, 0)[None], STEP_S)
    assert target["whole"][0]
    target["box"] = 25.0, 25.0
    follow_detections(target, sighting(0, 0)[None], STEP_S)
    assert not target["whole"][0]
    target["manual"], target["box"] = True, (80.0, 80.0)
    follow_detections(target, sighting(0, 0)[None], STEP_S)
    assert not target["whole"][0]


def test_the_window_of_a_whole_target_is_its_box_turned_into_the_motion():
    """A box of a detector is smoothed and upright, a region is as it is; others keep their windows."""
    target = row(40.0, 40.0)
    target["whole"], target["mean"] = True, (100.0, 50.0, 200.0, 200.0)
    target["covariance"] = 0.01 * np.eye(4)
    target["window"] = window_at(90, 50)
    seen = sighting(104, 52, 44, 44)[None]
    follow_boxes(target, seen, are_objects=True)
    assert target["window"][0].tolist() == [100.0, 50.0, 40.0, 40.0, 0.0]
    assert target["recognised"][0]
    follow_boxes(target, seen, are_objects=False)
    assert target["window"][0, :2].tolist() == [104.0, 52.0]
    np.testing.assert_allclose(upright_sides(target["window"]), [[44.0, 44.0]])
    assert target["window"][0, 4] == pytest.approx(np.pi / 4)
    target["whole"], target["window"] = False, window_at(90, 50)
    follow_boxes(target, seen, are_objects=False)
    assert target["window"][0].tolist() == window_at(90, 50).tolist()
