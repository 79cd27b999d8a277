"""How often targets are detected before they end."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from streamkit_tracker.survival import MEMORY, Survival


def live(survival: Survival, *lives: int) -> None:
    """Targets one after the other, each with so many detections before it ends."""
    for detections in lives:
        for count in range(1, detections):
            survival.learn(np.array([count]), ended=False)
        survival.learn(np.array([detections]), ended=True)


def test_before_a_target_has_ended_all_are_expected_to_last():
    """Nothing speaks against it."""
    assert [Survival(5).probability(count, 5) for count in range(7)] == [1.0] * 7
    assert Survival(0).probability(1, 0) == 1.0


def test_probability_is_the_share_that_lasted():
    """Of those with three detections one in five goes on; who has four always does."""
    survival = Survival(6)
    live(survival, *([3, 3, 9, 3, 3] * 20))
    found = [survival.probability(count, 6) for count in range(7)]
    assert found[1:4] == pytest.approx([0.2, 0.2, 0.2], abs=0.05)
    assert found[4:] == pytest.approx([1.0, 1.0, 1.0])
    assert survival.probability(1, 3) == pytest.approx(1.0)


def test_the_first_target_that_ends_does_not_speak_for_all():
    """One that went on is assumed beside it."""
    survival = Survival(6)
    live(survival, 3)
    assert survival.probability(3, 6) == pytest.approx(0.5)


def test_what_is_long_ago_fades():
    """A stream that was cluttered and is no more confirms as at its beginning."""
    survival = Survival(6)
    live(survival, *[3] * MEMORY)
    assert survival.probability(3, 6) < 0.1
    live(survival, *[7] * 5 * MEMORY)
    assert survival.probability(3, 6) > 0.9


@given(st.lists(st.lists(st.integers(0, 8), max_size=6), max_size=8), st.booleans())
def test_targets_of_a_frame_count_as_one_after_the_other(frames: list[list[int]], ended: bool):
    """The sum of the series is the sum."""
    together, apart = Survival(6), Survival(6)
    live(together, 2, 5)
    live(apart, 2, 5)
    for counts in frames:
        together.learn(np.array(counts, np.int64), ended=ended)
        for count in counts:
            apart.learn(np.array([count]), ended=ended)
    for count in range(7):
        assert together.probability(count, 6) == pytest.approx(apart.probability(count, 6))
