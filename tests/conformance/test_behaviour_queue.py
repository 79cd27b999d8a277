"""queue, as behaviour.md tells. "Output blocked" is a queue whose thread does not run."""

import threading
from collections.abc import Callable
from typing import Any

import pytest

from streamkit import Caps, EndOfStream, Event, Frame, Pipeline, Sink
from streamkit.element.pad import Pad
from streamkit.element.registry import make_element
from streamkit.elements.queue import Queue
from streamkit.errors import ElementFailure
from streamkit.flow.events import (
    EOS,
    FLUSH_START,
    FLUSH_STOP,
    CapsEvent,
    EosEvent,
    FlowStop,
    Flushing,
    NotLinked,
    Segment,
    SegmentEvent,
)

Register = Callable[..., None]
SECOND = 1_000_000_000
A, B = Caps("a/b"), Caps("c/d")


class Outlet(Sink):
    """Notes what comes out; answers each frame with an exception where one is set."""

    sink = "ANY"

    def __init__(self, answer: Exception | None = None) -> None:
        super().__init__("outlet")
        self.seen: list[Any] = []
        self.answer = answer
        self.frame_came = threading.Semaphore(0)

    def render(self, frame: Frame) -> None:
        """Notes the frame's number."""
        self.seen.append(frame.seq)
        self.frame_came.release()
        if self.answer is not None:
            raise self.answer

    def receive_event(self, pad: Pad, event: Event) -> None:
        """Notes the event."""
        self.seen.append(event)
        self.frame_came.release()

    @property
    def numbers(self) -> list[int]:
        """Frames only."""
        return [item for item in self.seen if isinstance(item, int)]


class Line:
    """A queue between a pusher and an outlet."""

    def __init__(self, answer: Exception | None = None, *, linked: bool = True, **properties: Any) -> None:
        element = make_element("queue", "q", **properties)
        assert isinstance(element, Queue)
        self.queue = element
        self.outlet = Outlet(answer)
        self.overruns = self.underruns = 0
        element.on_overrun(self._overrun)
        element.on_underrun(self._underrun)
        self.is_full = threading.Event()
        if linked:
            element.pads["src"].link(self.outlet.pads["sink"])
            element.pads["src"].push = self.outlet.render
        self.sink = element.pads["sink"]
        self.put = element.receiver(self.sink)
        self.error: BaseException | None = None
        element.begin_run()
        self.thread = threading.Thread(target=self._stream)

    def _overrun(self, queue: Queue) -> None:
        self.overruns += 1
        self.is_full.set()

    def _underrun(self, queue: Queue) -> None:
        self.underruns += 1

    def _stream(self) -> None:
        try:
            self.queue.stream()
        except (FlowStop, Exception) as error:
            self.error = error

    def push(self, *numbers: int, **fields: Any) -> None:
        """Pushes frames with these numbers."""
        data = fields.pop("data", b"")
        for number in numbers:
            self.put(Frame(data, A, seq=number, arrival_ns=1, **fields))

    def send(self, *events: Event) -> None:
        """Sends events."""
        for event in events:
            self.sink.receive_event(event)

    def push_blocked(self, number: int, **fields: Any) -> threading.Thread:
        """Pushes a frame from a thread that has to wait for room."""
        self.is_full.clear()
        pushing = threading.Thread(target=self._push_to_the_end, args=(number,), kwargs=fields)
        pushing.start()
        assert self.is_full.wait(10)
        assert pushing.is_alive()
        return pushing

    def _push_to_the_end(self, number: int, **fields: Any) -> None:
        try:
            self.push(number, **fields)
        except FlowStop as stop:
            self.error = stop

    def drain(self) -> list[int]:
        """Opens the output, ends the stream; the frames that came out."""
        self.send(EOS)
        self.thread.start()
        self.thread.join(10)
        assert not self.thread.is_alive()
        return self.outlet.numbers

    def stop(self) -> None:
        """Stops as a pipeline does."""
        self.queue.stopping.set()
        self.queue.halt()
        self.queue.interrupt()
        if self.thread.ident is not None:
            self.thread.join(10)

    @property
    def levels(self) -> tuple[int, int, int]:
        """Frames, bytes and time held."""
        element = self.queue
        return element.current_level_buffers, element.current_level_bytes, element.current_level_time


NONE: dict[str, Any] = {"max_size_buffers": 0, "max_size_bytes": 0, "max_size_time": 0}


def test_defaults() -> None:
    """q-defaults: 200 frames, 10 485 760 bytes, 1 s; 0 switches a limit off; nothing else is set."""
    element = Queue()
    assert (element.max_size_buffers, element.max_size_bytes, element.max_size_time) == (
        200,
        10485760,
        SECOND,
    )
    assert (element.leaky.value, element.flush_on_eos, element.silent) == ("no", False, False)
    thresholds = (element.min_threshold_buffers, element.min_threshold_bytes, element.min_threshold_time)
    assert thresholds == (0, 0, 0)
    line = Line(**NONE)
    line.push(*range(1000), data=bytes(100_000))
    assert line.drain() == list(range(1000))


def test_an_empty_queue_underruns_once() -> None:
    """q-underrun: started with nothing in it: one underrun, no overrun."""
    line = Line(max_size_buffers=2)
    empty = threading.Event()
    line.queue.on_underrun(lambda _: empty.set())
    line.thread.start()
    assert empty.wait(10)
    line.stop()
    assert (line.underruns, line.overruns) == (1, 0)


def test_a_full_queue_blocks() -> None:
    """q-block: the third push overruns once and waits until a frame leaves; order 1, 2, 3."""
    line = Line(max_size_buffers=2)
    line.push(1, 2)
    pushing = line.push_blocked(3)
    line.thread.start()
    pushing.join(10)
    assert not pushing.is_alive()
    line.send(EOS)
    line.thread.join(10)
    assert line.outlet.numbers == [1, 2, 3]
    assert line.overruns == 1


@pytest.mark.parametrize(("limit", "count"), [(2, 3), (3, 10)])
def test_leaking_upstream(limit: int, count: int) -> None:
    """q-leak-up: the new frame is dropped, pushes return, each overruns; the first ones come out."""
    line = Line(max_size_buffers=limit, leaky="upstream")
    line.push(*range(count))
    assert line.overruns == count - limit
    assert line.drain() == list(range(limit))


@pytest.mark.parametrize(("limit", "count"), [(2, 3), (3, 10)])
def test_leaking_downstream(limit: int, count: int) -> None:
    """q-leak-down: the oldest frame is dropped, pushes return, each overruns; the last ones come out."""
    line = Line(max_size_buffers=limit, leaky="downstream")
    line.push(*range(count))
    assert line.overruns == count - limit
    assert line.drain() == list(range(count - limit, count))


def test_events_do_not_leak() -> None:
    """q-leak-events: the latest caps and segment come before the first frame that is left."""
    line = Line(max_size_buffers=1, leaky="downstream")
    segment = SegmentEvent(Segment(5))
    line.send(CapsEvent(A), SegmentEvent(Segment()))
    line.push(1)
    line.send(CapsEvent(B), segment)
    line.push(2)
    line.drain()
    before = line.outlet.seen[: line.outlet.seen.index(2)]
    assert [event for event in before if isinstance(event, CapsEvent)][-1] == CapsEvent(B)
    assert before[-1] == segment
    assert line.outlet.numbers == [2]


def test_full_is_tested_before_adding() -> None:
    """q-full-rule: of 10 bytes each, with a limit of 35, four get in; one limit is enough."""
    line = Line(max_size_bytes=35, max_size_buffers=0, max_size_time=0)
    for number in range(4):
        line.push(number, data=bytes(10))
    assert line.levels[:2] == (4, 40)
    pushing = line.push_blocked(4, data=bytes(10))
    line.thread.start()
    pushing.join(10)
    line.send(EOS)
    line.thread.join(10)
    assert line.outlet.numbers == [0, 1, 2, 3, 4]


def test_a_limit_of_time() -> None:
    """q-time-limit: with 3 s of frames of 1 s the fourth waits."""
    line = Line(**{**NONE, "max_size_time": 3 * SECOND})
    for number in range(3):
        line.push(number, pts=number * SECOND, duration=SECOND)
    assert line.levels[2] == 3 * SECOND
    pushing = line.push_blocked(3, pts=3 * SECOND, duration=SECOND)
    line.stop()
    pushing.join(10)
    assert isinstance(line.error, Flushing)


STAMPS = [(1, None, 0), (2, None, 1), (3, 1, 3), (5, 1, 5), (5, 1, 5), (7, None, 6)]


def test_the_level_of_time() -> None:
    """q-time-level: 0, 1, 3, 5, 5, 6 s after frames at 1, 2, 3, 5, 5, 7 s, three of them 1 s long."""
    line = Line(**NONE)
    for pts, duration, level in STAMPS:
        line.push(0, pts=pts * SECOND, duration=duration and duration * SECOND)
        assert line.levels[2] == level * SECOND
    assert line.queue.pending.highest_time_ns == 6 * SECOND


def test_segments_alone_hold_no_time() -> None:
    """q-time-level-seg: the same start with another base, no frame: still 0."""
    line = Line()
    line.send(SegmentEvent(Segment(SECOND)), SegmentEvent(Segment(SECOND, None, 5 * SECOND)))
    assert line.levels == (0, 0, 0)


def test_time_before_anything_went_out() -> None:
    """q-time-before-out: a frame at 25 s for 1 s is 1 s; one without a timestamp changes nothing."""
    line = Line(max_size_time=5 * SECOND, leaky="downstream")
    line.push(0, pts=25 * SECOND, duration=SECOND)
    assert line.levels[2] == SECOND
    line.push(1)
    assert line.levels[2] == SECOND
    assert line.overruns == 0


def test_a_threshold_holds_frames_back() -> None:
    """q-min-threshold: nothing before the third, then one for each push; EOS lets go of the rest."""
    line = Line(min_threshold_buffers=3)
    line.thread.start()
    line.push(0, 1)
    assert not line.outlet.frame_came.acquire(timeout=0.05)
    for number in range(2, 6):
        line.push(number)
        assert line.outlet.frame_came.acquire(timeout=10)
        assert line.outlet.numbers == list(range(number - 1))
    line.send(EOS)
    line.thread.join(10)
    assert line.outlet.numbers == list(range(6))


def test_eos_overcomes_a_threshold() -> None:
    """q-min-threshold-eos: one frame of three, then EOS: both come out."""
    line = Line(min_threshold_buffers=3)
    line.push(0)
    assert line.drain() == [0]
    assert isinstance(line.outlet.seen[-1], EosEvent)


def test_a_full_queue_overcomes_a_threshold() -> None:
    """q-min-threshold: a limit below the threshold does not block for ever."""
    line = Line(min_threshold_buffers=10, max_size_buffers=2)
    line.thread.start()
    line.push(*range(5))
    line.send(EOS)
    line.thread.join(10)
    assert line.outlet.numbers == list(range(5))


def test_an_event_at_the_tail_overcomes_a_threshold() -> None:
    """q-query-threshold: what travels with the frames is never held back behind a threshold."""
    line = Line(min_threshold_buffers=10)
    line.thread.start()
    line.push(0)
    line.send(SegmentEvent(Segment(5)))
    for _ in range(2):
        assert line.outlet.frame_came.acquire(timeout=10)
    assert line.outlet.seen == [0, SegmentEvent(Segment(5))]
    line.stop()


def test_events_wait_for_the_frames_before_them() -> None:
    """q-query-inband: what travels in order comes out behind the frame before it."""
    line = Line()
    line.push(0)
    line.send(SegmentEvent(Segment(5)))
    assert line.outlet.seen == []
    line.drain()
    assert line.outlet.seen == [0, SegmentEvent(Segment(5)), EOS]


def test_flushing_while_events_wait() -> None:
    """q-query-flush: 500 rounds of events, a flush and a stop: nobody waits for ever."""
    for _ in range(500):
        line = Line()
        line.thread.start()
        line.send(SegmentEvent(Segment(5)), FLUSH_START)
        line.stop()
        assert not line.thread.is_alive()


def test_a_flush_drops_what_is_held() -> None:
    """q-flush: pushes are refused during it; then levels are 0, caps are sent again, new frames pass."""
    line = Line()
    line.send(CapsEvent(A))
    line.push(0, 1, 2, 3)
    line.send(FLUSH_START)
    with pytest.raises(Flushing):
        line.push(4)
    line.send(FLUSH_STOP)
    assert line.levels == (0, 0, 0)
    line.push(5)
    assert line.drain() == [5]
    assert line.outlet.seen[:3] == [FLUSH_START, FLUSH_STOP, CapsEvent(A)]


def test_a_flush_overtakes_a_blocked_push() -> None:
    """q-flush: who waits for room is refused at once; the thread goes on afterwards."""
    line = Line(max_size_buffers=1)
    line.push(0)
    pushing = line.push_blocked(1)
    line.send(FLUSH_START)
    pushing.join(10)
    assert isinstance(line.error, Flushing)
    line.thread.start()
    line.send(FLUSH_STOP)
    line.push(2)
    line.send(EOS)
    line.thread.join(10)
    assert line.outlet.numbers == [2]


def test_a_flush_while_stopping() -> None:
    """q-flush-state: a flush that ends while the pipeline stops: both come to an end."""
    for _ in range(50):
        line = Line()
        line.thread.start()
        line.send(FLUSH_START)
        stopping = threading.Thread(target=line.stop)
        stopping.start()
        line.send(FLUSH_STOP)
        stopping.join(10)
        assert not stopping.is_alive()
        assert not line.thread.is_alive()


@pytest.mark.parametrize(("flush", "left"), [(True, []), (False, [0, 1, 2, 3, 4, 5])])
def test_eos_may_drop_what_is_held(flush: bool, left: list[int]) -> None:
    """q-flush-eos: with it the level drops to 0 and EOS is next, else all six come first."""
    line = Line(flush_on_eos=flush)
    line.push(*range(6))
    line.send(EOS)
    assert line.levels[0] == len(left)
    line.thread.start()
    line.thread.join(10)
    assert line.outlet.seen == [*left, EOS]
    assert sum(line.queue.drops.values()) == 6 - len(left)


@pytest.mark.parametrize(
    ("answer", "later"),
    [
        (ValueError("disk full"), EndOfStream),
        (NotLinked("x"), NotLinked),
        (Flushing("x"), Flushing),
        (EndOfStream("x"), EndOfStream),
    ],
)
def test_what_downstream_answers_meets_later_pushes(answer: Exception, later: type[Exception]) -> None:
    """q-err-up: the push itself had returned; every later one is refused, and nothing more goes out.

    An error goes upstream as the end of the stream: it stands on the bus already.
    """
    line = Line(answer)
    line.push(0, 1)
    line.thread.start()
    line.thread.join(10)
    for _ in range(3):
        with pytest.raises(later):
            line.push(2)
    assert line.outlet.numbers == [0]


def test_an_error_lets_go_of_what_is_held() -> None:
    """q-err-flush: frames held are dropped when downstream fails."""
    line = Line(ValueError("disk full"))
    line.push(*range(50), data=bytes(1000))
    line.thread.start()
    line.thread.join(10)
    assert line.levels == (0, 0, 0)
    assert not line.queue.pending.items


def test_an_output_that_is_not_linked() -> None:
    """q-notlinked-event: after the refusal an event is taken, and a frame is refused the same way."""
    line = Line(linked=False)
    line.push(0)
    line.thread.start()
    line.thread.join(10)
    with pytest.raises(NotLinked):
        line.push(1)
    line.send(SegmentEvent(Segment(5)))
    with pytest.raises(NotLinked):
        line.push(2)
    assert line.error is None


def test_events_come_out_at_once() -> None:
    """q-events-now: caps and segment, no frame: both come out, in order."""
    line = Line()
    line.thread.start()
    line.send(CapsEvent(A), SegmentEvent(Segment(5)))
    for _ in range(2):
        assert line.outlet.frame_came.acquire(timeout=10)
    assert line.outlet.seen == [CapsEvent(A), SegmentEvent(Segment(5))]
    line.stop()


def test_order() -> None:
    """q-order: caps A, two frames, caps B, two frames."""
    line = Line()
    line.send(CapsEvent(A))
    line.push(0, 1)
    line.send(CapsEvent(B))
    line.push(2, 3)
    line.drain()
    assert line.outlet.seen == [CapsEvent(A), 0, 1, CapsEvent(B), 2, 3, EOS]


def test_caps_refused_behind_a_threshold(register: Register) -> None:
    """q-nego-error: an element behind the queue refuses the caps after EOS was queued: an error, no hang."""

    class Picky(Sink):
        """Refuses the caps that come."""

        sink = "ANY"

        def configure(self, sink_caps: Caps) -> None:
            """Refuses."""
            raise ValueError("not these")

        def render(self, frame: Frame) -> None:
            """Takes nothing."""

    register(picky=Picky)
    text = "fakesrc num-buffers=1 ! a/b ! queue min-threshold-buffers=2 ! picky"
    with pytest.raises(ElementFailure, match="not these"):
        Pipeline.parse(text).run(timeout_s=10)


def test_latency_of_a_queue() -> None:
    """lat-query: the threshold is waited for, the limit is what it can hold."""
    assert Queue(min_threshold_time=5, max_size_time=7).latency() == (5, 7)
    assert Queue(max_size_time=0).latency() == (0, None)
