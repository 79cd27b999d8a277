"""appsink and appsrc, as behaviour.md tells."""

import contextlib
import threading
from collections.abc import Callable
from typing import Any

import pytest

from streamkit import Caps, Frame, FrameFlags, Pipeline, Sink
from streamkit.elements.appsink import AppSink
from streamkit.elements.appsrc import AppSrc
from streamkit.errors import StateError
from streamkit.flow.events import CapsEvent, GapEvent, Segment, SegmentEvent
from streamkit.testing import ManualClock

Register = Callable[..., None]
A, B = Caps("a/b"), Caps("c/d")
MS = 1_000_000
SECOND = 1000 * MS


def frame(number: int = 0, data: bytes = b"", **fields: Any) -> Frame:
    """A frame."""
    return Frame(data, fields.pop("caps", A), seq=number, arrival_ns=1, **fields)


def lined_up(**properties: Any) -> AppSink:
    """A started appsink, fed by hand."""
    sink = AppSink("out", **properties)
    sink.start()
    sink.is_playing = True
    return sink


def test_frames_can_be_pulled() -> None:
    """ask-plain: what comes in is what is pulled."""
    sink = lined_up()
    item = frame(1)
    sink.render(item)
    assert sink.pull() is item


def test_a_callback_for_each_frame() -> None:
    """ask-callback: with emit-signals, in the streaming thread; else not."""
    for wanted in (True, False):
        sink = lined_up(emit_signals=wanted)
        pulled: list[int] = []
        sink.on_new_sample(lambda element, into=pulled: into.append(element.pull().seq))
        sink.render(frame(7))
        assert pulled == ([7] if wanted else [])


def test_waiting_for_a_frame() -> None:
    """ask-pull: an empty sink gives None after the time, or raises where a frame is demanded."""
    sink = lined_up()
    assert sink.try_pull(0.0) is None
    assert sink.try_pull(0.02) is None
    with pytest.raises(StateError, match=r"^out: no frame has come within 0.02 s"):
        sink.pull(0.02)
    sink.render(frame(1))
    assert sink.try_pull(0.0) is not None


def test_the_preroll_frame_comes_again() -> None:
    """ask-preroll: once as preroll, no sample while paused, then as the first sample."""
    with Pipeline.parse("fakesrc num-buffers=3 ! appsink name=out emit-signals=true") as pipeline:
        out = pipeline["out"]
        prerolls: list[Any] = []
        out.on_new_preroll(prerolls.append)
        pipeline.pause()
        first = out.pull_preroll()
        assert first.seq == 0
        assert out.pull_preroll(0.0) is None
        assert out.try_pull(0.0) is None
        pipeline.play()
        assert out.pull() is first
        assert [item.seq for item in out] == [1, 2]
        assert prerolls == [out]


def test_pulling_the_sample_empties_the_preroll() -> None:
    """ask-noprerol: who does not care for it need not."""
    with Pipeline.parse("fakesrc num-buffers=1 ! appsink name=out") as pipeline:
        pipeline.pause()
        assert pipeline.wait_prerolled(10)
        pipeline.play()
        assert pipeline["out"].pull().seq == 0
        assert pipeline["out"].pull_preroll(0.0) is None


def test_events_come_between_the_frames() -> None:
    """ask-events: frame, event, frame, in order."""
    sink = lined_up()
    gap = GapEvent(5)
    sink.render(frame(1))
    sink.pads["sink"].receive_event(gap)
    sink.render(frame(2))
    objects = [sink.pull_object(0.0) for _ in range(4)]
    assert [item.seq if isinstance(item, Frame) else item for item in objects] == [1, gap, 2, None]


def test_events_come_before_any_frame() -> None:
    """ask-events-paused: caps and segment can be pulled in PAUSED."""
    with Pipeline.parse("appsrc name=in ! appsink name=out") as pipeline:
        pipeline["in"].push(frame(pts=2 * SECOND))
        pipeline.pause()
        assert pipeline.wait_prerolled(10)
        objects = [pipeline["out"].pull_object(1.0) for _ in range(2)]
    assert objects == [CapsEvent(A), SegmentEvent(Segment(2 * SECOND))]


def test_the_segment_reaches_the_sink() -> None:
    """ask-segment: preroll and frame lie in the segment that came before them."""
    with Pipeline.parse("appsrc name=in ! appsink name=out") as pipeline:
        pipeline["in"].push(frame(pts=2 * SECOND))
        pipeline.pause()
        assert pipeline["out"].pull_preroll().pts == 2 * SECOND
        assert pipeline["out"].pads["sink"].segment == Segment(2 * SECOND)


@pytest.mark.parametrize(
    ("limits", "left"),
    [({}, 3), ({"max_time": 50 * MS}, 3), ({"max_buffers": 2}, 2), ({"max_bytes": 8}, 2),
     ({"max_buffers": 1}, 1), ({"max_time": 20 * MS}, 1)],
)  # fmt: skip
def test_limits(limits: dict[str, int], left: int) -> None:
    """ask-limits: of three frames of 20 ms and 4 bytes, with drop, so many are kept."""
    sink = lined_up(**{"max_buffers": 0, **limits}, drop=True)
    for number in range(3):
        sink.render(frame(number, b"1234", pts=number * 20 * MS, duration=20 * MS))
    assert sink.current_level_buffers == left


def test_the_oldest_are_dropped() -> None:
    """ask-drop: of ten the last two are left; they are counted."""
    sink = lined_up(max_buffers=2, drop=True)
    for number in range(10):
        sink.render(frame(number))
    assert [sink.pull().seq for _ in range(2)] == [8, 9]  # type: ignore[union-attr]
    assert sink.drops == {"appsink full, oldest dropped": 8}


def test_a_full_sink_blocks() -> None:
    """ask-drop: without drop nothing is lost, and EOS comes when the sink has taken every frame."""
    with Pipeline.parse("fakesrc num-buffers=10 ! appsink name=out max-buffers=2") as pipeline:
        pipeline.play()
        assert pipeline.wait(0.05) is None
        assert [item.seq for item in pipeline["out"]] == list(range(10))
        assert pipeline.wait(10) is not None


def test_after_eos() -> None:
    """ask-eos: two frames, then None at once for ever; eos is true; also when stopped."""
    sink = AppSink("out")
    assert sink.eos
    with Pipeline.parse("fakesrc num-buffers=2 ! appsink name=out") as pipeline:
        pipeline.play()
        out = pipeline["out"]
        assert [out.pull() is None for _ in range(4)] == [False, False, True, True]
        assert out.eos
    assert pipeline["out"].try_pull(60.0) is None


class Line:
    """An appsrc whose output is blocked: nothing takes from it."""

    def __init__(self, **properties: Any) -> None:
        self.element = AppSrc("in", **properties)
        self.element.is_playing = True

    def push(self, count: int, data: bytes = b"", **fields: Any) -> None:
        """Pushes frames."""
        for number in range(count):
            self.element.push(frame(number, data, **fields))

    def taken(self) -> list[Frame]:
        """What is in the line."""
        self.element.end()
        return [item for item in self.element.frames() if isinstance(item, Frame)]


def pulled(pipeline: Pipeline) -> list[Frame]:
    """Frames of the sink `out` until EOS."""
    return list(pipeline["out"])


def test_caps_of_the_property() -> None:
    """asr-caps: one caps event before the first of four frames."""
    with Pipeline.parse("appsrc name=in caps=a/b ! appsink name=out") as pipeline:
        pipeline.play()
        for _ in range(4):
            pipeline["in"].push(b"1")
        pipeline["in"].end()
        objects = [pipeline["out"].pull_object(10) for _ in range(6)]
    kinds = [type(item) for item in objects]
    assert kinds == [CapsEvent, SegmentEvent, Frame, Frame, Frame, Frame]


def test_caps_set_twice() -> None:
    """asr-caps2: before the start the last ones count; later each frame has those set when it was pushed."""
    with Pipeline.parse("appsrc name=in caps=x/y ! appsink name=out") as pipeline:
        source = pipeline["in"]
        source.set_property("caps", A)
        pipeline.play()
        source.push(b"1")
        source.set_property("caps", B)
        source.push(b"2")
        source.end()
        assert [item.caps for item in pulled(pipeline)] == [A, B]


def test_one_pipeline_feeds_another() -> None:
    """asr-deadlock: a blocking appsrc fed by an appsink; both stop."""
    upper = Pipeline.parse("fakesrc ! appsink name=out max-buffers=1")
    lower = Pipeline.parse("appsrc name=in max-buffers=1 block=true ! appsink name=stuck max-buffers=1")
    with upper, lower:
        upper.play()
        lower.play()

        def carry() -> None:
            with contextlib.suppress(StateError):
                while True:
                    lower["in"].push(upper["out"].pull(), timeout_s=60.0)

        carrying = threading.Thread(target=carry)
        carrying.start()
        assert lower["stuck"].pull() is not None
    carrying.join(10)
    assert not carrying.is_alive()


class Gate(Sink):
    """Holds caps or frames until it is opened."""

    sink = "ANY"

    def start(self) -> None:
        """Closed."""
        self.is_open = threading.Event()
        self.blocked = threading.Event()
        self.seen: list[int] = []

    def _pass(self) -> None:
        self.blocked.set()
        while not self.is_open.wait(0.02) and not self.stopping.is_set():
            continue

    def configure(self, sink_caps: Caps) -> None:
        """Holds the caps."""
        self._pass()

    def render(self, frame: Frame) -> None:
        """Holds the frame."""
        self._pass()
        self.seen.append(frame.seq)


def test_stopping_while_caps_are_held(register: Register) -> None:
    """asr-blocked-caps: downstream sits on the caps: the stop comes through."""
    register(gate=Gate)
    with Pipeline.parse("appsrc name=in caps=a/b ! gate name=g") as pipeline:
        pipeline.play()
        pipeline["in"].push(b"1")
        assert pipeline["g"].blocked.wait(10)


def test_ending_while_downstream_is_blocked(register: Register) -> None:
    """asr-blocked-eos: `end` does not wait, a later push is refused, EOS comes once downstream goes on."""
    register(gate=Gate)
    with Pipeline.parse("appsrc name=in ! gate name=g") as pipeline:
        pipeline.play()
        pipeline["in"].push(frame(0))
        assert pipeline["g"].blocked.wait(10)
        pipeline["in"].push(frame(1))
        pipeline["in"].end()
        with pytest.raises(StateError, match="no frame can follow end"):
            pipeline["in"].push(frame(2))
        pipeline["g"].is_open.set()
        assert pipeline.wait(10) is not None
        assert pipeline["g"].seen == [0, 1]


def test_lists_and_frames() -> None:
    """asr-list: mixed, their order stays."""
    line = Line()
    line.element.push_list([frame(0), frame(1)])
    line.element.push(frame(2))
    line.element.push_list([frame(3)])
    assert [item.seq for item in line.taken()] == [0, 1, 2, 3]


@pytest.mark.parametrize(
    "limit", [{"max_buffers": 2}, {"max_bytes": 8, "max_buffers": 0}, {"max_time": 40 * MS, "max_buffers": 0}]
)
@pytest.mark.parametrize(("leaky", "left"), [("upstream", [0, 1]), ("downstream", [2, 3])])
def test_limits_of_a_leaky_line(limit: dict[str, int], leaky: str, left: list[int]) -> None:
    """asr-limits: the new or the oldest frame is dropped, the push returns; the next one is marked."""
    line = Line(leaky_type=leaky, **limit)
    for number in range(4):
        line.element.push(frame(number, b"1234", pts=number * 20 * MS, duration=20 * MS))
        assert line.element.current_level_buffers <= 2
    assert sum(line.element.drops.values()) == 2
    line.element.leaky_type = type(line.element.leaky_type)("none")
    line.element.block = False
    line.element.push(frame(4))
    items = line.taken()
    assert [item.seq for item in items] == [*left, 4]
    marked = [item.seq for item in items if item.flags & FrameFlags.DISCONTINUITY]
    assert marked == ([4] if leaky == "upstream" else [2, 3])


def test_events_travel_with_the_frames() -> None:
    """asr-events: before and between frames, behind caps and segment."""
    with Pipeline.parse("appsrc name=in caps=a/b ! appsink name=out") as pipeline:
        first, second = GapEvent(1), GapEvent(2)
        for item in (first, frame(0), second, frame(1)):
            pipeline["in"].push(item)
        pipeline["in"].end()
        pipeline.play()
        objects = [pipeline["out"].pull_object(10) for _ in range(6)]
    order = [item.seq if isinstance(item, Frame) else item for item in objects]
    assert [item for item in order if not isinstance(item, CapsEvent | SegmentEvent)] == [first, 0, second, 1]


def test_segments_travel_with_the_frames() -> None:
    """asr-segment: a new period's segment comes before its frames."""
    with Pipeline.parse("appsrc name=in ! appsink name=out") as pipeline:
        period = SegmentEvent(Segment(0, None, 10 * SECOND))
        for item in (frame(0, pts=0), period, frame(1, pts=0)):
            pipeline["in"].push(item)
        pipeline["in"].end()
        pipeline.play()
        objects = [pipeline["out"].pull_object(10) for _ in range(5)]
    order = [item.seq if isinstance(item, Frame) else item for item in objects]
    assert order[-2:] == [period, 1]


def test_signals() -> None:
    """asr-signals: enough-data when full; with block=false pushes go on past it; none after the end."""
    line = Line(max_bytes=100, block=False)
    enough: list[Any] = []
    line.element.on_enough_data(enough.append)
    line.push(5, bytes(40))
    assert enough == [line.element] * 2
    assert line.element.current_level_bytes == 200
    line.element.end()
    with pytest.raises(StateError, match="no frame can follow end"):
        line.push(1)


def test_data_is_asked_for() -> None:
    """asr-signals: need-data when the line is empty, or below its part of max-bytes."""
    line = Line(max_bytes=100, min_percent=50)
    wanted: list[Any] = []
    line.element.on_need_data(lambda element, size: wanted.append(element.current_level_bytes))
    line.push(3, bytes(30))
    assert len(line.taken()) == 3
    assert wanted == [30, 0]


def test_a_blocking_push() -> None:
    """asr-block: with max-buffers=2 the third waits, and goes on once one is taken."""
    line = Line(block=True, max_buffers=2)
    line.push(2)
    assert not line.element.try_push(frame(2))
    pushing = threading.Thread(target=line.element.push, args=(frame(2),))
    pushing.start()
    pushing.join(0.05)
    assert pushing.is_alive()
    assert line.element._take().seq == 0  # type: ignore[union-attr]
    pushing.join(10)
    assert not pushing.is_alive()


def test_live_frames_are_stamped() -> None:
    """asr-ts: is-live and do-timestamp: the running time at which they came."""
    clock = ManualClock()
    text = "appsrc name=in is-live=true do-timestamp=true ! appsink name=out"
    with Pipeline.parse(text, clock=clock) as pipeline:
        pipeline.play()
        times = []
        for _ in range(3):
            clock.advance(0.5)
            pipeline["in"].push(Frame(b"", A))
            times.append(pipeline["out"].pull().pts)
    assert times == [500 * MS, 1000 * MS, 1500 * MS]
