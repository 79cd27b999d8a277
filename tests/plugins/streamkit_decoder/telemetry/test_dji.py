import math
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from streamkit_decoder.telemetry.dji import read_samples, relative_angles, rotation, sample_of

FIRST = {
    "air2s.srt": (41.424724, 2.234156, 117.0, "dji"),
    "matrice_300.srt": (36.6146, -6.1120, 0.3, "dji above take-off"),
    "mavic_mini.SRT": (48.0771, -121.7458, 200.7, "dji above take-off"),
    "mavic_pro.SRT": (-20.2533, 149.0251, 1.9, "dji above take-off"),
    "p4_rtk.SRT": (-34.237922, -58.851745, 85.8, "dji above take-off"),
    "broken_incomplete.SRT": (-34.7383, -58.4563, 20.1, "dji above take-off"),
}


@pytest.mark.parametrize("name", FIRST)
def test_every_dialect(streamkit_data: Path, name: str) -> None:
    """Every subtitle that holds a position becomes a sample, times ascending, the first one as written."""
    text = (streamkit_data / "telemetry" / "dji" / name).read_text(encoding="utf-8", errors="replace")
    samples = list(read_samples(text))
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
    assert list(read_samples(text)) == []


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
    again = rotation(math.radians(2.7), math.radians(-7.0), math.radians(110.1)) @ rotation(
        elevation, roll, azimuth
    )
    np.testing.assert_allclose(again, rotation(math.radians(-24.4), 0.0, math.radians(110.4)), atol=1e-12)


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
    "text", ["", "GPS (0.0, 0.0, 0)", "GPS (191.0, -95.0, 4)", "[latitude: 3.0]", "GPS(,,)"]
)
def test_no_fix_is_no_sample(text: str) -> None:
    """No position, a zero position and one that is not on earth make no sample."""
    assert sample_of(text, 0) is None
