"""Watchdog: a hanging element is named with its frame; elements that wait on purpose are ignored."""

import re
import threading
import time
from collections.abc import Callable, Iterator
from types import SimpleNamespace

import pytest

from streamkit import ElementFailure, Frame, Message, MessageKind, Pipeline, Property, Sink, Transform
from streamkit.graph.element_calls import Watchdog
from streamkit.graph.pipeline import State

Register = Callable[..., None]


class Stuck(Transform):
    """Does not return from one of its calls until it is released."""

    sink = src = "ANY"
    release = threading.Event()
    inside = threading.Event()
    where: str = Property("transform", doc="In which call.")

    def _hang(self, where: str) -> None:
        if where == self.where:
            self.inside.set()
            self.release.wait(60)

    def start(self) -> None:
        self._hang("start")

    def stop(self) -> None:
        self._hang("stop")

    def drain(self) -> tuple[Frame, ...]:
        self._hang("drain")
        return ()

    def transform(self, frame: Frame) -> Frame:
        if frame.seq == 2:
            self._hang("transform")
        return frame


@pytest.fixture(autouse=True)
def _released(register: Register) -> Iterator[None]:
    register(stuck=Stuck)
    Stuck.release.clear()
    Stuck.inside.clear()
    yield
    Stuck.release.set()


def next_warning(pipeline: Pipeline) -> Message:
    """The next warning on the bus."""
    found = pipeline.bus.pop(20, (MessageKind.WARNING,))
    assert found is not None
    return found


@pytest.mark.parametrize(
    "text", ["stuck name=s", "queue ! stuck name=s", "identity silent=false ! stuck name=s"]
)
def test_a_hanging_element_ends_the_pipeline(text: str) -> None:
    """It is named, not one upstream of it."""
    with Pipeline.parse(f"fakesrc num-buffers=9 ! {text} ! fakesink", watchdog_s=0.2) as pipeline:
        pipeline.play()
        message = pipeline.wait(20)
        Stuck.release.set()
    assert message is not None
    assert isinstance(message.error, ElementFailure)
    assert re.match(r"s \(stuck\): the call with a frame .* 0.2 s.*\[at frame seq=2\]$", message.text)


def test_a_long_drain_is_reported_and_continues() -> None:
    """What may take its time, as a mosaic at the end, is a warning; the run ends well."""
    with Pipeline.parse(
        "fakesrc num-buffers=3 ! stuck name=s where=drain ! fakesink", watchdog_s=0.2
    ) as pipeline:
        pipeline.play()
        warning = next_warning(pipeline)
        assert (warning.source, warning.fields["code"]) == ("s", "watchdog")
        assert warning.text.startswith("`drain` has not returned for 0.2 s")
        Stuck.release.set()
        message = pipeline.wait(20)
        assert message is not None
        assert message.kind is MessageKind.EOS


def test_waiting_on_purpose_is_no_hang(register: Register) -> None:
    """A sink that waits for time, a full queue, and a source without frames."""

    class Slow(Sink):
        """Waits as long as several limits."""

        sink = "ANY"

        def render(self, frame: Frame) -> None:
            with self.waiting():
                self.stopping.wait(1.0)

    register(slow=Slow)
    text = "fakesrc num-buffers=3 ! queue max-size-buffers=1 ! slow"
    with Pipeline.parse(text, watchdog_s=0.2) as pipeline:
        pipeline.run(timeout_s=30)
    with Pipeline.parse("appsrc name=in ! fakesink", watchdog_s=0.2) as pipeline:
        pipeline.play()
        assert pipeline.wait(1.0) is None


def test_a_hanging_stop_is_abandoned(monkeypatch: pytest.MonkeyPatch) -> None:
    """`stop` returns in time, names the element, and the others have been stopped."""
    monkeypatch.setattr("streamkit.graph.pipeline.STOP_LIMIT_S", 0.3)
    pipeline = Pipeline.parse("fakesrc num-buffers=3 ! stuck name=s where=stop ! fakesink", watchdog_s=0.2)
    pipeline.play()
    pipeline.wait(20)
    began = time.monotonic()
    with pytest.raises(RuntimeError, match=r"^s: a call has not returned"):
        pipeline.stop()
    assert time.monotonic() - began < 10
    assert pipeline.state is State.NULL


def test_a_long_start_is_no_hang() -> None:
    """The first one on a machine may compile; the warning says how to have that done before."""
    pipeline = Pipeline.parse("fakesrc num-buffers=1 ! stuck name=s where=start ! fakesink", watchdog_s=0.2)
    playing = threading.Thread(target=pipeline.play)
    playing.start()
    warning = next_warning(pipeline)
    Stuck.release.set()
    playing.join(20)
    assert warning.text.startswith("`start` takes more than 0.2 s; ")
    assert "streamkit prepare" in warning.text
    pipeline.run(timeout_s=20)


def test_a_start_can_be_cancelled() -> None:
    """From another thread, as by a signal; what had started has been stopped."""
    pipeline = Pipeline.parse("fakesrc ! stuck name=s where=start ! fakesink name=k")

    def cancel() -> None:
        Stuck.inside.wait(20)
        pipeline.cancel()
        time.sleep(0.2)  # the call comes back some time later, as one that was interrupted does
        Stuck.release.set()

    canceller = threading.Thread(target=cancel)
    canceller.start()
    with pytest.raises(ElementFailure, match=r"^s \(stuck\): its start was interrupted$"):
        pipeline.play()
    canceller.join(20)
    assert pipeline.state is State.NULL
    assert not pipeline["k"].is_playing


def test_a_start_that_ignores_cancel_is_abandoned(monkeypatch: pytest.MonkeyPatch) -> None:
    """The error names the element."""
    monkeypatch.setattr("streamkit.graph.element_calls.CANCEL_GRACE_S", 0.2)
    pipeline = Pipeline.parse("fakesrc ! stuck name=s where=start ! fakesink")
    canceller = threading.Thread(target=lambda: Stuck.inside.wait(20) and pipeline.cancel())
    canceller.start()
    with pytest.raises(ElementFailure, match=r"^s \(stuck\): its start has not returned .* abandoned$"):
        pipeline.play()
    canceller.join(20)


def test_active_elements_are_marked_during_calls() -> None:
    """One byte per element, for the crash report."""
    pipeline = Pipeline.parse(
        "fakesrc num-buffers=9 name=f ! queue ! identity name=i ! stuck name=s ! fakesink"
    )
    with pipeline:
        pipeline.play()
        assert Stuck.inside.wait(20)
        marks = {element.name: bytes(element.at_work) for element in pipeline.graph.elements}
        assert (marks["s"], marks["i"]) == (b"1", b"0")
        Stuck.release.set()
        pipeline.wait(20)
        assert {bytes(element.at_work) for element in pipeline.graph.elements} == {b"0"}


def test_the_watchdog_may_wait_for_the_one_that_stops_it() -> None:
    """As where the program has ended, and another thread stops the pipeline at the same time."""
    element, inside, release = Stuck(), threading.Event(), threading.Event()
    element.enter("frame", 0)

    def fail(_: Exception) -> None:
        inside.set()
        release.wait(60)

    pipeline = SimpleNamespace(watchdog_s=0.01, graph=SimpleNamespace(elements=[element]))
    watchdog = Watchdog(SimpleNamespace(pipeline=pipeline, fail=fail))
    watchdog.start()
    assert inside.wait(20)
    watchdog.stop()
    assert not release.is_set()
    release.set()
