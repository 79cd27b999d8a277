"""Photographs with their place and attitude, alone and through a pipeline."""

import math
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from streamkit import Pipeline, Pose
from streamkit_telemetry_formats.photograph import read_fields, sample_of_photograph

PICTURE = cv2.imencode(".jpg", np.full((48, 64, 3), 90, np.uint8))[1].tobytes()
XMP = b"""http://ns.adobe.com/xap/1.0/\0<rdf:Description drone-dji:GpsLatitude="10.5"
 drone-dji:GpsLongtitude="-20.25" drone-dji:AbsoluteAltitude="+101.5" drone-dji:GimbalPitchDegree="-90.0"
 drone-dji:GimbalRollDegree="0.0" drone-dji:GimbalYawDegree="30.0" drone-dji:FlightPitchDegree="0.0"
 drone-dji:FlightRollDegree="0.0" drone-dji:FlightYawDegree="-30.0"/>"""


@pytest.fixture(scope="module")
def beach(streamkit_data: Path) -> Path:
    """18 photographs of a drone in three strips."""
    return streamkit_data / "mosaic" / "brighton_beach"


def with_xmp(video_frame: bytes) -> bytes:
    """A frame with the XMP above."""
    return video_frame[:2] + b"\xff\xe1" + (len(XMP) + 2).to_bytes(2, "big") + XMP + video_frame[2:]


def test_xmp_has_position_and_attitude() -> None:
    """The gimbal's angles count against the aircraft; down is an elevation of minus 90 degrees."""
    sample = sample_of_photograph(with_xmp(PICTURE), 5)
    assert sample is not None
    assert (sample.pts, sample.latitude, sample.longitude, sample.altitude) == (5, 10.5, -20.25, 101.5)
    assert sample.heading == pytest.approx(math.radians(330))
    assert sample.sensor_angles == pytest.approx((math.radians(60), -math.pi / 2, 0.0))
    assert sample.field_of_view is None
    assert sample.source == "dji above sea level"


def test_the_model_gives_the_field_of_view_where_no_focal_length_does() -> None:
    """The camera's code in Exif stands for a DJI model; the picture is 4:3."""
    entry = struct.pack("<HHII", 0x0110, 2, 7, 26)
    exif = b"Exif\0\0II*\0" + struct.pack("<IH", 8, 1) + entry + bytes(4) + b"FC7303\0"
    segment = b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif
    sample = sample_of_photograph(with_xmp(PICTURE[:2] + segment + PICTURE[2:]), 5)
    assert sample is not None
    assert sample.field_of_view is not None
    assert [math.degrees(view) for view in sample.field_of_view] == pytest.approx([70.58, 55.93], abs=0.01)


def test_a_frame_without_a_place_has_no_sample() -> None:
    """A file that is not a JPEG has none."""
    assert sample_of_photograph(PICTURE, 0) is None
    assert sample_of_photograph(b"\x89PNG\r\n", 0) is None


def test_a_survey_flies_three_strips(beach: Path) -> None:
    """All 18 have a place: six to a strip 13 to 15 m apart, 25 m between strips; the camera looks down."""
    samples = [sample_of_photograph(path.read_bytes(), 0) for path in sorted(beach.glob("*.JPG"))]
    assert len(samples) == 18
    assert all(sample is not None for sample in samples)
    places = np.array([(sample.latitude, sample.longitude) for sample in samples if sample is not None])
    metres = np.diff(places, axis=0) * 111_320 * [1, math.cos(math.radians(places[0, 0]))]
    steps = np.hypot(*metres.T)
    assert np.flatnonzero(steps > 20).tolist() == [5, 11]
    assert steps[steps < 20] == pytest.approx(14, abs=1)
    assert steps[steps > 20] == pytest.approx(26, abs=1)
    for sample in samples:
        assert sample is not None
        assert sample.altitude == pytest.approx(198, abs=2)
        assert sample.sensor_angles is not None
        assert sample.sensor_angles[1] < -math.radians(80)
        # 94 degrees along the diagonal of 4:3, of which 16:9 has the whole width.
        assert sample.field_of_view == pytest.approx((math.radians(81.25), math.radians(51.52)), abs=0.001)


def test_pose_travels_with_the_decoded_frame(tmp_path: Path) -> None:
    """`multifilesrc` attaches it, `decode` keeps it; a frame without a position has none."""
    (tmp_path / "p0.jpg").write_bytes(with_xmp(PICTURE))
    (tmp_path / "p1.jpg").write_bytes(PICTURE)
    with Pipeline.parse(f"multifilesrc location={tmp_path}/p%d.jpg ! decode ! appsink name=out") as pipeline:
        pipeline.play()
        first, second = [frame.get(Pose) for frame in pipeline["out"]]
    assert first is not None
    assert (first.latitude, first.longitude, first.altitude) == (10.5, -20.25, 101.5)
    assert not first.is_stale
    assert second is None


def test_attributes_and_elements_are_both_read() -> None:
    """XMP may write a value either way; signs and blanks are taken."""
    packet = b"""<rdf:Description drone-dji:GimbalPitchDegree="-90.00" drone-dji:AbsoluteAltitude='+12.5'
        tiff:Make="DJI"><drone-dji:FlightYawDegree> 8.5 </drone-dji:FlightYawDegree></rdf:Description>"""
    expected = {"GimbalPitchDegree": -90.0, "AbsoluteAltitude": 12.5, "FlightYawDegree": 8.5}
    assert read_fields(packet) == expected


def test_values_that_are_not_numbers_are_skipped() -> None:
    """Words, other name spaces and an empty packet give nothing."""
    assert read_fields(b'drone-dji:Model="FC300S" exif:GpsLatitude="1.0"') == {}
    assert read_fields(b"") == {}
