"""funnel and concat, as behaviour.md tells."""

import threading
from typing import Any

import pytest

from streamkit import Caps, EndOfStream, Event, Frame, Pipeline, Sink
from streamkit.element.branching import Combine
from streamkit.element.pad import Pad
from streamkit.element.registry import make_element
from streamkit.flow.events import EOS, FLUSH_START, FLUSH_STOP, CapsEvent, GapEvent, Segment, SegmentEvent

A, B = Caps("a/b"), Caps("c/d")
SECOND = 1_000_000_000


class Outlet(Sink):
    """Notes what comes out."""

    sink = "ANY"

    def __init__(self) -> None:
        super().__init__("outlet")
        self.seen: list[Any] = []
        self.came = threading.Semaphore(0)

    def render(self, frame: Frame) -> None:
        """Notes the frame's number."""
        self.seen.append(frame.seq)
        self.came.release()

    def receive_event(self, pad: Pad, event: Event) -> None:
        """Notes the event."""
        self.seen.append(event)


class Joined:
    """A funnel or concat with some inputs."""

    def __init__(self, factory: str, inputs: int = 2, **properties: Any) -> None:
        element = make_element(factory, "f", **properties)
        assert isinstance(element, Combine)
        self.element = element
        self.outlet = Outlet()
        self.src = element.pads["src"]
        self.src.link(self.outlet.pads["sink"])
        self.src.push = self.outlet.render
        self.pads = [element.request_pad(element.pad_templates["sink_%u"]) for _ in range(inputs)]
        self.takes = [element.receiver(pad) for pad in self.pads]
        element.start()

    def push(self, which: int, number: int, caps: Caps = A, **fields: Any) -> None:
        """Pushes a frame into an input."""
        self.takes[which](Frame(b"", caps, seq=number, arrival_ns=1, **fields))

    def send(self, which: int, *events: Event) -> None:
        """Sends events into an input."""
        for event in events:
            self.pads[which].receive_event(event)

    @property
    def seen(self) -> list[Any]:
        """What came out, without caps."""
        return [item for item in self.outlet.seen if not isinstance(item, CapsEvent)]


def test_frames_come_out_as_they_arrive() -> None:
    """f-simple: one from each input, in order of arrival."""
    funnel = Joined("funnel")
    funnel.push(1, 10)
    funnel.push(0, 20)
    assert funnel.seen == [10, 20]


def test_eos_of_a_funnel() -> None:
    """f-eos: EOS after all inputs; a frame into one that ended is refused; a flush revives it."""
    funnel = Joined("funnel")
    funnel.send(0, EOS)
    funnel.push(1, 1)
    with pytest.raises(EndOfStream):
        funnel.push(0, 2)
    assert funnel.seen == [1]
    funnel.send(0, FLUSH_START, FLUSH_STOP)
    funnel.push(0, 3)
    funnel.send(0, EOS)
    assert EOS not in funnel.seen
    funnel.send(1, EOS)
    assert funnel.seen[-1] == EOS
    assert funnel.seen.count(EOS) == 1


def test_releasing_the_last_open_input_ends_the_stream() -> None:
    """f-eos: inputs that only ever got EOS count too."""
    funnel = Joined("funnel", 3)
    funnel.send(0, EOS)
    funnel.send(2, EOS)
    assert EOS not in funnel.seen
    funnel.element.release_pad(funnel.pads[1])
    assert funnel.seen == [EOS]


def test_an_input_brings_its_caps_and_segment() -> None:
    """f-sticky: on every change of input they go before the data; a gap counts as data."""
    funnel = Joined("funnel")
    segments = [SegmentEvent(Segment(start_ns=5 * SECOND)), SegmentEvent(Segment(start_ns=9 * SECOND))]
    for which in range(2):
        funnel.send(which, CapsEvent((A, B)[which]), segments[which])
    for _ in range(2):
        funnel.send(0, GapEvent(5 * SECOND))
        funnel.send(1, GapEvent(9 * SECOND))
    funnel.push(0, 1, A)
    funnel.push(1, 2, B)
    gaps = [GapEvent(5 * SECOND), GapEvent(9 * SECOND)]
    assert funnel.outlet.seen == [
        CapsEvent(A), segments[0], gaps[0], CapsEvent(B), segments[1], gaps[1],
        CapsEvent(A), segments[0], gaps[0], CapsEvent(B), segments[1], gaps[1],
        CapsEvent(A), segments[0], 1, CapsEvent(B), segments[1], 2,
    ]  # fmt: skip


def test_segments_may_be_left_out() -> None:
    """forward-sticky-events=false: no segment on a change of input."""
    funnel = Joined("funnel", forward_sticky_events=False)
    funnel.send(0, SegmentEvent(Segment(start_ns=5)))
    funnel.push(0, 1)
    funnel.push(1, 2)
    assert funnel.seen == [1, 2]


def test_inputs_come_while_others_push() -> None:
    """f-stress: two threads push while pads are asked for; every frame comes out."""
    funnel = Joined("funnel")

    def push(which: int) -> None:
        for number in range(2000):
            funnel.push(which, number)

    threads = [threading.Thread(target=push, args=(which,)) for which in range(2)]
    for thread in threads:
        thread.start()
    template = funnel.element.pad_templates["sink_%u"]
    for _ in range(200):
        funnel.element.release_pad(funnel.element.request_pad(template))
    for thread in threads:
        thread.join(20)
    assert len(funnel.seen) == 4000


def test_two_streams_into_one() -> None:
    """f-pipe: 3 and 5 frames make 8, and one EOS; inputs not named are called funnelpadN."""
    text = "funnel name=f ! fakesink name=s  fakesrc num-buffers=3 ! f.  fakesrc num-buffers=5 ! f."
    with Pipeline.parse(text) as pipeline:
        assert [pad.name for pad in pipeline["f"].sink_pads()] == ["funnelpad0", "funnelpad1"]
        pipeline.play()
        assert pipeline.wait(10) is not None
        assert pipeline.wait(0.0) is None
        assert pipeline["s"].count == 8


def test_one_stream_after_the_other() -> None:
    """f-concat: the second input waits for the end of the first; its segment lies behind it; one EOS."""
    concat = Joined("concat")
    element: Any = concat.element
    waiting = threading.Event()

    def second() -> None:
        waiting.set()
        concat.push(1, 10, pts=0, duration=SECOND)
        concat.send(1, EOS)

    thread = threading.Thread(target=second)
    thread.start()
    assert waiting.wait(10)
    assert element.active_pad == "sink_0"
    for number in range(3):
        concat.push(0, number, pts=number * SECOND, duration=SECOND)
    assert thread.is_alive()
    concat.send(0, EOS)
    thread.join(10)
    assert concat.seen == [0, 1, 2, SegmentEvent(Segment(base_ns=3 * SECOND)), 10, EOS]
    assert element.active_pad is None


def test_segments_may_stay_as_they_are() -> None:
    """f-concat: with adjust-base=false the second input's segment is its own."""
    concat = Joined("concat", adjust_base=False)
    concat.push(0, 0, pts=0, duration=SECOND)
    concat.send(0, EOS)
    concat.push(1, 1, pts=0)
    assert concat.seen == [0, 1]


def test_a_waiting_input_is_let_go() -> None:
    """f-concat: stopping wakes who waits for a turn."""
    text = "concat name=c ! fakesink  fakesrc ! c.  fakesrc num-buffers=3 ! c."
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        assert pipeline.wait(0.1) is None
