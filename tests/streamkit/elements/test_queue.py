"""queue: limits, leaking, events, errors and threads; the cases are GStreamer's."""

import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from streamkit import Caps, DiscontinuityEvent, ElementFailure, EndOfStream, Event, Frame, Pipeline, Sink
from streamkit.element.base import Element
from streamkit.element.pad import Pad
from streamkit.element.registry import make_element
from streamkit.elements.queue import Queue
from streamkit.flow.events import EOS, CapsEvent, EosEvent, Flushing
from streamkit.testing import Harness

Register = Callable[..., None]
ANYTHING = Caps("a/b")
SECOND = 1_000_000_000


def frame(seq: int = 0, data: bytes = b"", **fields: Any) -> Frame:
    """A frame of a few bytes."""
    return Frame(data, ANYTHING, seq=seq, arrival_ns=1, **fields)


def queue(**properties: Any) -> Queue:
    """A queue whose output is blocked: nothing takes from it."""
    element = make_element("queue", "q", **properties)
    assert isinstance(element, Queue)
    return element


class Notes(Sink):
    """Notes the events that reach it."""

    sink = "ANY"

    def __init__(self, name: str = "") -> None:
        super().__init__(name)
        self.seen: list[Event] = []

    def receive_event(self, pad: Pad, event: Event) -> None:
        """Notes it."""
        self.seen.append(event)


class Outlet:
    """Takes frames out as the thread downstream does; `events` went out before them."""

    def __init__(self, element: Queue) -> None:
        notes = Notes("notes")
        element.pads["src"].link(notes.pads["sink"])
        self.events = notes.seen
        self._element = element

    def take(self) -> Frame:
        """The next frame."""
        while not isinstance(item := self._element._take(), Frame):
            self._element.pads["src"].send_event(item)
            if isinstance(item, EosEvent):
                raise EndOfStream
        return item

    def numbers(self, count: int) -> list[int]:
        """The numbers of the next frames."""
        return [self.take().seq for _ in range(count)]


def fill(element: Queue, frames: list[Frame]) -> None:
    """Pushes frames that there is room for, in this thread."""
    take = element.receiver(element.pads["sink"])
    for item in frames:
        take(item)


class Pushing(threading.Thread):
    """Pushes one frame from another thread and keeps the result."""

    def __init__(self, element: Queue, item: Frame) -> None:
        super().__init__(name="pushing")
        self.take = element.receiver(element.pads["sink"])
        self.item = item
        self.outcome: BaseException | str = "blocked"
        self.start()

    def run(self) -> None:
        """Pushes."""
        try:
            self.take(self.item)
        except BaseException as error:
            self.outcome = error
        else:
            self.outcome = "taken"

    def ended(self) -> BaseException | str:
        """The outcome, once there is one."""
        self.join(10)
        return self.outcome


def check_blocked(element: Queue, item: Frame) -> Pushing:
    """A push that waits for room."""
    meets_full = threading.Event()
    element.on_overrun(lambda _: meets_full.set())
    pushing = Pushing(element, item)
    assert meets_full.wait(10)
    assert pushing.outcome == "blocked"
    return pushing


def unblock(element: Queue) -> None:
    """Stops the queue as a pipeline does."""
    element.stopping.set()
    element.interrupt()


def test_limits_are_gstreamers() -> None:
    """q-defaults: 200 frames, 10 MiB, 1 s, not leaky."""
    element = queue()
    assert (element.max_size_buffers, element.max_size_bytes, element.max_size_time) == (
        200,
        10_485_760,
        SECOND,
    )
    assert element.leaky.value == "no"


def test_a_full_queue_blocks_until_a_frame_leaves() -> None:
    """q-block: two go in, the third waits; order 0, 1, 2."""
    element = queue(max_size_buffers=2)
    fill(element, [frame(0), frame(1)])
    pushing = check_blocked(element, frame(2))
    outlet = Outlet(element)
    assert outlet.numbers(1) == [0]
    assert pushing.ended() == "taken"
    assert outlet.numbers(2) == [1, 2]


@pytest.mark.parametrize(
    ("leaky", "left", "reason"),
    [
        ("upstream", [0, 1, 2], "queue full, newest dropped"),
        ("downstream", [7, 8, 9], "queue full, oldest dropped"),
    ],
)
def test_a_leaky_queue_drops_and_counts(leaky: str, left: list[int], reason: str) -> None:
    """q-leak-up, q-leak-down: of ten frames the first or the last three stay; pushes never block."""
    element = queue(max_size_buffers=3, leaky=leaky)
    fill(element, [frame(n) for n in range(10)])
    assert Outlet(element).numbers(3) == left
    assert element.current_level_buffers == 0
    assert element.drops == {reason: 7}


def test_events_never_leak() -> None:
    """q-leak-events: caps stay before the first frame that has them."""
    element = queue(max_size_buffers=1, leaky="downstream")
    take = element.receiver(element.pads["sink"])
    other = Caps("c/d")
    take(frame(0))
    element.receive_event(element.pads["sink"], CapsEvent(other))
    take(frame(1).replace(caps=other))
    outlet = Outlet(element)
    assert outlet.numbers(1) == [1]
    assert outlet.events == [CapsEvent(other)]


def test_full_is_tested_before_adding() -> None:
    """q-full-rule: with a limit of 35 bytes four frames of 10 get in, the fifth waits."""
    element = queue(max_size_bytes=35, max_size_buffers=0, max_size_time=0)
    fill(element, [frame(n, b"x" * 10) for n in range(4)])
    assert element.current_level_bytes == 40
    pushing = check_blocked(element, frame(4, b"x" * 10))
    unblock(element)
    assert isinstance(pushing.ended(), Flushing)


def test_time_is_a_limit() -> None:
    """q-time-limit: with a limit of 3 s the fourth frame of 1 s waits."""
    element = queue(max_size_time=3 * SECOND, max_size_buffers=0, max_size_bytes=0)
    fill(element, [frame(n, pts=n * SECOND, duration=SECOND) for n in range(3)])
    assert element.current_level_time == 3 * SECOND
    pushing = check_blocked(element, frame(3, pts=3 * SECOND, duration=SECOND))
    unblock(element)
    assert isinstance(pushing.ended(), Flushing)


def test_level_of_time_with_missing_timestamps() -> None:
    """q-time-before-out: the level is the span of queued timestamps, not the time since 0."""
    element = queue(max_size_time=5 * SECOND)
    fill(element, [frame(0, pts=25 * SECOND, duration=SECOND), frame(1)])
    assert element.current_level_time == SECOND


def test_no_limit_is_no_limit() -> None:
    """0 switches each limit off."""
    element = queue(max_size_buffers=0, max_size_bytes=0, max_size_time=0)
    fill(element, [frame(n, b"x" * 1000, pts=n * SECOND) for n in range(1000)])
    assert element.current_level_buffers == 1000


def test_order_of_caps_and_frames_stays() -> None:
    """q-order: caps A, two frames, caps B, two frames come out like that."""
    other = Caps("c/d")
    element = queue()
    sink = element.pads["sink"]
    take = element.receiver(sink)
    put: list[Any] = [
        CapsEvent(ANYTHING), frame(0), frame(1), CapsEvent(other), DiscontinuityEvent(1), frame(2), EOS,
    ]  # fmt: skip
    for item in put:
        if isinstance(item, Frame):
            take(item)
        else:
            element.receive_event(sink, item)
    outlet = Outlet(element)
    order: list[Any] = []
    for _ in range(3):
        taken = outlet.take()
        order += [*outlet.events, taken]
        outlet.events.clear()
    assert order == put[:-1]
    with pytest.raises(EndOfStream):
        outlet.take()
    assert outlet.events == [EOS]


class Refuses(Sink):
    """Answers the first frame with a signal or an error."""

    sink = "ANY"
    answer: Exception = ValueError("disk full")
    asked: list[int]

    def start(self) -> None:
        self.asked = []

    def render(self, frame: Frame) -> None:
        self.asked.append(frame.seq)
        raise self.answer


@pytest.mark.parametrize(
    ("answer", "later"),
    [(ValueError("bad"), EndOfStream), (EndOfStream("s"), EndOfStream), (Flushing("s"), Flushing)],
)
def test_the_reason_of_downstream_is_raised_at_every_later_push(
    answer: Exception, later: type[Exception]
) -> None:
    """q-err-up, q-err-flush: queued frames are dropped."""
    element, sink = queue(), Refuses("s")
    sink.answer = answer
    element.pads["src"].link(sink.pads["sink"])
    element.pads["src"].push = sink.render
    sink.start()
    fill(element, [frame(0), frame(1)])
    if isinstance(answer, EndOfStream):
        element.stream()
    else:
        with pytest.raises(type(answer)):
            element.stream()
    assert sink.asked == [0]
    assert element.current_level_buffers == 0
    assert element.drops == {"downstream has ended": 1}
    with pytest.raises(later):
        fill(element, [frame(2)])


@pytest.mark.parametrize("begins", [True, False])
def test_no_event_is_lost_at_the_edges_of_a_flush(monkeypatch: pytest.MonkeyPatch, begins: bool) -> None:
    """Caps that arrive between two steps of the flush are those of the frames that follow."""
    element = queue()
    if not begins:
        element.flush(begins=True)
    flush = Element.flush
    caps = CapsEvent(ANYTHING)

    def overtaken(self: Element, *, begins: bool) -> None:
        element.receive_event(element.pads["sink"], caps)
        flush(self, begins=begins)
        element.receive_event(element.pads["sink"], caps)

    monkeypatch.setattr(Element, "flush", overtaken)
    element.flush(begins=begins)
    assert list(element.pending.items) == [caps, caps]


def test_a_blocked_push_is_woken_when_downstream_ends() -> None:
    """The reason is raised."""
    element = queue(max_size_buffers=1)
    fill(element, [frame(0)])
    pushing = check_blocked(element, frame(1))
    element._refuse(EndOfStream)
    assert isinstance(pushing.ended(), EndOfStream)


def test_downstream_runs_in_another_thread(register: Register) -> None:
    """The boundary is real, and the element that fails behind it is named."""
    names: list[str] = []

    class Notes(Sink):
        """Notes its thread."""

        sink = "ANY"

        def render(self, frame: Frame) -> None:
            names.append(threading.current_thread().name)
            raise ValueError("bad")

    register(notes=Notes)
    with pytest.raises(ElementFailure, match=r"^notes0: ValueError: bad"):
        Pipeline.parse("fakesrc ! queue name=q ! notes").run(timeout_s=10)
    assert names == ["streamkit:q"]


def test_a_frame_that_waits_for_room_is_counted_at_a_stop() -> None:
    """Each frame that came is sent on, or dropped for a reason."""
    text = "fakesrc ! queue name=q max-size-buffers=2 ! appsink name=out max-buffers=1"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        assert pipeline["out"].pull() is not None
        while pipeline["q"].current_level_buffers < 2:
            time.sleep(0.001)
    row = next(row for row in pipeline.statistics() if row.element == "q")
    assert row.frames_in == row.frames_out + row.dropped["pipeline stopped"]


def test_a_queue_is_empty_after_a_stop() -> None:
    """fs-reuse: three rounds of ten frames, none left over from one that was cut short, but counted."""
    pipeline = Pipeline.parse("fakesrc num-buffers=10 ! queue name=q ! appsink name=out max-buffers=1")
    with pipeline:
        pipeline.play()
        assert pipeline["out"].pull() is not None
    rows = {row.element: row for row in pipeline.statistics()}
    assert rows["q"].frames_in == rows["q"].frames_out + rows["q"].total_dropped
    assert pipeline["q"].current_level_buffers == 0
    for _ in range(3):
        with pipeline:
            pipeline.play()
            assert [item.seq for item in pipeline["out"]] == list(range(10))


def test_limits_may_change_while_playing() -> None:
    """They are live properties; no frame is lost by it."""
    with Pipeline.parse(
        "fakesrc ! queue name=q max-size-buffers=1 ! appsink name=out max-buffers=1"
    ) as pipeline:
        pipeline.play()
        pipeline["q"].set_property("max-size-buffers", 50)
        frames: Iterator[Frame] = iter(pipeline["out"])
        assert [next(frames).seq for _ in range(2)] == [0, 1]


def test_raised_limits_wake_a_waiting_push() -> None:
    """It continues as soon as there is room."""
    element = queue(max_size_buffers=1)
    fill(element, [frame(0)])
    pushing = check_blocked(element, frame(1))
    element.set_property("max-size-buffers", 5)
    assert pushing.ended() == "taken"


@pytest.mark.parametrize("data", [b"12345678", bytearray(8), memoryview(b"12345678")])
def test_bytes_are_those_of_the_data(data: Any) -> None:
    """Whatever holds the bytes."""
    element = queue()
    fill(element, [frame(0, data)])
    assert element.current_level_bytes == 8


def test_a_harness_can_run_a_queue() -> None:
    """Frames stay in it; nothing hangs at the end."""
    with Harness("queue") as harness:
        assert harness.push(frame(0)) == []
        assert harness.element.current_level_buffers == 1  # type: ignore[attr-defined]


def test_every_frame_that_a_flush_drops_is_counted() -> None:
    """Those in the queue, that in its thread's hand, and those that appsink holds."""
    with Pipeline.parse(
        "fakesrc num-buffers=40 ! queue name=q max-size-buffers=3 ! appsink name=out max-buffers=1"
    ) as pipeline:
        pipeline.play()
        while pipeline["q"].current_level_buffers < 3 or pipeline.statistics()[-1].frames_in < 2:
            time.sleep(0.001)
        pipeline.flush()
        received = len(list(pipeline["out"]))
        lost = sum(row.total_dropped for row in pipeline.statistics())
    assert lost >= 5
    assert received + lost == 40


def test_a_queue_that_is_linked_to_nothing_is_an_error() -> None:
    """Also where its source has sent all before: no later push raises it."""
    with pytest.raises(ElementFailure, match=r"^queue0: pad queue0.src is not linked; link it to a sink$"):
        Pipeline.parse("fakesrc num-buffers=1 ! queue").run(timeout_s=10)
