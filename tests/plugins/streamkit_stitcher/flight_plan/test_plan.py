"""Flight strips before they are flown."""

import math

import pytest

from streamkit_stitcher.flight_plan.plan import GeodeticPoint, parse_strip, plan_strip

pytest.importorskip("pyproj")
SHAPE = (720, 1280)


def test_a_strip_along_the_equator():
    """A thousandth of a degree is 111.32 m there; frames and seconds follow from overlap and speed."""
    ends = GeodeticPoint(0.0, 10.0), GeodeticPoint(0.0, 10.01)
    plan = plan_strip(ends, 100.0, 2 * math.atan(0.5), 0.6, 10.0, SHAPE)
    assert plan.length_m == pytest.approx(1113.2, abs=0.1)
    assert plan.heading == pytest.approx(math.pi / 2)
    assert plan.footprint_m == pytest.approx((100.0, 56.25))
    assert plan.images == math.ceil(1113.2 / 22.5) + 1
    assert plan.interval_s == pytest.approx(2.25)
    assert plan.sampling_m == pytest.approx(100 / 1280)


def test_the_ends_are_read_longitude_first():
    """lon,lat,lon,lat."""
    assert parse_strip("-46.84,-23.51,-46.83,-23.5") == (
        GeodeticPoint(-23.51, -46.84),
        GeodeticPoint(-23.5, -46.83),
    )


@pytest.mark.parametrize("text", ["", "1,2,3", "a,b,c,d", "nan,0,0,0", "0,95,0,0", "190,0,0,0"])
def test_other_texts_are_refused(text):
    """The error quotes what came."""
    with pytest.raises(ValueError, match="got"):
        parse_strip(text)


@pytest.mark.parametrize(("altitude", "speed", "overlap"), [(0, 5, 0.5), (50, 0, 0.5), (50, 5, 1.0)])
def test_no_flight_is_refused(altitude, speed, overlap):
    """Standing on the ground, hovering, or a frame that never moves on."""
    ends = GeodeticPoint(0.0, 0.0), GeodeticPoint(0.0, 0.01)
    with pytest.raises(ValueError, match="above 0"):
        plan_strip(ends, altitude, 1.0, overlap, speed, SHAPE)


def test_an_endless_strip_is_refused():
    """A strip around the earth from a metre up names the number of frames."""
    ends = GeodeticPoint(0.0, 0.0), GeodeticPoint(0.0, 170.0)
    with pytest.raises(ValueError, match="at most 100000 are possible"):
        plan_strip(ends, 1.0, 1.0, 0.9, 5.0, SHAPE)
