import itertools
import threading

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from streamkit_media.rtsp.packetqueue import PacketQueue


def fill(ring: PacketQueue[int], numbers: range, keyframe_every: int) -> None:
    """Puts numbers in, every so many a key frame."""
    for number in numbers:
        ring.put(number, number % keyframe_every == 0)


def empty(ring: PacketQueue[int]) -> list[int]:
    """Takes everything out."""
    found = []
    while (number := ring.take(0)) is not None:
        found.append(number)
    return found


def test_packets_come_out_in_order() -> None:
    """What fits is kept in order, and nothing is dropped."""
    ring: PacketQueue[int] = PacketQueue(8)
    fill(ring, range(8), 4)
    assert empty(ring) == list(range(8))
    assert ring.take_dropped() == 0


def test_a_full_ring_drops_up_to_its_newest_key_frame() -> None:
    """The oldest go, and what stays begins with a key frame."""
    ring: PacketQueue[int] = PacketQueue(8)
    fill(ring, range(9), 3)
    assert ring.take_dropped() == 6
    assert empty(ring) == [6, 7, 8]


def test_a_key_frame_replaces_everything_when_full() -> None:
    """A key frame that does not fit makes all older packets needless."""
    ring: PacketQueue[int] = PacketQueue(8)
    fill(ring, range(9), 8)
    assert ring.take_dropped() == 8
    assert empty(ring) == [8]


def test_without_a_key_frame_it_waits_for_the_next() -> None:
    """Where no later key frame is held, packets are dropped until one comes."""
    ring: PacketQueue[int] = PacketQueue(4)
    fill(ring, range(13), 12)
    assert ring.take_dropped() == 12
    assert empty(ring) == [12]


@settings(deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(st.one_of(st.booleans(), st.none()), max_size=200), st.integers(2, 9))
def test_every_packet_is_taken_or_counted(steps: list[bool | None], capacity: int) -> None:
    """Delivered and dropped make received; the order is kept; a gap is followed by a key frame."""
    ring: PacketQueue[tuple[int, bool]] = PacketQueue(capacity)
    taken: list[tuple[int, bool]] = []
    count = 0
    for step in steps:
        if step is None:
            item = ring.take(0)
            taken += [item] if item is not None else []
        else:
            ring.put((count, step), step)
            count += 1
    while (item := ring.take(0)) is not None:
        taken.append(item)
    assert len(taken) + ring.take_dropped() == count
    for (before, _), (after, is_keyframe) in itertools.pairwise(taken):
        assert after == before + 1 or (after > before and is_keyframe)


def test_an_error_comes_after_the_last_packet() -> None:
    """What was read before the error is delivered first."""
    ring: PacketQueue[int] = PacketQueue(4)
    ring.put(1, True)
    ring.end(OSError("gone"))
    assert not ring.is_over
    assert ring.take(0) == 1
    assert ring.is_over
    with pytest.raises(OSError, match="gone"):
        ring.take(0)


def test_a_wait_ends_when_woken_or_over() -> None:
    """A waiting taker comes back with a packet, when woken, and when the stream is over."""
    ring: PacketQueue[int] = PacketQueue(4)
    for act in (lambda: ring.put(7, True), ring.wake, ring.end):
        timer = threading.Timer(0.05, act)
        timer.start()
        assert ring.take(20) == (7 if act not in (ring.wake, ring.end) else None)
        timer.join()


def test_a_packet_that_waits_too_long_makes_way_for_a_key_frame() -> None:
    """Once the oldest has waited for a second, the next key frame takes over; without one nothing is lost."""
    ring: PacketQueue[int] = PacketQueue(100, longest_wait_s=1.0)
    for number in range(40):
        ring.put(number, number == 0, number / 30)
    assert ring.dropped == 0
    ring.put(40, True, 40 / 30)
    ring.put(41, False, 41 / 30)
    assert (ring.received, ring.dropped) == (42, 40)
    assert empty(ring) == [40, 41]


def test_a_stream_without_key_frames_goes_on() -> None:
    """Where key frames never come (gradual refresh), packets pass again after a while."""
    ring: PacketQueue[int] = PacketQueue(4)
    fill(ring, range(1, 308), 1000)
    assert empty(ring) == [306, 307]
    assert ring.received == ring.dropped + 2
