"""The position of frames and their targets on the earth while a flight goes on."""

import math
import os
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest

from streamkit import Frame, GroundReference, Track, Tracks, TrackState, raw_video_caps, track_record
from streamkit.geometry.earth import metres_per_degree
from streamkit.geometry.homography import project, translation
from streamkit.geometry.registration_status import RegistrationStatus
from streamkit.testing import Harness
from streamkit_stitcher.live_ground import LiveGround
from streamkit_stitcher.mosaic.georeference import GroundView, local_metres
from streamkit_stitcher.plane.frame_registration import FrameRegistration
from streamkit_telemetry_formats.dji import DjiTelemetry

SHAPE = (360, 640)
SECOND_NS = 1_000_000_000
TELEMETRY = Path(os.environ.get("STREAMKIT_DATA", "/nonexistent")) / "data" / "telemetry" / "dji"
METRES_PER_PX = 0.45
TURN = math.radians(35)


@pytest.fixture(scope="module")
def subtitles():
    """A flight of a Mavic Mini: a position of four decimals each second, and its height."""
    path = TELEMETRY / "mavic_mini.SRT"
    if not path.is_file():
        pytest.skip("needs STREAMKIT_DATA")
    return path


def rendered(ground, place_m):
    """The view of a camera that looks straight down, east and north m of the middle, and its matrix.

    The matrix maps pixels of the frame to metres east and north.
    """
    cos, sin = METRES_PER_PX * math.cos(TURN), METRES_PER_PX * math.sin(TURN)
    middle = np.array([[1, 0, -(SHAPE[1] - 1) / 2], [0, 1, -(SHAPE[0] - 1) / 2], [0, 0, 1]])
    to_local = np.array([[cos, sin, place_m[0]], [sin, -cos, place_m[1]], [0, 0, 1]]) @ middle
    height, width = ground.shape
    to_ground = np.array([[1 / METRES_PER_PX, 0, width / 2], [0, -1 / METRES_PER_PX, height / 2], [0, 0, 1]])
    view = cv2.warpPerspective(ground, np.linalg.inv(to_ground @ to_local), SHAPE[::-1])
    return view, to_local


def test_targets_have_a_position_with_an_honest_error(ground, subtitles):
    """Within 3 m of the truth once the aircraft has flown 60 m, and within three errors before.

    Telemetry has no heading and a position a second; half of the frames lie between two of them.
    """
    samples = list(DjiTelemetry().read(subtitles.read_text().splitlines(keepends=True)))
    scale = metres_per_degree(samples[0].latitude)
    places = np.array([(sample.latitude, sample.longitude) for sample in samples])
    origin = (places.max(axis=0) + places.min(axis=0)) / 2
    metres = ((places - origin) * scale)[:, ::-1]
    target = Track(7, TrackState.CONFIRMED, 400.0, 250.0, 9.0, 9.0, 0.0, (0.0, 0.0), np.eye(2), 0.5, 7)
    errors, flown, expected = [], [], []
    with Harness("posesync", location=str(subtitles), max_gap_s=0.1) as poses, Harness("stitch") as stitch:
        for number in range(2 * len(metres) - 1):
            place = (metres[number // 2] + metres[(number + 1) // 2]) / 2
            view, to_local = rendered(ground, place)
            frame = Frame(view, raw_video_caps("GRAY8", 640, 360), seq=number, pts=number * SECOND_NS // 2)
            for posed in poses.push(frame):
                (located,) = stitch.push(posed)
                record = track_record(located.attach(Tracks((target,))), source="a", published_ns=None)
                geo = record.tracks[0].geo
                flown.append(place)
                if geo is None:
                    errors.append(math.nan)
                    expected.append(math.nan)
                    continue
                true = project(to_local, np.array([[target.x, target.y]]))[0]
                found = ((geo.lat, geo.lon) - origin) * scale
                errors.append(math.hypot(*(found[::-1] - true)))
                expected.append(geo.error_m)
    path = np.cumsum([0, *(math.hypot(*(b - a)) for a, b in pairwise(flown))])
    far = path > 60
    assert np.isfinite(np.array(errors)[far]).all()
    assert np.array(errors)[far].max() < 3.0
    known = np.isfinite(errors)
    assert (np.array(errors)[known] < 3 * np.array(expected)[known]).all()


def test_without_telemetry_there_is_no_position(ground):
    """Nothing is invented."""
    with Harness("stitch") as stitch:
        for number in range(5):
            view, _ = rendered(ground, (3.0 * number, 0.0))
            (passed,) = stitch.push(Frame(view, raw_video_caps("GRAY8", 640, 360), seq=number))
            assert passed.get(GroundReference) is None


def test_telemetry_ahead_of_the_image_is_part_of_the_error():
    """Either may be right: a fast camera may be anywhere between the two."""
    ground, located = LiveGround(), []
    for number in range(100):
        time_s = number / 10
        # It turns round every three seconds; positions are ahead by a fifth of a second.
        x, ahead = (100 * math.sin(2 * (time_s + lead)) for lead in (0.0, 0.2))
        north_m, east_m = metres_per_degree(0.0)
        places = np.array([(y / north_m, (ahead + z) / east_m) for z, y in ((0, 0), (-50, 0), (0, 50))])
        pixels = np.array([[320.0, 180], [270, 180], [320, 130]])
        registered = FrameRegistration(
            np.eye(3), translation(np.array([x, 0])), 0, RegistrationStatus.OK, measured=True
        )
        located.append(ground.locate(registered, GroundView(pixels, places, 2.0, time_s)))
    last = located[-20:]
    assert all(geo.lead_s == pytest.approx(0.2, abs=0.03) for geo in last)
    errors = [geo.error_m for geo in last]
    assert max(errors) > 30
    assert min(errors) > 2.0
    assert project(last[-1].to_local, np.array([[320.0, 180]]))[0] - local_metres(
        np.array([[0.0, x / east_m]]), last[-1].origin
    ) == pytest.approx(np.zeros((1, 2)), abs=4.0)


def test_what_is_unknown_of_the_lead_shows_when_the_camera_swings():
    """At a constant velocity a delay only shifts the fit; the first fast frame then has a large error."""
    ground, errors = LiveGround(), []
    random = np.random.default_rng(2)
    north_m, east_m = metres_per_degree(0.0)
    for number in range(60):
        x = 2.0 * number if number < 50 else 98.0 + 40.0 * (number - 49)
        y = random.normal(0, 1.0)
        places = np.array([((y + z) / north_m, (x + w) / east_m) for w, z in ((0, 0), (0, 50), (50, 0))])
        pixels = np.array([[320.0, 180], [320, 130], [370, 180]])
        registered = FrameRegistration(
            np.eye(3), translation(np.array([x, 0])), 0, RegistrationStatus.OK, measured=True
        )
        geo = ground.locate(registered, GroundView(pixels, places, 2.0, number / 10))
        errors.append(math.nan if geo is None else geo.error_m)
    assert max(errors[30:50]) < 5.0
    assert errors[50] > 30.0
