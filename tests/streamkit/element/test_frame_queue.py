"""FrameQueue: order, levels and drops."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from streamkit import Caps, EosEvent, Frame, Segment, SegmentEvent
from streamkit.element.frame_queue import FrameQueue, data_size

ANYTHING = Caps("a/b")
SECOND = 1_000_000_000


def frame(seq: int = 0, data: bytes = b"", pts: int | None = None, duration: int | None = None) -> Frame:
    """A frame of a few bytes."""
    return Frame(data, ANYTHING, pts, duration, seq=seq)


@pytest.mark.parametrize(
    ("data", "size"),
    [(b"123", 3), (bytearray(2), 2), (np.zeros((2, 3), np.uint16), 12), ("ab", 2), (None, 0)],
)
def test_data_size(data: object, size: int) -> None:
    """Of arrays, bytes and text; 0 for other objects."""
    assert data_size(data) == size


def test_events_keep_their_place_and_are_not_counted() -> None:
    """Only frames have a level."""
    queue = FrameQueue()
    items = [frame(0, b"x"), EosEvent(), frame(1, b"xy")]
    for item in items:
        queue.append(item)
    assert (queue.buffers, queue.bytes) == (2, 3)
    assert [queue.popleft() for _ in items] == items
    assert (queue.buffers, queue.bytes) == (0, 0)
    with pytest.raises(IndexError):
        queue.popleft()


def test_time_is_the_running_time_held() -> None:
    """A segment in between moves the timestamps that follow it, at either end when it passes there."""
    queue = FrameQueue()
    queue.append(frame(0, pts=25 * SECOND, duration=SECOND))
    queue.append(SegmentEvent(Segment(100 * SECOND, None, 26 * SECOND)))
    queue.append(frame(1, pts=100 * SECOND, duration=SECOND))
    assert queue.time_ns == 2 * SECOND
    queue.popleft()
    assert queue.time_ns == SECOND
    queue.popleft()
    assert queue.time_ns == SECOND
    queue.popleft()
    assert queue.time_ns == 0
    assert queue.highest_time_ns == 2 * SECOND


sizes = st.lists(st.integers(0, 50), max_size=30)


@given(sizes, st.integers(0, 5), st.integers(0, 100))
def test_a_queue_that_drops_its_oldest_stays_below_its_limits(
    data: list[int], max_buffers: int, max_bytes: int
) -> None:
    """Full is looked at before a frame is added; the oldest is dropped; every frame counts."""
    queue, dropped = FrameQueue(), 0
    queue.limits = max_buffers, max_bytes, 0
    for seq, size in enumerate(data):
        while queue.is_full() and queue.drop_oldest():
            dropped += 1
        queue.append(frame(seq, bytes(size)))
        assert max_buffers == 0 or queue.buffers <= max_buffers
        assert max_bytes == 0 or queue.bytes - size < max_bytes
    held = [queue.popleft() for _ in range(queue.buffers)]
    assert [item.seq for item in held if isinstance(item, Frame)] == list(range(dropped, len(data)))
    assert queue.bytes == 0


def test_dropping_frames_keeps_events() -> None:
    """A flush keeps the given events."""
    queue = FrameQueue()
    for item in (frame(0, b"x"), EosEvent(), frame(1)):
        queue.append(item)
    assert queue.drop_frames() == 2
    assert list(queue.items) == [EosEvent()]
    assert (queue.buffers, queue.bytes, queue.time_ns) == (0, 0, 0)
    assert queue.drop_oldest() is False
