"""The tilt of cameras on aircraft."""

import math

import numpy as np
import pytest

from streamkit.geometry.camera import rotation_matrix
from streamkit_stitcher.flight_plan.rectification import (
    STRAIGHT_DOWN,
    CameraIntrinsics,
    camera_tilt,
    levelling,
)

SHAPE = (480, 640)


def test_a_camera_that_looks_down_has_no_tilt():
    """Whichever way its gimbal is turned about the vertical."""
    for azimuth in (0.0, 1.0, 3.0):
        assert camera_tilt(0.0, 0.0, (azimuth, -math.pi / 2, 0.0)) == pytest.approx((0.0, 0.0), abs=1e-12)


def test_a_gimbal_makes_up_for_its_platform():
    """Nose up by 10 degrees and the gimbal down by 100 looks straight down."""
    tilt = camera_tilt(math.radians(10), 0.0, (0.0, math.radians(-100), 0.0))
    assert tilt == pytest.approx((0.0, 0.0), abs=1e-12)


@pytest.mark.parametrize(
    ("pitch", "roll", "sensor"),
    [
        (0.1, 0.0, STRAIGHT_DOWN),
        (0.0, -0.15, STRAIGHT_DOWN),
        (0.08, 0.05, (0.4, -1.45, 0.1)),
        (-0.2, 0.1, (2.5, -1.7, -0.05)),
    ],
)
def test_levelling_brings_the_nadir_to_the_centre(pitch, roll, sensor):
    """What lies straight below the camera comes to the principal point."""
    world = rotation_matrix(0.3, pitch, roll) @ rotation_matrix(*sensor)
    forward, right, down = world[2]
    camera = CameraIntrinsics(600.0)
    inner = camera.matrix(SHAPE)
    seen = inner @ np.array([right, down, forward])
    mapped = levelling(camera, SHAPE, *camera_tilt(pitch, roll, sensor)) @ seen
    assert mapped[:2] / mapped[2] == pytest.approx(inner[:2, 2], abs=1e-6)
