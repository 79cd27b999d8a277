import itertools

from hypothesis import given
from hypothesis import strategies as st

from streamkit import ANY, Frame, FrameFlags
from streamkit.handoff.bounded_queue import BoundedQueue
from streamkit_media.live.connection import DropToKeyframe, QueuedPacket
from streamkit_media.streams import StreamKind

SECOND = 1_000_000_000


def packet_queue(capacity: int, longest_wait_ns: int) -> BoundedQueue[QueuedPacket]:
    """A queue that drops up to a keyframe."""
    return BoundedQueue(capacity, choose_dropped=DropToKeyframe(longest_wait_ns))


def packet(number: int, is_keyframe: bool, arrival_ns: int = 0) -> QueuedPacket:
    """A packet of the video identified by its number."""
    frame = Frame(b"", ANY, flags=FrameFlags.KEYFRAME * is_keyframe, arrival_ns=arrival_ns)
    return QueuedPacket(StreamKind.VIDEO, number, frame)


def fill(ring: BoundedQueue[QueuedPacket], numbers: range, keyframe_every: int) -> None:
    """Puts packets in, every so many a keyframe."""
    for number in numbers:
        ring.put(packet(number, number % keyframe_every == 0))


def empty(ring: BoundedQueue[QueuedPacket]) -> list[int]:
    """Takes everything out."""
    found = []
    while (taken := ring.get()) is not None:
        found.append(taken.number)
    return found


def test_packets_come_out_in_order() -> None:
    """What fits is kept in order, and nothing is dropped."""
    ring = packet_queue(8, SECOND)
    fill(ring, range(8), 4)
    assert empty(ring) == list(range(8))
    assert ring.dropped == 0


def test_a_full_ring_drops_up_to_its_newest_key_frame() -> None:
    """The oldest go, and what stays begins with a keyframe."""
    ring = packet_queue(8, SECOND)
    fill(ring, range(9), 3)
    assert ring.dropped == 6
    assert empty(ring) == [6, 7, 8]


def test_a_key_frame_replaces_everything_when_full() -> None:
    """A keyframe that does not fit makes all older packets needless."""
    ring = packet_queue(8, SECOND)
    fill(ring, range(9), 8)
    assert ring.dropped == 8
    assert empty(ring) == [8]


def test_without_a_key_frame_it_waits_for_the_next() -> None:
    """Where no later keyframe is held, packets are dropped until one comes."""
    ring = packet_queue(4, SECOND)
    fill(ring, range(13), 12)
    assert ring.dropped == 12
    assert empty(ring) == [12]


@given(st.lists(st.one_of(st.booleans(), st.none()), max_size=200), st.integers(2, 9))
def test_every_packet_is_taken_or_counted(steps: list[bool | None], capacity: int) -> None:
    """Delivered and dropped make received; the order is kept; a gap is followed by a keyframe."""
    ring = packet_queue(capacity, SECOND)
    taken: list[QueuedPacket] = []
    count = 0
    for step in steps:
        if step is None:
            item = ring.get()
            taken += [item] if item is not None else []
        else:
            ring.put(packet(count, step))
            count += 1
    while (item := ring.get()) is not None:
        taken.append(item)
    assert len(taken) + ring.dropped == count
    for before, after in itertools.pairwise(taken):
        assert after.number == before.number + 1 or (after.number > before.number and after.is_keyframe)


def test_a_packet_that_waits_too_long_makes_way_for_a_key_frame() -> None:
    """Once the oldest has waited for a second, the next keyframe takes over; without one nothing is lost."""
    ring = packet_queue(100, SECOND)
    for number in range(40):
        ring.put(packet(number, number == 0, number * SECOND // 30))
    assert ring.dropped == 0
    ring.put(packet(40, True, 40 * SECOND // 30))
    ring.put(packet(41, False, 41 * SECOND // 30))
    assert ring.dropped == 40
    assert empty(ring) == [40, 41]


def test_a_stream_without_key_frames_continues() -> None:
    """Where keyframes never come (gradual refresh), packets pass again after a while."""
    ring = packet_queue(4, SECOND)
    fill(ring, range(1, 308), 1000)
    assert empty(ring) == [306, 307]
    assert ring.dropped == 307 - 2


def test_video_goes_on_where_only_telemetry_was_dropped() -> None:
    """None of its packets is missing, so that it need not wait for a keyframe."""
    ring = packet_queue(4, SECOND)
    for number in range(5):
        ring.put(QueuedPacket(StreamKind.KLV, number, Frame(b"", ANY)))
    fill(ring, range(1, 3), 1000)
    assert empty(ring) == [1, 2]


def test_telemetry_is_kept_while_the_video_waits_for_a_key_frame() -> None:
    """It is neither refused nor taken for the frame that ends the wait."""
    ring = packet_queue(4, SECOND)
    fill(ring, range(1, 6), 1000)
    for number in range(3):
        ring.put(QueuedPacket(StreamKind.KLV, number, Frame(b"", ANY)))
        ring.put(packet(6 + number, is_keyframe=False))
    ring.put(packet(9, is_keyframe=True))
    found = [(taken.kind.value, taken.number) for taken in iter(ring.get, None)]
    assert found == [("klv", 0), ("klv", 1), ("klv", 2), ("video", 9)]
