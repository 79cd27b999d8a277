"""How a window follows detections."""

import math

import numpy as np
import pytest

from streamkit_tracker.box_shape import correct_window
from streamkit_tracker.detected_shape import DetectedShape, Motion, remember, restarts, seen_rows
from streamkit_tracker.observation import Sighting
from streamkit_tracker.window_geometry import FloatArray

STEP_S = 0.04


def sighting(x: float, y: float, width: float = 30.0, height: float = 14.0) -> Sighting:
    """A detection that shows nothing else."""
    return Sighting((x, y), (width, height), (x, y), 2.0)


def better(
    shape: DetectedShape, window: FloatArray, seen: Sighting, heading: float, deviation: float, trust: float
) -> FloatArray | None:
    """Where one window is to begin again, or None."""
    found = np.empty(5)
    wrong = correct_window(shape.numbers, window, seen_rows([seen])[0], heading, deviation, trust, found)
    return found if wrong else None


def settled() -> DetectedShape:
    """The shape of a target that was detected for more than a second."""
    shape = DetectedShape((30.0, 14.0))
    for _ in range(30):
        remember([shape], [sighting(0, 0)], STEP_S)
    return shape


def test_a_young_target_is_as_large_as_was_ever_seen():
    """First detections show a part: the box grows at once, and shrinks slowly."""
    shape = DetectedShape((10.0, 8.0))
    remember([shape], [sighting(0, 0, 24, 12)], STEP_S)
    assert shape.box == (24.0, 12.0)
    remember([shape], [sighting(0, 0, 6, 12)], STEP_S)
    assert shape.box == (12.0, 12.0)


def test_a_detection_that_shows_others_too_teaches_nothing():
    """A blob of two cars is not the size of one."""
    shape = settled()
    remember([shape], [Sighting((0, 0), (80, 60), (0, 0), 20.0, crowded=True)], STEP_S)
    np.testing.assert_allclose(shape.box, (30, 14))


def test_a_window_that_agrees_is_left_alone():
    """Detections that tremble by a pixel do not move the window of a settled target."""
    shape = settled()
    window = shape.window(100, 100, 0.0)
    noise = np.random.default_rng(0).normal(0, 0.7, (50, 2))
    assert all(
        better(shape, window, sighting(100 + dx, 100 + dy), 0.0, math.inf, 1.0) is None for dx, dy in noise
    )


def test_a_window_far_off_begins_again_on_the_detection():
    """Where the detection lies for the most part beside it, at once; where it lies half beside it, soon."""
    shape = settled()
    far = better(shape, shape.window(100, 100, 0.0), sighting(120, 100), 0.0, math.inf, 0.0)
    assert far is not None
    np.testing.assert_allclose(far[:2], (120, 100))
    window = shape.window(100, 100, 0.0)
    answers = [better(shape, window, sighting(109, 102), 0.0, math.inf, 0.0) for _ in range(2)]
    assert answers[0] is None
    assert answers[1] is not None


def test_a_detection_of_an_odd_size_has_to_last():
    """One blob twice as large changes nothing; after eight the target is that large."""
    shape = settled()
    window = shape.window(100, 100, 0.0)
    answers = [better(shape, window, sighting(100, 100, 44, 40), 0.0, math.inf, 0.0) for _ in range(8)]
    assert answers[:7] == [None] * 7
    assert answers[7] is not None
    assert answers[7][3] > 35


@pytest.mark.parametrize("per_second", [5, 10, 50])
def test_the_box_follows_by_the_clock(per_second: int):
    """Half a second after a target was seen larger its box is as large, whatever the rate of frames."""
    usual, other = settled(), settled()
    for _ in range(12):
        remember([usual], [sighting(0, 0, 45, 21)], STEP_S)
    for _ in range(round(0.48 * per_second)):
        remember([other], [sighting(0, 0, 45, 21)], 0.48 / round(0.48 * per_second))
    np.testing.assert_allclose(other.box, usual.box, rtol=1e-9)


def test_an_odd_size_lasts_by_the_clock():
    """With ten frames a second three odd detections are as long as eight with 25."""
    shape = DetectedShape((30.0, 14.0))
    for _ in range(12):
        remember([shape], [sighting(0, 0)], 0.1)
    window = shape.window(100, 100, 0.0)
    answers = [better(shape, window, sighting(100, 100, 44, 40), 0.0, math.inf, 0.0) for _ in range(3)]
    assert answers[:2] == [None] * 2
    assert answers[2] is not None


def test_many_targets_are_judged_as_each_alone():
    """What is unlike itself for three frames begins again where it is detected, and what agrees goes on."""
    shapes, windows = [settled(), settled(), settled()], np.tile([100.0, 100.0, 30.0, 14.0, 0.0], (3, 1))
    seen = [sighting(100, 100), sighting(100, 100), sighting(130, 100)]
    means = np.array([[100.0, 100, 0, 0], [101.0, 100, 0, 0], [100.0, 100, 0, 0]])
    motion = Motion(means, np.tile(np.eye(4), (3, 1, 1)))
    alike = np.array([True, False, True])
    first = restarts(shapes, seen, windows, motion, alike, np.ones(3, np.bool_))
    assert first[0] is None
    assert first[1] is None
    assert first[2] is not None
    assert first[2][1]
    np.testing.assert_allclose(first[2][0][:2], (130, 100))
    still = Motion(means[:2], np.tile(np.eye(4), (2, 1, 1)))
    for looked_at in (True, False, True):
        looks = np.full(2, looked_at)
        later = restarts(shapes[:2], seen[:2], windows[:2], still, alike[:2], looks)
        # a frame in which nobody looked says nothing
        assert later[1] is None or looked_at
    assert later[0] is None
    assert later[1] is not None
    assert not later[1][1]
    np.testing.assert_allclose(later[1][0][:2], (101, 100))
