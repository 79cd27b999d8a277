"""Wrapping of angles."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from streamkit.geometry.angles import wrap_bearing, wrap_turn

angles = st.floats(-50.0, 50.0)


@given(angles)
def test_turns_and_bearings_are_wrapped(angle: float) -> None:
    """To [-pi, pi] and [0, 2 pi)."""
    for wrapped, low in ((wrap_turn(angle), -math.pi), (wrap_bearing(angle), 0.0)):
        assert low - 1e-12 <= wrapped <= low + 2 * math.pi + 1e-12
        assert math.cos(wrapped - angle) == pytest.approx(1.0)
