"""Lengths on the WGS84 ellipsoid."""

from __future__ import annotations

import math
from typing import Final

EQUATORIAL_RADIUS_M: Final = 6_378_137.0
ECCENTRICITY_SQUARED: Final = 6.694379990141e-3


def metres_per_degree(latitude: float) -> tuple[float, float]:
    """Lengths of a degree of latitude and of longitude.

    Args:
        latitude: degrees, WGS84.

    Returns:
        Metres per degree towards north, and towards east.

    Source: the radii of curvature in the meridian and in the prime vertical of the WGS84 ellipsoid.
    """
    phi = math.radians(latitude)
    bend = 1 - ECCENTRICITY_SQUARED * math.sin(phi) ** 2
    north_m = math.radians(1) * EQUATORIAL_RADIUS_M * (1 - ECCENTRICITY_SQUARED) / bend**1.5
    east_m = math.radians(1) * EQUATORIAL_RADIUS_M * math.cos(phi) / math.sqrt(bend)
    return north_m, east_m
