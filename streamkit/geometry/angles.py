"""Wrapping of angles, rad."""

from __future__ import annotations

import math


def wrap_turn(angle: float) -> float:
    """An angle wrapped to [-pi, pi]."""
    return math.remainder(angle, 2 * math.pi)


def wrap_bearing(angle: float) -> float:
    """A compass bearing wrapped to [0, 2 pi)."""
    return angle % (2 * math.pi)
