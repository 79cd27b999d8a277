"""Angles: wrapped without changing what they mean."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from streamkit.geometry.angles import wrap_axes, wrap_axis, wrap_bearing, wrap_turn

angles = st.floats(-50.0, 50.0)


@given(angles)
def test_an_axis_keeps_its_line(angle: float) -> None:
    """In [-pi/2, pi/2), half turns away at most."""
    wrapped = wrap_axis(angle)
    assert -math.pi / 2 - 1e-12 <= wrapped <= math.pi / 2 + 1e-12
    assert math.sin(wrapped - angle) == pytest.approx(0.0, abs=1e-9)
    assert wrap_axes(np.array([angle]))[0] == wrapped


@given(angles)
def test_turns_and_bearings_keep_their_direction(angle: float) -> None:
    """In [-pi, pi] and [0, 2 pi), whole turns away."""
    for wrapped, low in ((wrap_turn(angle), -math.pi), (wrap_bearing(angle), 0.0)):
        assert low - 1e-12 <= wrapped <= low + 2 * math.pi + 1e-12
        assert math.cos(wrapped - angle) == pytest.approx(1.0)
