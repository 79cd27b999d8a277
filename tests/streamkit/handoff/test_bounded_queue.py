"""BoundedQueue: order, bounds, waits and counted losses."""

import threading
from collections.abc import Callable, Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from streamkit.handoff.bounded_queue import BoundedQueue


def in_thread(work: Callable[[], object]) -> tuple[threading.Thread, list[object]]:
    """Runs work in another thread; the list gets its result."""
    results: list[object] = []
    thread = threading.Thread(target=lambda: results.append(work()))
    thread.start()
    return thread, results


@given(
    st.lists(st.tuples(st.integers(0, 9), st.booleans()), max_size=60), st.integers(0, 4), st.integers(0, 20)
)
def test_every_item_is_taken_held_or_dropped(
    steps: list[tuple[int, bool]], capacity: int, limit: int
) -> None:
    """Order, bounds and counts hold for any sequence of calls."""
    queue: BoundedQueue[int] = BoundedQueue(capacity, limit)
    taken: list[int] = []
    for number, (size, takes) in enumerate(steps):
        queue.put(number, size)
        assert capacity == 0 or len(queue) <= capacity
        assert limit == 0 or len(queue) == 1 or queue.bytes <= limit
        if takes:
            item = queue.get()
            assert item is not None
            taken.append(item)
    assert taken == sorted(taken)
    assert len(steps) == len(taken) + queue.dropped + len(queue)


def test_a_full_queue_drops_the_chosen_items() -> None:
    """Also the new item."""

    def choose_dropped(held: Sequence[str], new: str, is_full: bool) -> range:
        words = [*held, new]
        return range(words.index("chatter"), words.index("chatter") + 1) if is_full else range(0)

    queue: BoundedQueue[str] = BoundedQueue(2, choose_dropped=choose_dropped)
    assert [queue.put(word) for word in ("error", "chatter", "last", "chatter")] == [0, 0, 1, 1]
    assert [queue.get(), queue.get(), queue.get()] == ["error", "last", None]
    assert (len(queue), queue.bytes, queue.dropped) == (0, 0, 2)


def test_the_oldest_make_room_where_too_little_was_chosen() -> None:
    """The bound holds whatever `choose_dropped` returns."""
    queue: BoundedQueue[int] = BoundedQueue(max_bytes=10, choose_dropped=lambda *_: range(0))
    assert [queue.put(number, 5) for number in range(3)] == [0, 0, 1]
    assert [queue.get(), queue.get(), queue.get()] == [1, 2, None]


def test_a_full_queue_waits_for_room() -> None:
    """As long as is asked; what is taken meanwhile makes room."""
    queue: BoundedQueue[int] = BoundedQueue(1)
    queue.put(0)
    thread, dropped = in_thread(lambda: queue.put(1, wait_s=None))
    assert queue.get(10) == 0
    thread.join(10)
    assert dropped == [0]
    assert queue.get() == 1


def test_waits_end_when_cancelled_or_closed() -> None:
    """Of `put` and `get`."""
    queue: BoundedQueue[int] = BoundedQueue(1)
    cancelled = threading.Event()
    thread, results = in_thread(lambda: queue.get(None, cancelled))
    cancelled.set()
    queue.wake()
    thread.join(10)
    queue.put(0)
    putting, dropped = in_thread(lambda: queue.put(1, wait_s=None))
    assert queue.close() == 1
    putting.join(10)
    assert (results, dropped, queue.get()) == ([None], [0], None)


def test_the_end_follows_the_last_item() -> None:
    """With its error, if there is one; `reopen` takes it back."""
    queue: BoundedQueue[int] = BoundedQueue()
    queue.put(0)
    queue.end(OSError("lens cap on"))
    assert not queue.is_over
    assert queue.get(None) == 0
    assert queue.is_over
    with pytest.raises(OSError, match="lens cap on"):
        queue.get(None)
    queue.reopen()
    assert queue.get(0.0) is None


def test_a_closed_queue_stays_closed() -> None:
    """A reader does not wait after another thread has reopened it."""
    queue: BoundedQueue[int] = BoundedQueue()
    queue.close()
    queue.reopen()
    assert queue.is_over
