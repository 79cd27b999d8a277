from hypothesis import given
from hypothesis import strategies as st

from streamkit_media.live.timeline import Timeline

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


def test_a_clock_that_is_set_back_goes_on() -> None:
    """A camera that sets its clock back by 3 s sends times that ascend all the same, reordered or not."""
    line = Timeline()
    sent = [(10_000, 9_960), (10_120, 10_000), (10_040, 10_040), (10_080, 10_080)]
    arrivals = range(0, 480, 40)
    set_back = [(7_240, 7_120), (7_160, 7_160), (7_200, 7_200)]
    placed = [
        line.timestamp(pts * 10**6, arrival * 10**6, dts * 10**6)
        for (pts, dts), arrival in zip([*sent, *set_back], arrivals, strict=False)
    ]
    assert [time // 10**6 for time in placed] == [0, 120, 40, 80, 280, 200, 240]


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
