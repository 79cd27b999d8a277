"""Harness."""

from typing import Any

import pytest

from streamkit import (
    Caps,
    CapsEvent,
    Direction,
    Element,
    EndOfStream,
    Event,
    Frame,
    GapEvent,
    PadTemplate,
    Presence,
    Property,
    PropertyError,
    Split,
    StateError,
    StreamkitError,
    Transform,
)
from streamkit.flow.caps import ANY
from streamkit.testing import Harness, ManualClock

ANYTHING = Caps("a/b")


class Lifecycle(Transform):
    """Notes its life."""

    sink = src = "ANY"
    gain: float = Property(1.0)

    def start(self) -> None:
        self.life = [f"start at {self.clock_ns()}"]

    def transform(self, frame: Frame) -> Frame:
        self.life.append(f"frame {frame.seq}")
        self.post_warning("careful")
        return frame

    def stop(self) -> None:
        self.life.append(f"stop, stopping {self.stopping.is_set()}")


def test_an_element_runs_as_in_a_pipeline() -> None:
    """Started, fed, drained and stopped in this thread, with the given clock; messages are collected."""
    element = Lifecycle("l")
    with Harness(element, clock=ManualClock(42)) as harness:
        (out,) = harness.push(Frame(b"", ANYTHING, seq=7))
        assert harness.drain() == []
    assert out.seq == 7
    assert element.life == ["start at 42", "frame 7", "stop, stopping True"]
    assert [(message.source, message.text) for message in harness.messages] == [
        ("l", "careful"),
        ("collect_src", ""),
    ]


def test_an_element_by_its_type_takes_properties() -> None:
    """As in a description; a wrong one is refused."""
    with Harness("identity", drop_probability=1.0) as harness:
        assert harness.push(Frame(b"", ANYTHING)) == []
    with pytest.raises(PropertyError, match="identity has no property 'gain'"):
        Harness("identity", gain=1.0)


def test_only_live_properties_change_once_it_is_started() -> None:
    """The rule of a playing pipeline."""
    with Harness(Lifecycle()) as harness, pytest.raises(PropertyError, match="cannot change while playing"):
        harness.element.set_property("gain", 2.0)


def test_downstream_bounds_what_is_negotiated() -> None:
    """The caps given stand behind every src pad."""
    with Harness(Lifecycle(), downstream="a/b, x=1") as harness:
        assert harness.element.pads["src"].peer_caps() == Caps("a/b, x=1")
        with pytest.raises(StreamkitError, match="disagree on x"):
            harness.push(Frame(b"", Caps("a/b, x=2")))


def test_several_pads_are_fed_and_collected() -> None:
    """Request pads are made; frames come out of all src pads."""

    class Copies(Split):
        """One to each output."""

        sink = "ANY"
        templates = (
            PadTemplate("left", Direction.SRC, ANY),
            PadTemplate("src_%u", Direction.SRC, ANY, Presence.REQUEST),
        )

        def split(self, frame: Frame) -> dict[str, Frame]:
            return {pad.name: frame.replace(data=pad.name) for pad in self.src_pads()}

    with Harness(Copies()) as harness:
        assert [frame.data for frame in harness.push(Frame(b"", ANYTHING))] == ["left", "src_0"]


def test_signals_reach_the_test() -> None:
    """An element that ends the stream does so visibly."""
    with Harness("identity", eos_after=1) as harness, pytest.raises(EndOfStream):
        harness.push(Frame(b"", ANYTHING))


def test_a_failed_start_is_stopped() -> None:
    """As in a pipeline `stop` runs once `start` began, and the test sees the error."""

    class Fails(Lifecycle):
        """Cannot start."""

        def start(self) -> None:
            super().start()
            raise OSError("no device")

    element: Element = Fails()
    with pytest.raises(OSError, match="no device"):
        Harness(element)
    assert element.life[-1].startswith("stop")  # type: ignore[attr-defined]


def test_a_closed_harness_refuses_frames() -> None:
    """Closing twice is allowed."""
    harness = Harness("identity")
    harness.close()
    harness.close()
    with pytest.raises(StreamkitError, match=r"^the harness is closed$"):
        harness.push(Frame(b"", ANYTHING))


def test_added_pads_are_connected() -> None:
    """While frames flow."""

    class Unpacks(Split):
        """Adds an output for each kind of data it meets."""

        sink = "ANY"
        templates = (PadTemplate("kind_%u", Direction.SRC, ANY, Presence.SOMETIMES),)

        def split(self, frame: Frame) -> dict[str, Frame]:
            name = f"kind_{frame.data}"
            if name not in self.pads:
                self.add_pad("kind_%u", name)
                self.pads[name].send_event(CapsEvent(frame.caps))
            if frame.data == 1:
                self.no_more_pads()
            return {name: frame}

    with Harness(Unpacks()) as harness:
        assert not list(harness.element.src_pads())
        assert len(harness.push(Frame(0, ANYTHING))) == 1
        assert not harness.has_all_pads
        assert len(harness.push(Frame(1, ANYTHING))) == 1
        assert harness.has_all_pads
        assert [pad.name for pad in harness.element.src_pads()] == ["kind_0", "kind_1"]


def test_reconfigure_renegotiates_before_the_next_frame() -> None:
    """Also with the same caps."""

    class Changes(Transform):
        """Configured how often."""

        sink = src = "ANY"
        configured = 0

        def configure(self, sink_caps: Caps, src_caps: Caps) -> None:
            self.configured += 1

        def transform(self, frame: Frame) -> Frame:
            return frame

    element = Changes()
    with Harness(element) as harness:
        for _ in range(2):
            harness.push(Frame(b"", ANYTHING))
        assert element.configured == 1
        element.reconfigure()
        harness.push(Frame(b"", ANYTHING))
    assert element.configured == 2


def test_events_pass_through_an_element() -> None:
    """In order with the frames; a flush as well, after which frames are welcome again."""

    class Listens(Transform):
        """Remembers events."""

        sink = src = "ANY"

        def start(self) -> None:
            self.heard: list[type] = []

        def event(self, event: Event) -> None:
            self.heard.append(type(event))

        def transform(self, frame: Frame) -> Frame:
            return frame

    element = Listens()
    with Harness(element) as harness:
        harness.push(Frame(b"", ANYTHING))
        harness.send(GapEvent(5))
        harness.flush()
        assert len(harness.push(Frame(b"", ANYTHING))) == 1
    assert GapEvent in element.heard
    assert element.heard.index(GapEvent) < len(element.heard) - 1


def test_a_sink_reports_that_it_has_finished() -> None:
    """After EOS, when everything is drained."""
    with Harness("fakesink") as harness:
        harness.push(Frame(b"", ANYTHING))
        assert not harness.has_ended
        harness.drain()
        assert harness.has_ended


def test_what_cannot_be_pushed_or_run_is_named() -> None:
    """An author's first mistakes: an array, another pad, a source, a class."""
    frame: Any = Frame(b"", ANYTHING)
    with Harness("identity") as one, pytest.raises(TypeError, match="push takes a Frame, got bytes: write"):
        one.push(frame.data)
    with Harness("funnel") as one, pytest.raises(StateError, match="no sink pad 'sink'; it has funnelpad0"):
        one.push(frame)
    with Harness("fakesrc") as one, pytest.raises(StateError, match="none: a source runs in a Pipeline"):
        one.push(frame)
    unsuitable: Any = Lifecycle
    with pytest.raises(TypeError, match="takes the name of an element, or an instance, got <class"):
        Harness(unsuitable)
