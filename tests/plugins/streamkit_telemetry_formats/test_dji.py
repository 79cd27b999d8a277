import math
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from streamkit.geometry.camera import rotation_matrix
from streamkit_telemetry_formats.dji import DjiTelemetry, relative_angles, sample_of
from streamkit_telemetry_formats.sample import Sample

FIRST = {
    "air2s.srt": (41.424724, 2.234156, 117.0, "dji"),
    "matrice_300.srt": (36.6146, -6.1120, 0.3, "dji above take-off"),
    "mavic_mini.SRT": (48.0771, -121.7458, 200.7, "dji above take-off"),
    "mavic_pro.SRT": (-20.2533, 149.0251, 1.9, "dji above take-off"),
    "p4_rtk.SRT": (-34.237922, -58.851745, 85.8, "dji above take-off"),
    "broken_incomplete.SRT": (-34.7383, -58.4563, 20.1, "dji above take-off"),
}


def samples_of(text: str) -> list[Sample]:
    """The samples of a subtitle file's text."""
    return list(DjiTelemetry().read(text.split("\n")))


@pytest.mark.parametrize("name", FIRST)
def test_every_dialect(streamkit_data: Path, name: str) -> None:
    """Every subtitle that holds a position becomes a sample, times ascending, the first one as written."""
    text = (streamkit_data / "telemetry" / "dji" / name).read_text(encoding="utf-8", errors="replace")
    samples = list(samples_of(text))
    first = samples[0]
    assert (first.latitude, first.longitude, first.altitude, first.source) == FIRST[name]
    written = len(re.findall(r"(?m)GPS ?\(|\[latitude", text))
    unfixed = len(re.findall(r"GPS ?\(0\.0000,0\.0000", text))
    assert len(samples) == written - unfixed
    assert all(a.pts < b.pts for a, b in pairwise(samples))
    assert all(
        abs(s.latitude - first.latitude) < 0.2 and abs(s.longitude - first.longitude) < 0.2 for s in samples
    )


@pytest.mark.parametrize("name", ["mavic_air.SRT", "broken_empty.SRT"])
def test_files_without_positions(streamkit_data: Path, name: str) -> None:
    """A model that writes no position, and an empty file, give no sample and no error."""
    text = (streamkit_data / "telemetry" / "dji" / name).read_text(encoding="utf-8")
    assert list(samples_of(text)) == []


def test_attitude_and_gimbal_of_the_phantom() -> None:
    """F.PRY is the aircraft's pitch, roll, yaw; the gimbal's is turned into angles against it."""
    text = "GPS (-58.85, -34.23, 15), H 85.80m, F.PRY (2.7°, -7.0°, 110.1°), G.PRY (-24.4°, 0.0°, 110.4°)"
    sample = sample_of(text, 5)
    assert sample is not None
    assert math.degrees(sample.heading or 0) == pytest.approx(110.1)
    assert math.degrees(sample.pitch or 0) == pytest.approx(2.7)
    assert math.degrees(sample.roll or 0) == pytest.approx(-7.0)
    assert sample.sensor_angles is not None
    azimuth, elevation, roll = sample.sensor_angles
    platform = rotation_matrix(*map(math.radians, (110.1, 2.7, -7.0)))
    again = platform @ rotation_matrix(azimuth, elevation, roll)
    np.testing.assert_allclose(again, rotation_matrix(*map(math.radians, (110.4, -24.4, 0.0))), atol=1e-12)


def test_a_level_platform_leaves_the_gimbals_angles() -> None:
    """Without pitch and roll the azimuth is the difference of the yaws; straight down has one angle."""
    azimuth, elevation, roll = relative_angles(
        (0, 0, math.radians(350)), (math.radians(-30), 0, math.radians(10))
    )
    assert math.degrees(azimuth) == pytest.approx(20)
    assert math.degrees(elevation) == pytest.approx(-30)
    assert math.remainder(roll, 2 * math.pi) == pytest.approx(0)
    azimuth, elevation, roll = relative_angles((0, 0, 0.5), (-math.pi / 2, 0, 0.7))
    assert azimuth == pytest.approx(0.2)
    assert (elevation, roll) == (pytest.approx(-math.pi / 2), 0.0)


def test_newer_models() -> None:
    """The bracket dialect of Mavic 3 and M30: misspelt longitude, absolute height, gimbal."""
    text = (
        "[latitude: 22.5] [longtitude: 113.9] [rel_alt: 1.300 abs_alt: 85.013] "
        "[gb_yaw: 97.8 gb_pitch: -24.2 gb_roll: 0.0]"
    )
    sample = sample_of(text, 0)
    assert sample is not None
    assert (sample.latitude, sample.longitude, sample.altitude) == (22.5, 113.9, 85.013)
    assert sample.source == "dji above sea level"
    assert sample.sensor_angles is not None
    assert math.degrees(sample.sensor_angles[1]) == pytest.approx(-24.2)


@pytest.mark.parametrize(
    ("lens", "degrees"),
    [
        ("[focal_len : 240] [dzoom_ratio: 10000, delta:0],", 71.59),
        ("[focal_len: 24.00] [dzoom_ratio: 1.00],", 71.59),
        ("[focal_len: 24.00] [dzoom_ratio: 2.00],", 39.65),
        ("[focal_len: 168.00]", 11.76),
    ],
)
def test_the_focal_length_gives_the_field_of_view(lens: str, degrees: float) -> None:
    """Older models write tenths of a millimetre and ten-thousandths of the zoom, without a point."""
    sample = sample_of(f"{lens} [latitude: 53.578046] [longitude: -1.775009]", 0)
    assert sample is not None
    assert sample.field_of_view is not None
    across, down = sample.field_of_view
    assert math.degrees(across) == pytest.approx(degrees, abs=0.01)
    assert math.tan(down / 2) == pytest.approx(math.tan(across / 2) * 9 / 16)


@pytest.mark.parametrize(
    "lens", ["", "[focal_len: 0]", "[focal_len: 1]", "[focal_len: 24.0.0]", "[focal_len: x]"]
)
def test_without_a_focal_length_the_field_of_view_is_unknown(lens: str) -> None:
    """What is no focal length of a flying camera gives none."""
    sample = sample_of(f"{lens} [latitude: 53.578046] [longitude: -1.775009]", 0)
    assert sample is not None
    assert sample.field_of_view is None


@pytest.mark.parametrize(
    "text", ["", "GPS (0.0, 0.0, 0)", "GPS (191.0, -95.0, 4)", "[latitude: 3.0]", "GPS(,,)"]
)
def test_without_a_fix_there_is_no_sample(text: str) -> None:
    """No position, a zero position and one that is not on earth make no sample."""
    assert sample_of(text, 0) is None


def test_heights_of_the_oldest_format() -> None:
    """Hb: is the barometer's height above take-off; Hs:, the sonar's above the ground, serves without it."""
    both = sample_of("[GPS](149.0251,-20.2533,16) GPS(149.0251,-20.2533,16) Hb:1.9 Hs:0.4", 0)
    assert both is not None
    assert (both.altitude, both.source) == (1.9, "dji above take-off")
    sonar = sample_of("GPS(149.0251,-20.2533,16) Hs: 0.4", 0)
    assert sonar is not None
    assert (sonar.altitude, sonar.source) == (0.4, "dji above ground")


@pytest.mark.parametrize("gap", ["\n\n", "\n", "\r\n\r\n"])
def test_subtitles_without_times_go_by_the_clock(gap: str) -> None:
    """Without a line of times, the local time gives the time since the first one."""
    text = "".join(
        f"{n}\n2017.08.05 14:11:{50 + n}\nGPS(149.0251,-20.2533,16) ISO:100{gap}" for n in range(1, 5)
    )
    telemetry = DjiTelemetry()
    assert [s.pts for s in telemetry.read(text.split("\n"))] == [0, 10**9, 2 * 10**9, 3 * 10**9]
    assert (telemetry.subtitles, telemetry.broken) == (4, 0)


def test_a_subtitle_that_has_lost_its_times_is_placed_between_the_others() -> None:
    """The clock is set by the subtitles that have times; to the microsecond where it has them."""
    text = (
        "1\n00:00:00,000 --> 00:00:00,033\n2022-08-07 13:40:40,774,808\n[latitude: 1.5] [longitude: 2.5]\n\n"
        "2\n2022-08-07 13:40:40,808,164\n[latitude: 1.6] [longitude: 2.5]\n\n"
    )
    assert [sample.pts for sample in samples_of(text)] == [0, 33_356_000]


def test_the_time_between_subtitles_serves_without_a_fine_clock() -> None:
    """DiffTime is the duration of each one."""
    text = "".join(
        f"{n}\nFrameCnt : {n}, DiffTime : 33ms\n[latitude: 1.5] [longitude: 2.5]\n\n" for n in (1, 2, 3)
    )
    assert [sample.pts for sample in samples_of(text)] == [0, 33_000_000, 66_000_000]


@pytest.mark.parametrize(
    "cue",
    [
        "2\n00:00:0x,000 --> 00:00:02,000\nGPS(1.0,2.0,16)",
        "2\nGPS(1.0,2.0,16) ISO:100",
        "2\n0000-00-00 99:99:99\nGPS(1.0,2.0,16)",
        "2\n00:00:01,000 --> 00:00:02,000\nGPS(1.0,2.",
        "2\n00:00:01,000 --> 00:00:02,000\n[latitude: 4x1] [longitude: 2.5]",
        "2\n00:00:01,000 --> 00:00:02,000\nGPS(191.0,-95.0,4)",
        f"2\n00:00:01,000 --> 00:00:02,000\nGPS({'9' * 400},2.0,16)",
        "2\n00:00:01,000 --> 00:00:02,000",
    ],
)
def test_broken_subtitles_are_counted(cue: str) -> None:
    """Times or a position that cannot be read cost one subtitle, which is counted."""
    telemetry = DjiTelemetry()
    whole = "1\n00:00:00,000 --> 00:00:01,000\nGPS(1.0,2.0,16) BAROMETER:1.9\n\n"
    assert len(list(telemetry.read((whole + cue).split("\n")))) == 1
    assert telemetry.broken == 1


@pytest.mark.parametrize(
    "text", ["GPS (0.0, 0.0, 0)", "GPS(n/a, n/a, 0)", "[latitude: 0.000000] [longitude: 0]", ""]
)
def test_no_fix_is_not_broken(text: str) -> None:
    """The text before the first fix does not count as damage."""
    telemetry = DjiTelemetry()
    assert telemetry.sample(text, 0) is None
    assert (telemetry.broken, telemetry.subtitles - telemetry.poses) == (0, 1)


def test_long_rows_of_digits_are_not_numbers() -> None:
    """Such angles and heights would be infinite; they are left out."""
    sample = sample_of(f"GPS(1.0,2.0,16) BAROMETER:{'9' * 400} F.PRY ({'9' * 400}, 0.0, 0.0)", 0)
    assert sample is not None
    assert (sample.altitude, sample.pitch) == (None, None)


PIECES = st.sampled_from(
    [
        *(
            "1",
            "2",
            "-->",
            "00:00:01,000 --> 00:00:02,000",
            "GPS(",
            "1.5",
            ",",
            ")",
            "[latitude: ",
            "]",
            "n/a",
        ),
        *("-", "9" * 50, "[longtitude: 2.0]", "2018-09-02 10:22:05,325,621", "9999.12.31 23:59:59"),
        *("0001.01.01 00:00:00", "DiffTime : 33ms", "Hb:", "F.PRY (2, 3, 4)", "\n", "\n\n", "\ufeff", " "),
    ]
)


@settings(max_examples=300)
@given(st.lists(PIECES, max_size=60))
def test_any_mixture_is_accepted(pieces: list[str]) -> None:
    """Pieces of subtitles in any order give finite samples within the time that subtitles reach, or none."""
    for sample in samples_of("".join(pieces)):
        assert 0 <= sample.pts < 4 * 10**15
        assert sample.altitude is None or math.isfinite(sample.altitude)
