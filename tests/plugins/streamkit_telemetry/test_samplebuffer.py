import math

import pytest

from streamkit_telemetry.samplebuffer import CAPACITY, SampleBuffer
from streamkit_telemetry_formats.sample import Sample, between

SECOND = 10**9


def buffer_of(*samples: Sample, longest_gap_ns: int = SECOND) -> SampleBuffer:
    """A buffer with these samples."""
    buffer = SampleBuffer(longest_gap_ns)
    for sample in samples:
        buffer.add(sample)
    return buffer


def test_between_two_samples_is_interpolated() -> None:
    """Half way, every quantity is half way; the gap is to the nearest measurement."""
    before = Sample(10.0, 20.0, 100.0, 0.1, pts=0, field_of_view=(0.4, 0.2), corners=((1.0, 1.0),), utc_ns=0)
    after = Sample(
        11.0, 22.0, 200.0, 0.3, pts=SECOND, field_of_view=(0.2, 0.1), corners=((3.0, 5.0),), utc_ns=SECOND
    )
    found = buffer_of(before, after).sample_at(SECOND // 2)
    assert found is not None
    sample, gap, stale = found
    assert (sample.latitude, sample.longitude, sample.altitude) == (10.5, 21.0, 150.0)
    assert sample.heading == pytest.approx(0.2)
    assert sample.field_of_view == pytest.approx((0.3, 0.15))
    assert sample.corners == ((2.0, 3.0),)
    assert sample.utc_ns == SECOND // 2
    assert (abs(gap), stale) == (SECOND // 2, False)


def test_angles_take_the_shorter_way() -> None:
    """From 350 to 10 degrees leads over north; from 179 to -179 degrees of longitude over the date line."""
    before = Sample(0.0, 179.0, pts=0, heading=math.radians(350), roll=math.radians(-10))
    after = Sample(0.0, -179.0, pts=10, heading=math.radians(10), roll=math.radians(10))
    middle = between(before, after, 5)
    assert math.remainder(middle.heading or 0.0, 2 * math.pi) == pytest.approx(0, abs=1e-12)
    assert middle.roll == pytest.approx(0)
    assert abs(middle.longitude) == pytest.approx(180)
    assert math.degrees(between(before, after, 2).heading or 0) == pytest.approx(354)


def test_a_measurement_at_the_time_is_taken_as_it_is() -> None:
    """Gap 0, nothing interpolated."""
    exact = Sample(1.0, 2.0, pts=5)
    assert buffer_of(Sample(0.0, 0.0, pts=0), exact, Sample(9.0, 9.0, pts=9)).sample_at(5) == (
        exact,
        0,
        False,
    )


def test_far_samples_are_not_interpolated_and_stale() -> None:
    """In a gap the nearest sample is used, stale beyond the limit; the sign of the distance is its side."""
    buffer = buffer_of(Sample(1.0, 1.0, pts=0), Sample(2.0, 2.0, pts=10 * SECOND))
    sample, gap, stale = buffer.sample_at(4 * SECOND) or pytest.fail("no sample")
    assert (sample.latitude, gap, stale) == (1.0, -4 * SECOND, True)
    sample, gap, stale = buffer.sample_at(9 * SECOND + 1) or pytest.fail("no sample")
    assert (sample.latitude, gap, stale) == (2.0, SECOND - 1, False)


def test_late_and_repeated_samples_find_their_place() -> None:
    """Samples may come out of order; one of the same time replaces the first."""
    buffer = buffer_of(
        Sample(0.0, 0.0, pts=0),
        Sample(20.0, 0.0, pts=20),
        Sample(10.0, 0.0, pts=10),
        Sample(21.0, 0.0, pts=20),
    )
    assert len(buffer) == 3
    assert [buffer.sample_at(pts)[0].latitude for pts in (0, 10, 20)] == [0.0, 10.0, 21.0]  # type: ignore[index]


def test_memory_is_bounded() -> None:
    """A flight of days keeps the newest samples only."""
    buffer = buffer_of(*(Sample(0.0, 0.0, pts=n) for n in range(CAPACITY + 500)))
    assert len(buffer) == CAPACITY
    assert buffer.covers(CAPACITY + 499)
    assert not buffer.covers(CAPACITY + 500)


def test_without_samples_there_is_no_pose() -> None:
    """An empty buffer has nothing, and a cleared one has nothing again."""
    buffer = buffer_of(Sample(0.0, 0.0, pts=0))
    buffer.clear()
    assert buffer.sample_at(0) is None
    assert not buffer.covers(0)
