"""Pausing, preroll, flushing, renegotiation and running time."""

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from streamkit import (
    Caps,
    ElementFailure,
    EndOfStream,
    Frame,
    MessageKind,
    Pipeline,
    Property,
    PropertyError,
    Sink,
    Source,
    StreamkitError,
    Transform,
)
from streamkit.graph.pipeline import State, StateChange
from streamkit.testing import ManualClock

Register = Callable[..., None]
ANYTHING = Caps("a/b")
SECOND = 1_000_000_000


def is_streaming(name: str) -> bool:
    """Whether the thread of an element has not ended."""
    return any(thread.name == f"streamkit:{name}" for thread in threading.enumerate())


class Showing(Sink):
    """Records what it prerolls and renders."""

    sink = "ANY"

    def start(self) -> None:
        self.reported: list[tuple[str, int | None]] = []
        self.changed = threading.Condition()

    def _record(self, what: str, number: int | None) -> None:
        with self.changed:
            self.reported.append((what, number))
            self.changed.notify_all()

    def preroll(self, frame: Frame | None) -> None:
        self._record("preroll", None if frame is None else frame.seq)

    def render(self, frame: Frame) -> None:
        self._record("render", frame.seq)

    def wait_for(self, number: int) -> bool:
        """Waits for a number of records."""
        with self.changed:
            return self.changed.wait_for(lambda: len(self.reported) >= number, timeout=10)


class Camera(Source):
    """A live source; a frame comes when the test asks for one."""

    src = "a/b"
    is_live = True

    def start(self) -> None:
        self.asked = threading.Semaphore(0)

    def frames(self) -> Iterator[Frame]:
        number = 0
        while not self.stopping.is_set():
            if self.asked.acquire(timeout=0.05):
                yield Frame(b"", ANYTHING, pts=number * SECOND, seq=number, arrival_ns=1)
                number += 1


def test_pausing_from_the_start_prerolls_one_frame(register: Register) -> None:
    """sk-async, sk-one: one frame enters the sink and is rendered only when the pipeline plays."""
    register(showing=Showing)
    with Pipeline.parse("fakesrc num-buffers=3 ! showing name=k") as pipeline:
        assert pipeline.pause() in (StateChange.ASYNC, StateChange.SUCCESS)
        assert pipeline.wait_prerolled(10)
        assert pipeline.state is State.PAUSED
        assert pipeline["k"].reported == [("preroll", 0)]
        assert pipeline.play() is StateChange.SUCCESS
        assert pipeline.wait(10) is not None
        assert pipeline["k"].reported == [("preroll", 0), ("render", 0), ("render", 1), ("render", 2)]


def test_preroll_is_reported_once(register: Register) -> None:
    """sk-asyncdone: the bus says when every sink holds its first frame."""
    register(showing=Showing)
    with Pipeline.parse("fakesrc ! tee name=t t. ! queue ! showing t. ! queue ! showing") as pipeline:
        pipeline.pause()
        assert pipeline.wait_prerolled(10)
        names = []
        while (message := pipeline.bus.pop(0.0)) is not None:
            names.append(message.fields.get("name"))
        assert names.count("async-done") == 1


def test_end_of_stream_counts_as_preroll(register: Register) -> None:
    """bs-eos-play, sk-asyncdone-eos: EOS is posted once the pipeline plays."""
    register(showing=Showing)
    with Pipeline.parse("fakesrc num-buffers=0 ! showing name=k") as pipeline:
        pipeline.pause()
        assert pipeline.wait_prerolled(10)
        assert not pipeline.ended.is_set()
        pipeline.play()
        assert pipeline.wait(10) is not None
        assert pipeline["k"].reported == [("preroll", None)]


def test_a_sink_without_async_is_not_waited_for() -> None:
    """sk-async-false: PAUSED is reached without its frame."""
    with Pipeline.parse("appsrc ! fakesink async=false") as pipeline:
        assert pipeline.pause() is StateChange.SUCCESS


def test_a_sink_that_has_ended_is_not_waited_for(register: Register) -> None:
    """A pause prerolls the others."""
    register(showing=Showing)
    with Pipeline.parse(
        "fakesrc num-buffers=0 ! fakesink name=k  appsrc name=in ! showing name=s"
    ) as pipeline:
        pipeline.play()
        pipeline._playback.end.wait([pipeline["k"]], 10)
        pipeline.pause()
        pipeline["in"].push(Frame(b"", ANYTHING))
        assert pipeline.wait_prerolled(10)


def test_a_sink_that_holds_a_frame_at_once_has_prerolled(
    register: Register, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It says so only once, and may do so before `pause` goes on."""
    register(showing=Showing)
    with Pipeline.parse("appsrc name=in ! showing name=k throttle-time=1") as pipeline:
        pipeline.play()
        sink, pause = pipeline["k"], pipeline.timing.pause

        def pause_and_wait() -> None:
            pause()
            pipeline["in"].push(Frame(b"", ANYTHING))
            assert sink.wait_for(1)
            while not sink.is_waiting:
                time.sleep(0.001)

        monkeypatch.setattr(pipeline.timing, "pause", pause_and_wait)
        pipeline.pause()
        assert sink.reported == [("preroll", 0)]
        assert pipeline.wait_prerolled(10)


def test_branches_without_queues_stay_asynchronous(register: Register) -> None:
    """t-preroll, t-preroll2: the first sink holds the only thread; playing frees it."""
    register(showing=Showing)
    text = "fakesrc num-buffers=2 ! tee name=t t. ! showing name=a t. ! showing name=b"
    with Pipeline.parse(text) as pipeline:
        assert pipeline.pause() is StateChange.ASYNC
        assert pipeline["a"].wait_for(1)
        assert not pipeline.wait_prerolled(0.05)
        pipeline.play()
        assert pipeline.wait(10) is not None
        assert pipeline["b"].reported == [("render", 0), ("render", 1)]


def test_a_live_pipeline_does_not_preroll(register: Register) -> None:
    """sk-live, sk-live-down: no data flows in PAUSED, before playing and after."""
    register(camera=Camera, showing=Showing)
    with Pipeline.parse("camera name=c ! showing name=k") as pipeline:
        assert pipeline.pause() is StateChange.NO_PREROLL
        pipeline["c"].asked.release()
        with pipeline["k"].changed:
            assert not pipeline["k"].changed.wait(0.2)
        assert pipeline.play() is StateChange.SUCCESS
        assert pipeline["k"].wait_for(1)
        assert pipeline["k"].reported == [("render", 0)]
        assert pipeline.pause() is StateChange.NO_PREROLL


def test_a_pause_holds_the_next_frame(register: Register) -> None:
    """One preroll a pause, and every frame is rendered once."""
    register(showing=Showing)
    with Pipeline.parse("appsrc name=in max-buffers=100 ! showing name=k") as pipeline:
        pipeline.play()
        pipeline["in"].push(Frame(b"", ANYTHING, seq=0, arrival_ns=1))
        assert pipeline["k"].wait_for(1)
        pipeline.pause()
        for seq in (1, 2):
            pipeline["in"].push(Frame(b"", ANYTHING, seq=seq, arrival_ns=1))
        assert pipeline.wait_prerolled(10)
        assert pipeline["k"].reported == [("render", 0), ("preroll", 1)]
        pipeline.play()
        assert pipeline["k"].wait_for(4)
        assert pipeline["k"].reported[2:] == [("render", 1), ("render", 2)]


def test_running_time_stands_still_while_paused() -> None:
    """sk-pause, clk-base: a pause of a second delays later frames by a second."""
    clock = ManualClock()
    with Pipeline.parse("appsrc name=in ! fakesink name=k sync=true", clock=clock) as pipeline:
        pipeline.play()
        for seq in (0, 1):
            pipeline["in"].push(Frame(b"", ANYTHING, pts=seq * SECOND, seq=seq, arrival_ns=1))
        assert clock.wait_for_waiter()
        clock.advance(0.5)
        assert pipeline.timing.running_time_ns() == SECOND // 2
        pipeline.pause()
        assert pipeline.wait_prerolled(10)
        clock.advance(10)
        assert pipeline.timing.running_time_ns() == SECOND // 2
        pipeline.play()
        assert clock.wait_for_waiter()
        clock.advance(0.5)
        pipeline["in"].end()
        assert pipeline.wait(10) is not None
        assert pipeline["k"].count == 2
        assert pipeline.position_ns() == SECOND


def test_the_end_waits_for_the_last_frame_to_be_over() -> None:
    """sk-fake-eos: with sync, EOS comes when the last frame's duration has passed."""
    clock = ManualClock()
    with Pipeline.parse("appsrc name=in ! fakesink sync=true", clock=clock) as pipeline:
        pipeline.play()
        pipeline["in"].push(Frame(b"", ANYTHING, pts=0, duration=100 * SECOND, arrival_ns=1))
        pipeline["in"].end()
        assert clock.wait_for_waiter()
        assert not pipeline.ended.is_set()
        clock.advance(100)
        assert pipeline.wait(10) is not None


def test_two_sinks_share_one_running_time(register: Register) -> None:
    """Frames of two branches with the same time stamp are due together, whichever came first."""
    clock = ManualClock()
    register(showing=Showing)
    branches = (f"t. ! queue ! showing name={name} sync=true" for name in "ab")
    text = "appsrc name=in ! tee name=t " + " ".join(branches)
    with Pipeline.parse(text, clock=clock) as pipeline:
        pipeline.play()
        for seq in (0, 1):
            pipeline["in"].push(Frame(b"", ANYTHING, pts=(5 + seq) * SECOND, seq=seq, arrival_ns=1))
        assert pipeline["a"].wait_for(1)
        assert pipeline["b"].wait_for(1)
        assert clock.wait_for_waiter()
        clock.advance(1)
        assert pipeline["a"].wait_for(2)
        assert pipeline["b"].wait_for(2)


def test_late_frames_are_dropped_counted_and_reported() -> None:
    """sk-late: with max-lateness; with qos each is posted on the bus."""
    clock = ManualClock()
    text = "appsrc name=in ! fakesink name=k sync=true qos=true max-lateness=1000000"
    with Pipeline.parse(text, clock=clock) as pipeline:
        pipeline.play()
        for seq, pts in enumerate((0, 5 * SECOND, 1 * SECOND, 6 * SECOND)):
            pipeline["in"].push(Frame(b"", ANYTHING, pts=pts, seq=seq, arrival_ns=1))
        assert clock.wait_for_waiter()
        clock.advance(5)
        reported = pipeline.bus.pop(5.0, (MessageKind.ELEMENT,))
        assert reported is not None
        assert (reported.fields["name"], reported.fields["late_ns"]) == ("qos", 4 * SECOND)
        assert clock.wait_for_waiter()
        clock.advance(1)
        pipeline["in"].end()
        assert pipeline.wait(10) is not None
        assert pipeline["k"].count == 3
        assert pipeline["k"].drops == {"too late": 1}


def test_a_flush_drops_frames_in_flight(register: Register) -> None:
    """q-flush: later frames pass."""
    clock = ManualClock()
    register(showing=Showing)
    with Pipeline.parse("appsrc name=in ! showing name=k sync=true", clock=clock) as pipeline:
        pipeline.play()
        for seq, pts in enumerate((0, 1000 * SECOND)):
            pipeline["in"].push(Frame(b"", ANYTHING, pts=pts, seq=seq, arrival_ns=1))
        assert clock.wait_for_waiter()
        pipeline.flush()
        pipeline["in"].push(Frame(b"", ANYTHING, pts=0, seq=2, arrival_ns=1))
        assert pipeline["k"].wait_for(2)
        assert pipeline["k"].reported == [("render", 0), ("render", 2)]


def test_a_flush_drops_a_frame_that_is_being_prerolled(register: Register) -> None:
    """Before the sink waits with it; the next frame prerolls in its place."""
    inside, flushed = threading.Event(), threading.Event()

    class Slow(Showing):
        """Takes long to show a frame."""

        def preroll(self, frame: Frame | None) -> None:
            super().preroll(frame)
            inside.set()
            flushed.wait(10)

    register(slow=Slow)
    with Pipeline.parse("fakesrc ! slow name=k") as pipeline:
        pipeline.pause()
        assert inside.wait(10)
        pipeline.flush()
        flushed.set()
        assert pipeline["k"].wait_for(2)
        assert pipeline["k"].reported == [("preroll", 0), ("preroll", 1)]


@pytest.mark.parametrize("between", ["", "queue !"])
def test_a_flush_keeps_the_end_of_the_stream(register: Register, between: str) -> None:
    """In a queue EOS stays; a paused sink that holds it gets it once more."""
    register(showing=Showing)
    with Pipeline.parse(f"fakesrc num-buffers=0 name=f ! {between} showing name=k") as pipeline:
        drained: list[bool] = []
        pipeline["k"].drain = lambda: drained.append(True)
        pipeline.pause()
        assert pipeline["k"].wait_for(1)
        while between and is_streaming("f"):
            time.sleep(0.001)
        pipeline.flush()
        assert pipeline["k"].wait_for(2)
        pipeline.play()
        message = pipeline.wait(10)
    assert message is not None
    assert message.kind is MessageKind.EOS
    assert drained == [True]
    assert pipeline["k"].reported == [("preroll", None)] * 2


def test_a_flush_keeps_the_end_of_the_stream_behind_a_queue_that_has_ended(register: Register) -> None:
    """The thread of the first queue is over when EOS meets the flush behind the second one."""
    register(showing=Showing)
    text = "fakesrc num-buffers=1 ! queue name=first ! queue ! showing name=k"
    with Pipeline.parse(text) as pipeline:
        for _ in range(2):
            pipeline.pause()
            while is_streaming("first"):
                time.sleep(0.001)
            pipeline.flush()
        pipeline.play()
        assert pipeline.wait(10) is not None


def test_a_flush_that_ends_as_the_pipeline_resumes_leaves_waits_working(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """In a process, flushes come with the frames, in another thread than orders."""
    with Pipeline.parse("appsrc ! fakesink name=k sync=true") as pipeline:
        pipeline.pause()
        sink, resume = pipeline["k"], pipeline.timing.resume
        sink.flush(begins=True)

        def end_flush_and_resume() -> None:
            sink.flush(begins=False)
            resume()

        monkeypatch.setattr(pipeline.timing, "resume", end_flush_and_resume)
        pipeline.play()
        assert sink.wait_on_clock(sink.clock_ns() + 1_000_000)


def test_a_filter_changed_while_playing_renegotiates() -> None:
    """cf-reneg: the source chooses anew, and every frame matches the caps it carries."""
    text = (
        "videotestsrc name=v ! capsfilter name=f caps=video/x-raw,format=GRAY8,width=64,height=32 "
        "! queue max-size-buffers=2 ! appsink name=out max-buffers=2"
    )
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        frames = iter(pipeline["out"])
        assert next(frames).data.shape == (32, 64)
        pipeline["f"].set_property("caps", Caps("video/x-raw, format=GRAY8, width=16, height=8"))
        for _ in range(50):
            frame = next(frames)
            assert frame.data.shape == (frame.caps["height"], frame.caps["width"])
            if frame.data.shape == (8, 16):
                return
    pytest.fail("the new size never came")


def test_a_filter_that_no_element_can_meet_is_an_error() -> None:
    """cf-wrong: the error names both pads and the field."""
    text = "videotestsrc name=v ! capsfilter name=f caps=video/x-raw,format=GRAY8 ! appsink name=out"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        frames = iter(pipeline["out"])
        next(frames)
        pipeline["f"].set_property("caps", Caps("video/x-raw, format=NOSUCH"))
        with pytest.raises(StreamkitError, match=r"v\.src -> f\.sink: not negotiated.*format"):
            list(frames)


def test_a_stop_from_a_streaming_thread_is_refused(register: Register) -> None:
    """A thread cannot wait for its own end: the error says what to call instead."""

    class Quitting(Sink):
        """Stops its pipeline."""

        sink = "ANY"

        def render(self, frame: Frame) -> None:
            pipeline.stop()

    register(quitting=Quitting)
    with (
        Pipeline.parse("fakesrc num-buffers=1 ! quitting") as pipeline,
        pytest.raises(ElementFailure, match=r"call finish\(\) there"),
    ):
        pipeline.run(timeout_s=10)


def test_a_chain_of_two_thousand_elements_runs() -> None:
    """Events and caps walk along a chain without recursion."""
    text = "fakesrc num-buffers=2 ! " + "identity drop-probability=0.0 ! " * 2000 + "fakesink name=k"
    with Pipeline.parse(text) as pipeline:
        pipeline.run(timeout_s=60)
        assert pipeline["k"].count == 2


def test_latency_adds_up_along_the_longest_path(register: Register) -> None:
    """lat-query: live flags are joined, minima add along a path, non-live graphs have none."""

    class Slow(Transform):
        """Takes its time."""

        sink = src = "ANY"
        delay: int = Property(0, min=0, unit="ns", doc="What it adds.")

        def latency(self) -> tuple[int, int | None]:
            return self.delay, self.delay

        def transform(self, frame: Frame) -> Frame:
            return frame

    register(slow=Slow, camera=Camera)
    assert Pipeline.parse("fakesrc ! slow delay=5 ! fakesink").latency().minimum_ns == 0
    text = "camera ! tee name=t t. ! slow delay=5 ! slow delay=2 ! fakesink t. ! slow delay=3 ! fakesink"
    latency = Pipeline.parse(text).latency()
    assert (latency.is_live, latency.minimum_ns) == (True, 7)


def test_a_thousand_runs_leak_nothing() -> None:
    """Neither threads nor objects."""
    import gc

    with Pipeline.parse("fakesrc num-buffers=2 ! queue ! fakesink name=k") as pipeline:
        for _ in range(50):
            pipeline.run(timeout_s=10)
        gc.collect()
        before, threads = len(gc.get_objects()), set(threading.enumerate())
        for _ in range(950):
            pipeline.run(timeout_s=10)
        gc.collect()
        assert len(gc.get_objects()) - before < 500
        assert set(threading.enumerate()) <= threads
        assert pipeline["k"].count == 2


def test_counters_start_again_with_each_run(tmp_path: Path) -> None:
    """Files of an earlier run are not counted."""
    text = f"fakesrc num-buffers=2 ! filesink name=k location={tmp_path / 'out'}"
    with Pipeline.parse(text) as pipeline:
        for _ in range(2):
            pipeline.run(timeout_s=10)
            assert pipeline["k"].results == {"files": 1}


def test_end_of_stream_from_a_sink_ends_the_source(register: Register) -> None:
    """fk-eos2: a sink that wants no more ends the stream behind a queue too."""

    class Sated(Sink):
        """Takes two frames."""

        sink = "ANY"

        def start(self) -> None:
            self.count = 0

        def render(self, frame: Frame) -> None:
            self.count += 1
            if self.count == 2:
                raise EndOfStream(self.name)

    register(sated=Sated)
    with Pipeline.parse("fakesrc ! queue ! sated name=k") as pipeline:
        pipeline.run(timeout_s=10)
        assert pipeline["k"].count == 2


def test_a_flush_of_several_sources_leaves_every_thread_working(register: Register) -> None:
    """One thread holds a frame in the sink when the flush comes there from the other source first."""

    class Slow(Showing):
        """Gives the thread that it wakes the time to unwind."""

        def flush(self, *, begins: bool) -> None:
            super().flush(begins=begins)
            time.sleep(0.05)

    register(slow=Slow)
    text = "funnel name=f ! slow name=k  appsrc name=b ! f.  appsrc name=a ! queue name=q ! f."
    with Pipeline.parse(text) as pipeline:
        pipeline.pause()
        pipeline["a"].push(Frame(b"", ANYTHING, seq=0, arrival_ns=1))
        assert pipeline["k"].wait_for(1)
        pipeline.flush()
        pipeline.play()
        pipeline["a"].push(Frame(b"", ANYTHING, seq=1, arrival_ns=1))
        assert pipeline["k"].wait_for(2)
        assert is_streaming("q")
        for name in "ab":
            pipeline[name].end()
        assert pipeline.wait(10) is not None
        assert pipeline["k"].reported == [("preroll", 0), ("render", 1)]


def test_a_property_that_is_not_live_cannot_be_assigned_while_playing() -> None:
    """Assignment is refused as `set_property` is: it would have no effect, without a word."""
    with Pipeline.parse("fakesrc name=source ! queue name=q ! fakesink") as pipeline:
        pipeline["source"].sizemax = 100
        pipeline.play()
        rule = "source: property sizemax cannot change while playing; stop the pipeline to set it"
        with pytest.raises(PropertyError, match=rule):
            pipeline["source"].sizemax = 200
        with pytest.raises(PropertyError, match=rule):
            pipeline["source"].set_property("sizemax", 200)
        assert pipeline["source"].sizemax == 100
        pipeline["q"].max_size_buffers = 10
