"""Pipelines: states, EOS, errors, and stopping in time."""

import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from streamkit import (
    Caps,
    Element,
    ElementFailure,
    Frame,
    Message,
    MessageKind,
    NotNegotiated,
    Pipeline,
    ResourceError,
    Sink,
    Source,
    Transform,
)
from streamkit.errors import StateError

Register = Callable[..., None]
ANYTHING = Caps("a/b")


class Journal(list[str]):
    """Starts and stops, in order."""


def journaling(journal: Journal, base: type[Element], **behaviour: Any) -> type[Element]:
    """A class of the base that writes its starts and stops into the journal."""

    def start(self: Element) -> None:
        journal.append(f"start {self.name}")
        if behaviour.get("fail_start") == self.name:
            raise ResourceError("no such device")

    def stop(self: Element) -> None:
        journal.append(f"stop {self.name}")
        if behaviour.get("fail_stop") == self.name:
            raise ValueError("busy")

    body = {"start": start, "stop": stop, "sink": "ANY", "src": "ANY", "__doc__": "Journals."}
    if base is Transform:
        body["transform"] = lambda self, frame: frame
    elif base is Sink:
        del body["src"]
        body["render"] = lambda self, frame: None
    else:
        del body["sink"]
        body["frames"] = lambda self: iter([Frame(b"", ANYTHING)])
    return type(f"Journaling{base.__name__}", (base,), body)


def register_journaling(register: Register, **behaviour: Any) -> Journal:
    """Registers jsrc, jmid and jsink; what they do is written down."""
    journal = Journal()
    register(
        jsrc=journaling(journal, Source, **behaviour),
        jmid=journaling(journal, Transform, **behaviour),
        jsink=journaling(journal, Sink, **behaviour),
    )
    return journal


TEXT = "jsrc name=src ! jmid name=mid ! jsink name=sink"


def test_sinks_start_first_and_stop_last(register: Register) -> None:
    """st-order: every element has started before it gets a frame."""
    journal = register_journaling(register)
    Pipeline.parse(TEXT).run(timeout_s=10)
    assert journal == ["start sink", "start mid", "start src", "stop src", "stop mid", "stop sink"]


@pytest.mark.parametrize(("failing", "started"), [("sink", 1), ("mid", 2), ("src", 3)])
def test_a_failed_start_stops_the_started_elements(register: Register, failing: str, started: int) -> None:
    """st-fail: including the one that failed, and no other."""
    journal = register_journaling(register, fail_start=failing)
    pipeline = Pipeline.parse(TEXT)
    with pytest.raises(ElementFailure, match=f"^{failing} .*no such device$"):
        pipeline.play()
    assert [line.split()[1] for line in journal if line.startswith("start")] == ["sink", "mid", "src"][
        :started
    ]
    assert sorted(line.split()[1] for line in journal if line.startswith("stop")) == sorted(
        ["sink", "mid", "src"][:started]
    )
    assert str(pipeline.state) == "null"
    pipeline.stop()


def test_a_failed_stop_does_not_keep_others_from_stopping(register: Register) -> None:
    """The failure is a warning on the bus; all others are stopped."""
    journal = register_journaling(register, fail_stop="mid")
    pipeline = Pipeline.parse(TEXT)
    pipeline.run(timeout_s=10)
    assert journal[-3:] == ["stop src", "stop mid", "stop sink"]
    warnings = [m for m in iter(pipeline.bus.pop, None) if m.kind is MessageKind.WARNING]
    assert [(m.source, m.text) for m in warnings] == [("mid", "stop failed: mid (jmid): ValueError: busy")]


def test_all_started_elements_stop_after_an_error(register: Register) -> None:
    """An element that fails while streaming changes nothing about that."""
    journal = register_journaling(register)

    class Fails(Transform):
        """Fails."""

        sink = src = "ANY"

        def transform(self, frame: Frame) -> Frame:
            raise ValueError("bad")

    register(fails=Fails)
    with pytest.raises(ElementFailure, match=r"^fails0: ValueError: bad"):
        Pipeline.parse("jsrc name=src ! fails ! queue ! jsink name=sink").run(timeout_s=10)
    assert sorted(journal) == ["start sink", "start src", "stop sink", "stop src"]


def test_a_failure_that_is_not_read_is_logged(register: Register, caplog: pytest.LogCaptureFixture) -> None:
    """A script that plays, sleeps and leaves the block hears of it; one that reads the error, once."""

    class Failing(Sink):
        sink = "ANY"

        def render(self, frame: Frame) -> None:
            raise ResourceError("the disk is full")

    register(failing=Failing)
    with Pipeline.parse("fakesrc num-buffers=1 ! failing") as pipeline:
        pipeline.play()
        assert pipeline.ended.wait(10)
    assert "failing0" in caplog.text
    assert "the disk is full" in caplog.text
    caplog.clear()
    with Pipeline.parse("fakesrc num-buffers=1 ! failing") as pipeline:
        pipeline.play()
        message = pipeline.wait(10)
        assert message is not None
        assert message.kind is MessageKind.ERROR
    assert not caplog.text


def test_a_description_is_parsed_by_parse() -> None:
    """The constructor takes a graph; the error names the right call."""
    with pytest.raises(TypeError, match=r"got 'fakesrc ! fakesink'; make one of a text by Pipeline\.parse"):
        Pipeline("fakesrc ! fakesink")  # type: ignore[arg-type]


def test_one_end_for_all_sinks() -> None:
    """eos-2sinks, eos-once: EOS comes once, when the last sink has it."""
    text = "fakesrc num-buffers=3 ! fakesink name=a  fakesrc name=live ! fakesink name=b"
    with Pipeline.parse(text) as pipeline:
        ended: list[Message] = []
        pipeline.bus.watch(lambda message: ended.append(message) if message.kind is MessageKind.EOS else None)
        pipeline.play()
        assert pipeline.wait(0.05) is None
        assert not ended
        pipeline["live"].finish()
        assert pipeline.wait(10) is not None
    assert len(ended) == 1


@pytest.mark.parametrize("round_", range(5))
def test_many_sinks_ending_at_once_end_once(round_: int) -> None:
    """t-copies: 15 branches in threads of their own, one EOS, and none on shutdown."""
    text = "fakesrc num-buffers=3 ! tee name=t" + "  t. ! queue ! fakesink" * 15
    pipeline = Pipeline.parse(text)
    kinds: list[MessageKind] = []
    pipeline.bus.watch(lambda message: kinds.append(message.kind))
    pipeline.run(timeout_s=20)
    assert kinds.count(MessageKind.EOS) == 1
    assert all(pipeline[f"fakesink{n}"].count == 3 for n in range(15))


def test_stopping_sends_no_eos() -> None:
    """eos-none: a stop is not an end of stream."""
    pipeline = Pipeline.parse("fakesrc ! queue ! fakesink")
    with pipeline:
        pipeline.play()
    assert all(message.kind is not MessageKind.EOS for message in iter(pipeline.bus.pop, None))


def test_states_are_reported_in_order() -> None:
    """ready, playing, paused, playing, null, each once."""
    pipeline = Pipeline.parse("fakesrc ! fakesink")
    with pipeline:
        pipeline.play()
        pipeline.play()
        pipeline.pause()
        pipeline.play()
    states = [m.text for m in iter(pipeline.bus.pop, None) if m.kind is MessageKind.STATE]
    assert states == ["ready", "playing", "paused", "playing", "null"]


def test_an_error_ends_the_run_and_the_first_one_counts(register: Register) -> None:
    """Two branches fail: one error, the other a warning."""
    barrier = threading.Barrier(2)

    class Fails(Sink):
        """Fails together with its sibling."""

        sink = "ANY"

        def render(self, frame: Frame) -> None:
            barrier.wait(10)
            raise ValueError(self.name)

    register(fails=Fails)
    pipeline = Pipeline.parse(
        "fakesrc num-buffers=1 ! tee name=t t. ! queue ! fails name=a t. ! queue ! fails name=b"
    )
    messages: list[Message] = []
    pipeline.bus.watch(messages.append)
    with pytest.raises(ElementFailure, match=r"ValueError: [ab]"):
        pipeline.run(timeout_s=10)
    kinds = [message.kind for message in messages]
    assert kinds.count(MessageKind.ERROR) == 1
    assert kinds.count(MessageKind.EOS) == 0
    (error,) = [message for message in messages if message.kind is MessageKind.ERROR]
    assert error.error is pipeline.error
    assert error.source == pipeline.error.element  # type: ignore[union-attr]


def test_a_failed_branch_leaves_the_other_streaming(register: Register) -> None:
    """err-branch: the source ends, the healthy branch gets its frames and EOS; the error is reported."""

    class Fails(Sink):
        """Fails at the third frame."""

        sink = "ANY"

        def render(self, frame: Frame) -> None:
            if frame.seq == 2:
                raise ValueError("bad")

    drained = threading.Event()

    class Collects(Sink):
        """Keeps frames; reports EOS."""

        sink = "ANY"

        def start(self) -> None:
            self.seen: list[int] = []

        def render(self, frame: Frame) -> None:
            self.seen.append(frame.seq)

        def drain(self) -> None:
            drained.set()

    register(fails=Fails, collects=Collects)
    text = "fakesrc num-buffers=300 ! tee name=t t. ! queue ! fails t. ! collects name=healthy"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        message = pipeline.wait(10)
        assert message is not None
        assert message.source == "fails0"
        assert drained.wait(10)
        seen = pipeline["healthy"].seen
        assert seen == list(range(len(seen)))


def test_run_says_when_it_takes_too_long() -> None:
    """A limit that passes stops everything and is an error of its own."""
    pipeline = Pipeline.parse("appsrc ! fakesink")
    with pytest.raises(StateError, match=r"^the pipeline has not ended within 0.05 s$"):
        pipeline.run(timeout_s=0.05)
    assert str(pipeline.state) == "null"


def test_an_end_of_an_earlier_run_does_not_end_the_next() -> None:
    """bus-null: unread messages are discarded."""
    pipeline = Pipeline.parse("fakesrc num-buffers=3 ! queue ! identity sleep-time=1000 ! fakesink name=out")
    with pipeline:
        pipeline.play()
        assert pipeline.ended.wait(10)
    pipeline.run(timeout_s=10)
    assert pipeline["out"].count == 3


def test_fifty_runs_leave_no_thread() -> None:
    """Start and stop do not leak, in whatever state the frames are."""
    before = set(threading.enumerate())  # those of earlier tests may end meanwhile
    pipeline = Pipeline.parse(
        "fakesrc ! queue max-size-buffers=2 ! tee name=t t. ! queue ! fakesink t. ! queue ! fakesink"
    )
    for _ in range(50):
        with pipeline:
            pipeline.play()
            assert set(threading.enumerate()) - before
        assert set(threading.enumerate()) <= before
    assert str(pipeline.state) == "null"


def test_threads_are_named_after_their_elements() -> None:
    """One per source and per queue, and no daemon among them."""
    with Pipeline.parse("fakesrc name=cam ! queue name=q ! identity ! fakesink") as pipeline:
        pipeline.play()
        ours = [thread for thread in threading.enumerate() if thread.name.startswith("streamkit:")]
        assert sorted(thread.name for thread in ours) == ["streamkit:cam", "streamkit:q"]
        assert not any(thread.daemon for thread in ours)


def test_a_hanging_stop_is_named(register: Register, monkeypatch: pytest.MonkeyPatch) -> None:
    """`stop` returns in time and names the element; the others are stopped."""
    import streamkit.graph.pipeline as module

    monkeypatch.setattr(module, "STOP_LIMIT_S", 0.1)
    release, inside = threading.Event(), threading.Event()

    class Hangs(Sink):
        """Waits for something that watches no stop."""

        sink = "ANY"

        def render(self, frame: Frame) -> None:
            inside.set()
            release.wait(30)

    register(hangs=Hangs)
    journal = register_journaling(register)
    pipeline = Pipeline.parse("jsrc name=src ! queue name=q ! hangs")
    pipeline.play()
    assert inside.wait(10)
    begun = time.monotonic()
    stuck = "hangs0: a call has not returned within 0.1 s of the stop; its thread is abandoned"
    try:
        with pytest.raises(StateError, match=rf"^{stuck}$"):
            pipeline.stop()
        assert time.monotonic() - begun < 5.0
        assert "stop src" in journal
        assert str(pipeline.state) == "null"
        # It takes the place of no other error.
        with pytest.raises(StateError, match=rf"^the pipeline has not ended within 0.2 s\n{stuck}$"):
            pipeline.run(timeout_s=0.2)
    finally:
        release.set()
        for thread in threading.enumerate():
            if thread.name == "streamkit:q":
                thread.join(10)


def test_a_source_without_a_sink_is_an_error() -> None:
    """err-notlinked: the pad is named."""
    with pytest.raises(
        ElementFailure, match=r"^fakesrc0: pad fakesrc0.src is not linked; link it to a sink$"
    ) as caught:
        Pipeline.parse("fakesrc").run(timeout_s=10)
    assert isinstance(caught.value.cause, NotNegotiated)


def test_a_sink_without_a_source_is_an_error() -> None:
    """It would wait for ever: the pad is named before anything starts."""
    with pytest.raises(
        ElementFailure, match=r"^fakesink0: nothing is linked to its pad sink, so no frame can arrive$"
    ):
        Pipeline.parse("fakesink").run(timeout_s=10)


def test_system_exit_in_an_element_is_a_failure(register: Register) -> None:
    """The pipeline ends with an error."""

    class Exits(Sink):
        """Leaves."""

        sink = "ANY"

        def render(self, frame: Frame) -> None:
            raise SystemExit(3)

    register(exits=Exits)
    with pytest.raises(ElementFailure, match="SystemExit: 3"):
        Pipeline.parse("fakesrc ! queue ! exits").run(timeout_s=10)


def test_element_messages_and_warnings_reach_the_bus(register: Register) -> None:
    """With their element's name; fields are for programs."""

    class Talks(Sink):
        """Posts messages."""

        sink = "ANY"

        def render(self, frame: Frame) -> None:
            self.post_message("seen", seq=frame.seq)
            self.post_warning("nothing in it")

    register(talks=Talks)
    pipeline = Pipeline.parse("fakesrc num-buffers=1 ! talks name=t")
    reported: list[tuple[str, str, str, Any]] = []
    pipeline.bus.watch(
        lambda m: reported.append((str(m.kind), m.source, m.text, dict(m.fields))) if m.source else None
    )
    pipeline.run(timeout_s=10)
    assert reported == [
        ("element", "t", "seen", {"name": "seen", "seq": 0}), ("warning", "t", "nothing in it", {}),
    ]  # fmt: skip


def test_a_warning_of_each_subject_comes_once_in_a_run(register: Register) -> None:
    """And once more in the next run."""

    class Complains(Sink):
        """Warns at each frame."""

        sink = "ANY"

        def render(self, frame: Frame) -> None:
            self.warn_once("dirty")
            self.warn_once(f"frame {frame.seq} is dark", "light")

    register(complains=Complains)
    pipeline = Pipeline.parse("fakesrc num-buffers=3 ! complains")
    texts: list[str] = []
    pipeline.bus.watch(lambda message: texts.append(message.text) if str(message.kind) == "warning" else None)
    for _ in range(2):
        pipeline.run(timeout_s=10)
    assert texts == ["dirty", "frame 0 is dark"] * 2


@pytest.mark.parametrize("way", ["run", "wait"])
def test_a_stop_by_another_thread_ends_the_wait(way: str) -> None:
    """A program that waits for the end, without a limit, goes on when its stop button is pressed."""
    pipeline = Pipeline.parse("videotestsrc is-live=true ! fakesink")
    playing = threading.Event()
    pipeline.bus.watch(lambda message: playing.set() if message.text == "playing" else None)
    if way == "wait":
        pipeline.play()
    waiting = threading.Thread(target=getattr(pipeline, way), daemon=True)
    waiting.start()
    assert playing.wait(10)
    pipeline.stop()
    waiting.join(10)
    assert not waiting.is_alive()


def test_the_context_manager_stops_the_pipeline() -> None:
    """Also after an exception of the application."""
    pipeline = Pipeline.parse("fakesrc ! fakesink")

    def block() -> None:
        with pipeline:
            pipeline.play()
            raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        block()
    assert str(pipeline.state) == "null"


@pytest.mark.parametrize(
    "source",
    [
        "videotestsrc is-live=true ! video/x-raw,width=64,height=48,framerate=1/3600",
        "dronetestsrc is-live=true ! video/x-raw,width=320,height=240,framerate=1/3600",
        "fakesrc sizetype=fixed sizemax=10 datarate=1 format=time do-timestamp=true sync=true",
    ],
)
def test_finish_ends_a_wait_for_the_next_frame(source: str) -> None:
    """Frames before it are delivered."""
    with Pipeline.parse(f"{source} ! queue ! appsink name=out") as pipeline:
        pipeline.play()
        assert pipeline["out"].pull() is not None
        pipeline.finish()
        assert pipeline["out"].pull() is None
        ended = pipeline.wait(10)
    assert ended is not None
    assert ended.kind is MessageKind.EOS


def test_live_sources_end_on_finish(register: Register) -> None:
    """`finish` wakes a source that waits, through `interrupt`; EOS then travels behind the last frames."""

    class Waits(Source):
        """One frame, then waits for an interrupt."""

        src = "ANY"
        is_live = True

        def __init__(self, name: str = "", **properties: Any) -> None:
            self.woken = threading.Event()
            super().__init__(name, **properties)

        def frames(self) -> Iterator[Frame]:
            yield Frame(b"", ANYTHING)
            self.woken.wait(30)

        def interrupt(self) -> None:
            self.woken.set()

    register(waits=Waits)
    with Pipeline.parse("waits ! queue ! appsink name=out") as pipeline:
        pipeline.play()
        assert pipeline["out"].pull() is not None
        pipeline.finish()
        assert pipeline["out"].pull() is None
