"""Segments, clock, latency, position and the end of streams, as behaviour.md tells."""

from collections.abc import Callable, Iterator

import pytest

from streamkit import Caps, Flushing, Frame, MessageKind, Pipeline, Segment, Source
from streamkit.testing import Harness, ManualClock

Register = Callable[..., None]
ANYTHING = Caps("a/b")
SECOND = 1_000_000_000


@pytest.mark.parametrize(
    ("segment", "pts", "running_time"),
    [
        (Segment(), 5, 5),
        (Segment(start_ns=2), 5, 3),
        (Segment(start_ns=2, base_ns=10), 5, 13),
        (Segment(start_ns=2, base_ns=10), 2, 10),
        (Segment(start_ns=2, stop_ns=8, base_ns=10), 8, 16),
        (Segment(start_ns=2, base_ns=10), 0, 8),
    ],
)
def test_running_time_of_a_segment(segment: Segment, pts: int, running_time: int) -> None:
    """seg-math: a timestamp counts from the segment's start, on top of its base."""
    assert segment.running_time_ns(pts) == running_time


@pytest.mark.parametrize(
    ("pts", "duration", "is_inside"),
    [
        (0, None, False),
        (0, 10, False),
        (5, 5, False),
        (5, 6, True),
        (10, None, True),
        (19, 5, True),
        (20, 5, False),
    ],
)
def test_what_lies_in_a_segment(pts: int, duration: int | None, is_inside: bool) -> None:
    """seg-clip, fk-clip: from start to stop, and frames that reach over the start."""
    assert Segment(start_ns=10, stop_ns=20).holds(pts, duration) is is_inside


def test_running_time_begins_anew_after_ready() -> None:
    """clk-reset: it stands at PAUSED and is 0 again after READY."""
    clock = ManualClock()
    with Pipeline.parse("appsrc name=in ! fakesink name=k sync=true", clock=clock) as pipeline:
        pipeline.play()
        for pts in (0, SECOND):
            pipeline["in"].push(Frame(b"", ANYTHING, pts=pts, arrival_ns=1))
        assert clock.wait_for_waiter()
        clock.advance(0.05)
        pipeline.pause()
        assert pipeline.timing.running_time_ns() == 50_000_000
        pipeline.ready()
        assert pipeline.timing.running_time_ns() == 0


class Camera(Source):
    """A live source that gives nothing."""

    src = "a/b"
    is_live = True

    def frames(self) -> Iterator[Frame]:
        self.stopping.wait()
        return iter(())


def test_a_live_sink_needs_a_queue(register: Register) -> None:
    """lat-proc: 20 ms to work on frames; without a queue nothing can hold them so long: a warning."""
    register(camera=Camera)
    with Pipeline.parse("camera ! queue ! fakesink sync=true") as pipeline:
        pipeline.play()
        assert pipeline.timing.latency_ns == 20_000_000
        assert pipeline.bus.pop(0.0, (MessageKind.WARNING,)) is None
    with Pipeline.parse("camera ! fakesink sync=true") as pipeline:
        pipeline.play()
        warning = pipeline.bus.pop(0.0, (MessageKind.WARNING,))
        assert warning is not None
        assert "put a queue" in warning.text


def test_position_and_duration() -> None:
    """dur-pos: ten seconds of frames; after half a second the frame shown is the one due then."""
    clock = ManualClock()
    text = "videotestsrc num-buffers=100 ! video/x-raw,framerate=10/1,width=16,height=16 ! fakesink sync=true"
    with Pipeline.parse(text, clock=clock) as pipeline:
        pipeline.play()
        assert clock.wait_for_waiter()
        assert pipeline.duration_ns() == 10 * SECOND
        assert pipeline.position_ns() == 0
        for _ in range(5):
            clock.advance(0.1)
            assert clock.wait_for_waiter()
        assert pipeline.position_ns() == SECOND // 2


def test_the_longest_source_is_the_duration() -> None:
    """dur-max: unknown where one of them is."""
    small = "video/x-raw,framerate=10/1,width=16,height=16 ! fakesink"
    text = f"videotestsrc num-buffers=20 ! {small} videotestsrc num-buffers=50 ! {small}"
    with Pipeline.parse(text) as pipeline:
        pipeline.run(timeout_s=10)
        assert pipeline.duration_ns() == 5 * SECOND
    with Pipeline.parse(f"{text} videotestsrc ! {small}") as pipeline:
        pipeline.pause()
        assert pipeline.duration_ns() is None


def test_removing_the_branch_that_has_not_ended_ends_the_stream() -> None:
    """eos-recheck: the sinks that are left have all seen EOS."""
    text = "fakesrc num-buffers=1 ! fakesink  appsrc name=in ! tee name=t"
    with Pipeline.parse(text) as pipeline:
        branch = pipeline.add_branch("t", "fakesink name=k")
        pipeline.play()
        pipeline["in"].push(Frame(b"", ANYTHING, arrival_ns=1))
        assert pipeline.wait(0.3) is None
        pipeline.remove_branch(branch)
        assert pipeline.wait(10) is not None


def test_a_source_does_not_drop_for_the_sink() -> None:
    """sk-qos-src: every frame reaches the sink, which alone drops those that are late."""
    clock = ManualClock()
    text = "appsrc name=in ! identity name=i sleep-time=0 ! fakesink name=k sync=true max-lateness=0"
    with Pipeline.parse(text, clock=clock) as pipeline:
        pipeline.play()
        for pts in (0, SECOND, 0, 0):
            pipeline["in"].push(Frame(b"", ANYTHING, pts=pts, arrival_ns=1))
        assert clock.wait_for_waiter()
        clock.advance(2)
        pipeline["in"].end()
        assert pipeline.wait(10) is not None
        counts = {row.element: row for row in pipeline.statistics()}
        assert counts["k"].frames_in == 4
        assert counts["k"].dropped == {"too late": 3}


def test_a_flushing_element_refuses_frames() -> None:
    """err-flush: a queue between a flush's start and its stop answers FLUSHING."""
    with Harness("queue") as harness:
        harness.element.flush(begins=True)
        with pytest.raises(Flushing):
            harness.push(Frame(b"", ANYTHING))


def test_a_live_pipeline_told_to_end_ends_once(register: Register) -> None:
    """eos-app: sources stop, EOS travels behind the data, and is told once."""
    with Pipeline.parse("fakesrc is-live=true ! tee name=t t. ! queue ! fakesink t. ! fakesink") as pipeline:
        pipeline.play()
        pipeline.finish()
        assert pipeline.wait(10) is not None
        assert pipeline.wait(0.05) is None
