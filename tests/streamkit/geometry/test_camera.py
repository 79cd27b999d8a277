"""Ground coordinates of pixels."""

import math

import numpy as np
import pytest

from streamkit.geometry.camera import Camera, ground_coordinates

DEGREE_M = 111_320.0
DOWN = (0.0, -math.pi / 2, 0.0)


def _camera(**changes: object) -> Camera:
    values = {
        "latitude": 48.0, "longitude": 11.0, "height_m": 100.0, "platform": (0.0, 0.0, 0.0), "sensor": DOWN,
        "field_of_view": (math.pi / 2, math.pi / 2), "size": (201, 201),
    }  # fmt: skip
    return Camera(**{**values, **changes})  # type: ignore[arg-type]


def _metres(camera: Camera, *pixels: tuple[float, float]) -> np.ndarray:
    """North and east of the camera, m."""
    degrees = ground_coordinates(camera, np.array(pixels)) - (camera.latitude, camera.longitude)
    return degrees * (DEGREE_M, DEGREE_M * math.cos(math.radians(camera.latitude)))


def test_straight_down_the_centre_is_below() -> None:
    """With 90 deg across and 100 m of height, the frame's edges are 100 m away; up is north."""
    found = _metres(_camera(), (100, 100), (100, -0.5), (200.5, 100))
    np.testing.assert_allclose(found, [[0, 0], [100, 0], [0, 100]], atol=0.3)


def test_the_heading_turns_the_frame() -> None:
    """Flying east, up is east and right is south."""
    found = _metres(_camera(platform=(math.pi / 2, 0.0, 0.0)), (100, -0.5), (200.5, 100))
    np.testing.assert_allclose(found, [[0, 100], [-100, 0]], atol=0.3)


def test_a_slanted_view_looks_ahead() -> None:
    """45 deg below the horizon, the centre is as far away as the camera is high; nose up moves it away."""
    slanted = _camera(sensor=(0.0, -math.pi / 4, 0.0))
    np.testing.assert_allclose(_metres(slanted, (100, 100)), [[100, 0]], atol=0.3)
    nose_up = _camera(sensor=(0.0, -math.pi / 4, 0.0), platform=(0.0, math.radians(10), 0.0))
    np.testing.assert_allclose(
        _metres(nose_up, (100, 100)), [[100 / math.tan(math.radians(35)), 0]], atol=0.5
    )


@pytest.mark.parametrize("height_m", [100.0, 2000.0])
def test_pixels_near_and_above_the_horizon_have_no_position(height_m: float) -> None:
    """NaN."""
    level = _camera(sensor=(0.0, 0.0, 0.0), height_m=height_m)
    assert np.isnan(
        ground_coordinates(level, np.array([(100.0, 50.0), (100.0, 100.0), (100.0, 103.0)]))
    ).all()
