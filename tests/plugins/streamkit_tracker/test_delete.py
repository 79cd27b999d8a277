"""When targets end."""

import numpy as np
import pytest

from streamkit_tracker.delete import end_gone
from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.targets import COASTING, CONFIRMED, LOST, TargetTable

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
