"""What is kept of a keyframe's pixels, and background work."""

import threading

import numpy as np
import pytest

from streamkit_stitcher.plane.keyframe_content import LEVELS, deferred, executor_for, keyframe_content
from streamkit_stitcher.registration.patches import pyramid


def test_patches_lie_around_corners_on_whole_pixels(ground):
    """One for each corner and pyramid level, cut from the level's own pixels."""
    images = pyramid((ground[:720, :1280],), LEVELS)
    kept = keyframe_content(images[:2], 1)
    assert len(kept.points) > 200
    assert np.array_equal(kept.points, np.rint(kept.points))
    assert [patches.shape for patches in kept.patches] == [(len(kept.points), 17, 17)] * LEVELS
    x, y = kept.points[100].astype(int)
    assert np.array_equal(kept.patches[0][100], images[0][y - 8 : y + 9, x - 8 : x + 9])
    assert np.array_equal(kept.small, images[1])


def test_the_caller_waits_for_the_result_only():
    """Work runs in another thread, in order."""
    executor, gate, done = executor_for("keyframes"), threading.Event(), []

    def work(number):
        assert gate.wait(30)
        done.append(number)
        return threading.current_thread(), number

    results = [deferred(executor, work, number) for number in range(3)]
    assert not done
    gate.set()
    assert [result()[1] for result in results] == done == [0, 1, 2]
    thread = results[0]()[0]
    assert thread is not threading.current_thread()
    assert executor.close(10)
    assert not thread.is_alive()


def test_a_failure_of_the_work_is_raised_where_its_result_is_used():
    """It does not end the worker."""
    executor = executor_for("keyframes")
    failed, sound = deferred(executor, int, "x"), deferred(executor, int, "7")
    with pytest.raises(ValueError, match="invalid literal"):
        failed()
    assert sound() == 7
    assert executor.close(10)
