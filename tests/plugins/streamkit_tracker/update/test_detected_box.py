"""How a window follows detections."""

import numpy as np
import pytest

from streamkit.geometry.boxes import upright_sides
from streamkit_tracker.targets import CONFIRMED, TARGET, TENTATIVE, TargetRows
from streamkit_tracker.update.detected_box import follow_boxes, follow_detections
from streamkit_tracker.window_geometry import LENGTH, FloatArray

STEP_S = 0.04


def sighting(x: float, y: float, width: float = 30.0, height: float = 14.0) -> FloatArray:
    """A detection with its centroid in the middle of its box."""
    return np.array([x, y, x - width / 2, y - height / 2, x + width / 2, y + height / 2])


def row(width: float, height: float) -> TargetRows:
    """A confirmed target that was detected once, and is detected in this frame by the first detection."""
    target = np.zeros(1, TARGET)
    target["box"], target["state"] = (width, height), CONFIRMED
    target["detection_std"], target["led"] = 2.0, True
    return target


def remember(target: TargetRows, seen: FloatArray, step_s: float, *, are_objects: bool = False) -> None:
    """Lets the box follow one detection."""
    follow_detections(target, seen[None], step_s, are_objects)


def window_at(x: float, y: float) -> FloatArray:
    """The window of a settled target that moves to the right."""
    return np.array([x, y, 30.0, 14.0, 0.0])


def settled() -> TargetRows:
    """The row of a target that was detected before."""
    shape = row(30.0, 14.0)
    for _ in range(30):
        remember(shape, sighting(0, 0), STEP_S)
    return shape


def test_a_target_is_as_large_as_its_region():
    """The box follows at once."""
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


@pytest.mark.parametrize("per_second", [5, 10, 50])
def test_the_box_follows_by_the_clock(per_second: int):
    """Half a second after an object was seen larger its box is as large, whatever the rate of frames."""
    usual, other = settled(), settled()
    for _ in range(12):
        remember(usual, sighting(0, 0, 45, 21), STEP_S, are_objects=True)
    for _ in range(round(0.48 * per_second)):
        remember(other, sighting(0, 0, 45, 21), 0.48 / round(0.48 * per_second), are_objects=True)
    np.testing.assert_allclose(other["box"], usual["box"], rtol=1e-9)


def test_windows_lie_on_detections_of_their_own():
    """Not on one that shows others too; a tentative target and one drawn by hand keep theirs."""
    targets = np.concatenate([settled() for _ in range(5)])
    targets["window"], targets["mean"] = window_at(100, 100), [109.0, 102, 0, 0]
    targets["covariance"], targets["detection"] = np.eye(4), [0, 0, 0, 0, -1]
    targets["crowded"][1], targets["state"][2], targets["drawn"][3] = True, TENTATIVE, True
    remember(targets, sighting(109, 102, 34, 18), STEP_S)
    follow_boxes(targets, sighting(109, 102, 34, 18)[None], are_objects=False)
    assert targets["recognised"].tolist() == [True, False, False, False, False]
    np.testing.assert_allclose(targets["window"][0], (109, 102, 34, 18, 0), atol=0.3)
    assert (targets["window"][1:] == window_at(100, 100)).all()


def test_a_large_target_follows_the_boxes_of_its_regions():
    """From 32 px on; one drawn by hand never does."""
    target = row(30.0, 20.0)
    remember(target, sighting(0, 0, 30, 20), STEP_S)
    assert not target["whole"][0]
    remember(target, sighting(0, 0, 60, 30), STEP_S)
    assert target["whole"][0]
    target["box"] = 29.0, 29.0
    target["detection"] = -1
    follow_detections(target, sighting(0, 0)[None], STEP_S)
    assert not target["whole"][0]
    target["drawn"], target["box"] = True, (80.0, 80.0)
    follow_detections(target, sighting(0, 0)[None], STEP_S)
    assert not target["whole"][0]


def test_a_window_is_the_box_turned_into_the_motion():
    """A box of a detector is smoothed and upright, a region is as it is."""
    target = row(40.0, 40.0)
    target["mean"] = 100.0, 50.0, 200.0, 200.0
    target["covariance"] = 0.01 * np.eye(4)
    target["window"] = window_at(90, 50)
    seen = sighting(104, 52, 44, 44)[None]
    follow_boxes(target, seen, are_objects=True)
    assert target["window"][0].tolist() == [100.0, 50.0, 40.0, 40.0, 0.0]
    assert target["recognised"][0]
    follow_detections(target, seen, STEP_S)
    follow_boxes(target, seen, are_objects=False)
    assert target["window"][0, :2].tolist() == [103.0, 51.5]
    np.testing.assert_allclose(upright_sides(*target["window"][0, LENGTH:]), [44.0, 44.0])
    assert target["window"][0, 4] == pytest.approx(np.pi / 4)
