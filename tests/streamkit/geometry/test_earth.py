"""Lengths on the WGS84 ellipsoid, compared with pyproj."""

import pytest

from streamkit.geometry.earth import metres_per_degree

STEP = 1e-4


@pytest.mark.parametrize("latitude", [0.0, 47.3, -33.9, 69.6])
def test_lengths_are_those_of_geodesics(latitude: float) -> None:
    """A step of 11 m north or east is as long as the geodesic between its ends, to a millionth."""
    geod = pytest.importorskip("pyproj").Geod(ellps="WGS84")
    north_m, east_m = metres_per_degree(latitude)
    _, _, north = geod.inv(8.0, latitude - STEP / 2, 8.0, latitude + STEP / 2)
    _, _, east = geod.inv(8.0, latitude, 8.0 + STEP, latitude)
    assert (north_m * STEP, east_m * STEP) == (pytest.approx(north, rel=1e-6), pytest.approx(east, rel=1e-6))
