from fractions import Fraction
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from streamkit import SECOND_NS, Caps, FrameFlags
from streamkit_media.container import open_container, video_stream
from streamkit_media.streams import nanoseconds, packet_frame, read_packets

CAPS = Caps("video/x-h264")


@given(
    st.integers(-(10**12), 10**12),
    st.sampled_from([Fraction(1, 90000), Fraction(1001, 30000), Fraction(1, 12800)]),
)
def test_nanoseconds_are_rounded_once(ticks: int, time_base: Fraction) -> None:
    """At any time the error is at most half a nanosecond."""
    assert abs(nanoseconds(ticks, time_base) - ticks * time_base * SECOND_NS) <= Fraction(1, 2)


def test_nothing_drifts_in_ten_hours() -> None:
    """After ten hours at 30000/1001 a frame's time is exact to the nanosecond."""
    count = 10 * 3600 * 30000 // 1001
    assert nanoseconds(count, Fraction(1001, 30000)) == round(count * Fraction(1001, 30000) * SECOND_NS)


def test_packets_become_frames(small_video: Path) -> None:
    """Each packet has its time, duration and keyframe mark, and shares its bytes."""
    with open_container(str(small_video)) as container:
        packets = list(read_packets(container, video_stream(container, "small")))
        frames = [packet_frame(packet, CAPS) for packet in packets]
    assert sorted(frame.pts for frame in frames if frame.pts is not None) == [
        n * 40_000_000 for n in range(12)
    ]
    assert {frame.duration for frame in frames} == {40_000_000}
    assert [n for n, frame in enumerate(frames) if frame.flags & FrameFlags.KEYFRAME] == [0, 6]
    assert frames[0].data is packets[0]


@pytest.mark.parametrize("pts", [None, 512])
def test_a_missing_time_stays_missing(small_video: Path, pts: int | None) -> None:
    """A packet without time gives a frame without time, not one at zero."""
    with open_container(str(small_video)) as container:
        packet = next(read_packets(container, video_stream(container, "small")))
    packet.pts = pts
    frame = packet_frame(packet, CAPS)
    assert (frame.pts is None) == (pts is None)


def test_damage_noted_by_the_container_is_kept(small_video: Path) -> None:
    """A packet that FFmpeg marks corrupt gives a frame marked corrupt."""
    with open_container(str(small_video)) as container:
        packet = next(read_packets(container, video_stream(container, "small")))
    packet.is_corrupt = True
    assert packet_frame(packet, CAPS).flags & FrameFlags.CORRUPT
