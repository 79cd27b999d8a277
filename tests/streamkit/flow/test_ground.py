"""Ground coordinates of targets."""

import math

import numpy as np
import pytest

from streamkit import Frame, GroundReference, Pose, Track, Tracks, TrackState, raw_video_caps
from streamkit.flow.ground import ground_positions
from streamkit.geometry.earth import metres_per_degree

TARGET = Track(7, TrackState.CONFIRMED, 3.0, 1.0, 1.0, 1.0, 0.0, None, None, 0.5, 7)
SEEN = Frame(np.zeros((2, 4), np.uint8), raw_video_caps("GRAY8", 4, 2), seq=0).attach(Tracks((TARGET,)))
NORTH_M, EAST_M = metres_per_degree(48.0)


def test_the_reference_of_the_frame_goes_first() -> None:
    """Pixels are mapped to metres about its origin; the pose is not needed."""
    to_local = np.array([[10.0, 0, 5], [0, -10, 0], [0, 0, 1]])
    found, reason = ground_positions(SEEN.attach(GroundReference(to_local, 48.0, 11.0, 2.0, 35.0)), None)
    assert reason == ""
    latitude, longitude, error_m = found[7]
    assert ((latitude - 48) * NORTH_M, (longitude - 11) * EAST_M) == pytest.approx((-10.0, 35.0))
    assert error_m == pytest.approx(2.0 * math.hypot(1, math.hypot(35, 10) / 35))


def test_a_camera_without_angles_looks_straight_down() -> None:
    """The height is that above the take-off, where telemetry tells no other."""
    pose = Pose(48.0, 11.0, 90.0, heading=math.pi / 2, field_of_view=(1.0, 0.5), ground_altitude=-10.0)
    found, _ = ground_positions(SEEN.attach(pose), None)
    right = 100 * math.tan(0.5) * (3.0 - 1.5) / 2
    assert (found[7][0] - 48) * NORTH_M == pytest.approx(-right, rel=1e-6)
    assert found[7][2] == pytest.approx(
        math.hypot(3.0, math.radians(1) * 100 * (1 + (0.545 * 0.75) ** 2)), rel=0.2
    )


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"altitude": None}, "height above the ground is unknown; set ground-altitude"),
        ({"ground_altitude": None}, "height above the ground is unknown; set ground-altitude"),
        (
            {"ground_altitude": 90.0},
            "less than 1 m above the ground, as before take-off; else set ground-altitude",
        ),
        ({"field_of_view": None}, "field-of-view"),
        ({"heading": None}, "put stitch before it"),
        ({"is_stale": True}, "put stitch before it"),
    ],
)
def test_what_is_missing_is_said(changes: dict[str, object], reason: str) -> None:
    """One thing at a time, with the remedy."""
    fields = {"altitude": 90.0, "heading": 0.0, "field_of_view": (1.0, 0.5), "ground_altitude": 0.0} | changes
    found, said = ground_positions(SEEN.attach(Pose(48.0, 11.0, **fields)), None)
    assert not found
    assert reason in said
