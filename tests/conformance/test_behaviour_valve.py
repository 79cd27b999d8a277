"""valve, as behaviour.md tells."""

from typing import Any

import pytest

from streamkit import Caps, Event, Frame, FrameFlags, Pipeline
from streamkit.element.pad import Pad
from streamkit.element.sink import Sink
from streamkit.flow.events import EOS, CapsEvent, GapEvent, Segment, SegmentEvent
from streamkit.testing import Harness

A = Caps("a/b")
SECOND = 1_000_000_000


def frame(number: int, **fields: Any) -> Frame:
    """A frame."""
    return Frame(b"", A, seq=number, arrival_ns=1, **fields)


class Notes(Sink):
    """Notes what comes."""

    sink = "ANY"

    def __init__(self) -> None:
        super().__init__("notes")
        self.seen: list[Any] = []

    def render(self, frame: Frame) -> None:
        """Notes it."""
        self.seen.append(frame.seq)

    def receive_event(self, pad: Pad, event: Event) -> None:
        """Notes it."""
        self.seen.append(event)


def noted(harness: Harness) -> list[Any]:
    """Puts a sink that notes everything behind a valve; what it has seen."""
    notes = Notes()
    src = harness.element.pads["src"]
    src.unlink()
    src.link(notes.pads["sink"])
    src.push = notes.render
    return notes.seen


def test_open_and_closed() -> None:
    """v-basic: two frames pass, two pushes into the closed valve return and nothing arrives."""
    harness = Harness("valve")
    assert [out.seq for n in range(2) for out in harness.push(frame(n))] == [0, 1]
    harness.element.set_property("drop", True)
    assert [harness.push(frame(n)) for n in range(2, 4)] == [[], []]
    assert harness.element.drops == {"valve closed": 2}


def test_opening_sends_nothing_by_itself() -> None:
    """v-sticky: caps and segment that met the closed valve come out just before the next frame."""
    harness = Harness("valve", drop=True)
    seen = noted(harness)
    sink = harness.element.pads["sink"]
    segment = SegmentEvent(Segment(5))
    sink.receive_event(CapsEvent(A))
    sink.receive_event(segment)
    harness.element.set_property("drop", False)
    assert seen == []
    result: Any = harness.element
    out = result.transform(frame(0, pts=5))
    assert seen == [CapsEvent(A), segment]
    assert out.seq == 0


@pytest.mark.parametrize(
    ("mode", "expected"),
    [
        ("drop-all", []),
        ("forward-sticky-events", [CapsEvent(A), SegmentEvent(Segment(0)), EOS]),
        ("transform-to-gap",
         [CapsEvent(A), SegmentEvent(Segment(0)), GapEvent(0, SECOND), GapEvent(SECOND, SECOND), EOS]),
    ],
)  # fmt: skip
def test_modes_of_a_closed_valve(mode: str, expected: list[Event]) -> None:
    """v-modes: nothing, the events with EOS, or a gap for each frame."""
    harness = Harness("valve", drop=True, drop_mode=mode)
    seen = noted(harness)
    for number in range(2):
        harness.push(frame(number, pts=number * SECOND, duration=SECOND))
    harness.drain()
    assert seen == expected


def test_a_closed_valve_never_prerolls() -> None:
    """v-modes: with drop-all not even EOS comes, with gaps the sink prerolls on them."""
    for mode, is_prerolled in (("drop-all", False), ("transform-to-gap", True)):
        text = f"fakesrc num-buffers=3 ! valve drop=true drop-mode={mode} ! fakesink"
        with Pipeline.parse(text) as pipeline:
            pipeline.pause()
            assert pipeline.wait_prerolled(10.0 if is_prerolled else 0.2) is is_prerolled


def test_the_first_frame_after_opening_is_marked() -> None:
    """v-discont: the stream was interrupted there, and only there."""
    harness = Harness("valve")
    flags = []
    for number in range(6):
        harness.element.set_property("drop", number in (2, 3))
        flags += [out.flags & FrameFlags.DISCONTINUITY for out in harness.push(frame(number))]
    assert flags == [0, 0, FrameFlags.DISCONTINUITY, 0]
