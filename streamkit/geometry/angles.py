"""Angles: wrapped to the interval that their meaning asks for. All in radians."""

from __future__ import annotations

import math


def wrap_turn(angle: float) -> float:
    """The turn of an angle, in [-pi, pi]."""
    return math.remainder(angle, 2 * math.pi)


def wrap_bearing(angle: float) -> float:
    """A compass bearing, in [0, 2 pi)."""
    return angle % (2 * math.pi)
