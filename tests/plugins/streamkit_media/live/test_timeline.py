from fractions import Fraction

import pytest
from av.packet import Packet
from hypothesis import given
from hypothesis import strategies as st

from streamkit import Caps
from streamkit.testing import ManualClock
from streamkit_media.live.timeline import PacketStamps, Timeline

SECOND = 10**9


def test_a_connection_keeps_the_senders_distances() -> None:
    """Within a connection times are as far apart as the sender says, however they arrive."""
    line = Timeline()
    line.begin_connection()
    placed = [
        line.timestamp(pts, 7 * SECOND + wobble) for pts, wobble in ((None, 0), (33, 5_000), (66, 4_000))
    ]
    assert placed == [0, 33, 66]


def test_reordered_times_stay_reordered() -> None:
    """Packets in decoding order have times that go back and forth; they are left so."""
    line = Timeline()
    assert [line.timestamp(pts, pts) for pts in (0, 120, 40, 80, 240)] == [0, 120, 40, 80, 240]


def test_a_new_connection_continues_by_arrival_time() -> None:
    """The distance of two connections is the time between their arrivals, independent of their clocks."""
    line = Timeline()
    line.begin_connection()
    line.timestamp(5 * SECOND, SECOND)
    line.begin_connection()
    assert line.timestamp(1, 11 * SECOND) == 10 * SECOND
    assert line.timestamp(2, 11 * SECOND) == 10 * SECOND + 1


def test_a_jump_of_the_senders_clock_is_removed() -> None:
    """Timestamps stay continuous where the sender's clock jumps by an hour and arrivals do not."""
    line = Timeline()
    line.timestamp(0, 0)
    assert line.timestamp(3600 * SECOND, SECOND) == SECOND
    assert line.timestamp(3601 * SECOND, 2 * SECOND) == 2 * SECOND


def test_the_first_reordered_frame_is_no_clock_set_back() -> None:
    """Estimated decoding times step back where the first B-frame comes; times keep the server's distances."""
    stamps, placed = PacketStamps(ManualClock()), []
    for time in (0, 33, 100, 67, 133):
        packet = Packet(b"coded")
        packet.pts = packet.dts = time
        packet.time_base = Fraction(1, 1000)
        placed.append(stamps.stamped(packet, Caps("video/x-h264")).pts)
    assert placed == [0, 33 * 10**6, 100 * 10**6, 67 * 10**6, 133 * 10**6]


@pytest.mark.parametrize(
    ("order", "expected"),
    [([0, 1, 2, 3, 4, 5, 6], [280, 320, 360]), ([0, 3, 1, 2, 6, 4, 5], [321, 441, 361])],
    ids=["in order", "reordered"],
)
def test_a_clock_that_is_set_back_goes_on(order: list[int], expected: list[int]) -> None:
    """A camera that sets its clock back by 3 s sends times that ascend all the same, and close to arrival."""
    line = Timeline()
    places = [*order, *(7 + frame for frame in order[:3])]
    sent = [10_000 + 40 * place - (3000 if place > 6 else 0) for place in places]
    placed = [line.timestamp(pts * 10**6, 40 * 10**6 * number) for number, pts in enumerate(sent)]
    assert [time // 10**6 for time in placed[:7]] == [40 * place for place in order]
    assert [time // 10**6 for time in placed[7:]] == expected


def test_a_long_pause_is_kept() -> None:
    """A pause of sender and arrivals by a minute appears in the timestamps."""
    line = Timeline()
    line.timestamp(0, 0)
    assert line.timestamp(60 * SECOND, 61 * SECOND) == 60 * SECOND


@given(st.lists(st.lists(st.integers(0, 10**7), min_size=1, max_size=20), min_size=1, max_size=10))
def test_every_connection_lies_after_those_before(steps: list[list[int]]) -> None:
    """Times of a connection are higher than all of the ones before it."""
    line = Timeline()
    arrival, highest = 0, -1
    for connection in steps:
        line.begin_connection()
        pts, placed = 0, []
        for step in connection:
            pts, arrival = pts + step, arrival + step // 2
            placed.append(line.timestamp(pts, arrival))
        assert min(placed) > highest
        highest = max(placed)


def test_packets_without_a_time_get_that_of_arrival() -> None:
    """JPEG over HTTP has no times: they are as far apart as the packets arrive."""
    line = Timeline()
    line.begin_connection()
    assert [line.timestamp(None, arrival) for arrival in (5, 45, 80)] == [0, 40, 75]


def test_a_packet_without_a_time_among_others_keeps_their_order() -> None:
    """What a network left of a frame may have no time, and arrive after the next frame was due."""
    line = Timeline()
    packets = [(0, 0), (None, 45 * 10**6), (40 * 10**6, 50 * 10**6)]
    placed = [line.timestamp(pts, arrival) for pts, arrival in packets]
    assert placed == sorted(placed)
    assert placed[2] == 40 * 10**6
