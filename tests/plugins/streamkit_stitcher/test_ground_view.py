"""What a frame shows of the ground."""

import math

import numpy as np
import pytest

from streamkit import Pose
from streamkit.geometry.earth import metres_per_degree
from streamkit_stitcher.ground_view import ground_view

SHAPE = (480, 640)
NADIR = (0.0, -math.pi / 2, 0.0)


def dji(**fields):
    """A pose 100 m above the take-off, straight down unless said otherwise."""
    given = {
        "altitude": 100.0,
        "sensor_angles": NADIR,
        "source": "dji above take-off",
        "ground_altitude": 0.0,
    } | fields
    return Pose(46.8, -92.1, **given)


def offset_m(view):
    """Metres north and east of the camera, float64[n, 2]."""
    return (view.places - [46.8, -92.1]) * metres_per_degree(46.8)


def test_what_telemetry_sends_goes_first():
    """The frame's centre and its corners, in the order of MISB, with the time of the frame."""
    corners = ((1.0, 2.0), (1.0, 3.0), (0.0, 3.0), (0.0, 2.0))
    view = ground_view(dji(frame_centre=(0.5, 2.5, None), corners=corners), SHAPE, None, 0.0, 2_000_000_000)
    assert view.pixels.tolist() == [
        [319.5, 239.5],
        [-0.5, -0.5],
        [639.5, -0.5],
        [639.5, 479.5],
        [-0.5, 479.5],
    ]
    assert view.places.tolist() == [[0.5, 2.5], *map(list, corners)]
    assert view.time_s == 2.0


def test_an_oblique_camera_shows_what_it_looks_at():
    """45 deg down from 100 m, looking east: the centre lies 100 m east of the camera."""
    pose = dji(heading=math.pi / 2, sensor_angles=(0.0, -math.pi / 4, 0.0))
    view = ground_view(pose, SHAPE, None, math.radians(60), None)
    assert offset_m(view)[0] == pytest.approx([0.0, 100.0], abs=0.1)
    assert len(view.places) == 5
    assert view.std_m > 4.0


def test_a_camera_that_looks_down_needs_no_field_of_view():
    """Its own position is that of the centre, with no attitude at all, too."""
    for pose in (dji(), dji(sensor_angles=None), Pose(46.8, -92.1)):
        view = ground_view(pose, SHAPE, None, 0.0, None)
        assert offset_m(view) == pytest.approx(np.zeros((1, 2)), abs=0.1)


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({}, "field-of-view"),
        ({"field_of_view": (1.0, 0.8), "ground_altitude": None}, "ground-altitude"),
        ({"sensor_angles": (0.0, 0.0, 0.0)}, "horizon"),
        ({"is_stale": True}, "no current position"),
    ],
)
def test_a_camera_that_looks_aside_needs_them(fields, reason):
    """What is missing is named."""
    pose = dji(**({"sensor_angles": (0.0, -math.pi / 4, 0.0)} | fields))
    assert reason in ground_view(pose, SHAPE, None, 0.0, None)


def test_the_altitude_of_the_ground_gives_the_height():
    """Above sea level the ground's altitude is needed, and taken off."""
    pose = dji(
        heading=0.0,
        altitude=350.0,
        source="dji above sea level",
        ground_altitude=None,
        field_of_view=(1.0, 0.8),
        sensor_angles=(0.0, -math.pi / 4, 0.0),
    )
    assert offset_m(ground_view(pose, SHAPE, 250.0, 0.0, None))[0] == pytest.approx([100.0, 0.0], abs=0.1)


def test_a_focal_length_holds_the_mosaic_of_a_camera_that_looks_down_only():
    """Photographs without angles do, and who sets the field of view says so; DJI video may look anywhere."""
    view, oblique = (math.radians(70), 0.9), (0.0, -math.pi / 4, 0.0)

    def focal(pose, field_of_view=0.0):
        return ground_view(pose, SHAPE, None, field_of_view, None).focal_px

    assert focal(dji(field_of_view=view)) == pytest.approx(320 / math.tan(math.radians(35)))
    assert focal(dji(field_of_view=view, heading=0.0, sensor_angles=oblique)) == 0
    assert focal(dji(field_of_view=view, sensor_angles=None)) == 0
    assert focal(dji(sensor_angles=None), math.radians(70)) > 0
    assert focal(dji(field_of_view=view, sensor_angles=None, source="exif above sea level")) > 0
