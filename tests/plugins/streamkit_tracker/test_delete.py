"""When targets end."""

import numpy as np
import pytest

from streamkit_tracker.delete import end_gone
from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.targets import COASTING, CONFIRMED, LOST, TENTATIVE, TargetTable

SHAPE = (100, 200)


@pytest.mark.parametrize(
    ("drawn", "sure", "state"),
    [(False, False, LOST), (True, True, LOST), (True, False, COASTING)],
    ids=["detected", "drawn and sure", "drawn and not sure"],
)
def test_a_window_beyond_the_frame_ends_a_target_whose_place_is_known(drawn: bool, sure: bool, state: int):
    """One drawn by hand that is not sure may be elsewhere."""
    table = TargetTable(TrackerSettings())
    row = table.add(np.array([[230.0, 50, 20, 20, 0.0]]), drawn=drawn, cause="")
    table.rows["state"][row], table.rows["credit_s"][row] = CONFIRMED, 1.0
    table.rows["sure"][row], table.rows["frames_undetected"][row] = sure, 1
    end_gone(table, SHAPE)
    assert table.rows["state"][row] == state
    assert table.causes[1] == ("left the frame" if state == LOST else "")


@pytest.mark.parametrize(("hits", "window"), [(3, 5), (1, 1), (5, 9), (7, 3)])
def test_a_tentative_target_ends_once_the_window_of_its_birth_has_too_few_detections_left(
    hits: int, window: int
):
    """More hits than the window has frames are those of all frames."""
    table = TargetTable(TrackerSettings(birth_hits=hits, birth_window=window))
    row = table.add(np.array([[100.0, 50, 20, 20, 0.0]]), drawn=False, cause="")
    allowed = max(window - hits, 0)
    table.rows["frames_undetected"][row] = allowed
    end_gone(table, SHAPE)
    assert table.rows["state"][row] == TENTATIVE
    table.rows["frames_undetected"][row] = allowed + 1
    end_gone(table, SHAPE)
    assert table.rows["state"][row] == LOST
