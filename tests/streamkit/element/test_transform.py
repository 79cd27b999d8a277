"""Transforms: negotiation, number of output frames, EOS and errors."""

from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np
import pytest

from streamkit import (
    Caps,
    Combine,
    Direction,
    DiscontinuityEvent,
    ElementFailure,
    Event,
    Frame,
    PadTemplate,
    Pipeline,
    Property,
    Segment,
    SegmentEvent,
    Transform,
)
from streamkit.testing import Harness
from tests.frames import frames_of

RAW = Caps("video/x-raw, format=GRAY8, width=4, height=2")
Register = Callable[..., None]


def frame(seq: int = 0, caps: Caps = RAW, **fields: int) -> Frame:
    """A frame without content."""
    return Frame(b"", caps, seq=seq, arrival_ns=1, **fields)


class Passing(Transform):
    """Records its calls."""

    sink = src = "video/x-raw"

    def start(self) -> None:
        self.reported: list[object] = []

    def configure(self, sink_caps: Caps, src_caps: Caps) -> None:
        self.reported.append((str(sink_caps), str(src_caps)))

    def event(self, event: Event) -> None:
        self.reported.append(event)

    def transform(self, frame: Frame) -> Frame:
        self.reported.append(frame.seq)
        return frame


class Halves(Transform):
    """Two frames out of one, half as wide."""

    sink = "video/x-raw, width=[ 2, 100 ]"
    src = "video/x-raw, width=[ 1, 50 ]"

    def transform_caps(self, caps: Caps, direction: str) -> Caps:
        return caps.without_fields("width")

    def fixate(self, sink_caps: Caps, allowed: Caps) -> Caps:
        return sink_caps.with_fields(width=sink_caps.integer("width") // 2)

    def transform(self, frame: Frame) -> Iterator[Frame]:
        for _ in range(2):
            yield frame.replace(caps=self.src_caps)


def test_configure_comes_before_the_first_frame_and_again_with_new_caps() -> None:
    """Events and frames reach an element in the order they were sent."""
    wider = RAW.with_fields(width=8)
    with Harness(Passing()) as harness:
        harness.push(frame(0))
        harness.push(frame(1))
        harness.push(frame(2, wider))
        harness.push(frame(3, wider, epoch=1))
        reported = harness.element.reported  # type: ignore[attr-defined]
    assert reported == [
        (str(RAW), str(RAW)), SegmentEvent(Segment()), 0, 1,
        (str(wider), str(wider)), 2, DiscontinuityEvent(1), SegmentEvent(Segment()), 3,
    ]  # fmt: skip


def test_several_output_frames_are_sent_in_order(register: Register) -> None:
    """A generator may yield any number of frames."""
    register(halves=Halves)
    frames = frames_of("fakesrc num-buffers=3 ! video/x-raw,width=8 ! halves ! halves")
    assert [f.seq for f in frames] == [0] * 4 + [1] * 4 + [2] * 4
    assert {f.caps["width"] for f in frames} == {2}


def test_none_sends_no_frame() -> None:
    """A transform may drop a frame."""

    class Every2nd(Transform):
        """Even numbers."""

        sink = src = "ANY"

        def transform(self, frame: Frame) -> Frame | None:
            return None if frame.seq % 2 else frame

    with Harness(Every2nd()) as harness:
        assert [f.seq for n in range(4) for f in harness.push(frame(n))] == [0, 2]


class HoldsBack(Transform):
    """Gives each frame when the next comes."""

    sink = src = "ANY"

    def start(self) -> None:
        self.held: list[Frame] = []

    def transform(self, frame: Frame) -> Frame | None:
        self.held.append(frame)
        return self.held.pop(0) if len(self.held) > 1 else None

    def drain(self) -> Iterable[Frame]:
        while self.held:
            yield self.held.pop(0)


def test_drained_frames_precede_eos(register: Register) -> None:
    """Frames held by two elements are sent in order, then EOS."""
    register(holdsback=HoldsBack)
    with Pipeline.parse(
        "fakesrc num-buffers=5 ! holdsback ! queue ! holdsback ! appsink name=out"
    ) as pipeline:
        pipeline.play()
        assert [f.seq for f in pipeline["out"]] == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("number", [0, 63, 64])
def test_an_exception_names_element_frame_and_cause(register: Register, number: int) -> None:
    """With and without `sync`, at the first frame or later."""

    class Fails(Transform):
        """Fails at one frame."""

        sink = src = "ANY"
        at: int = Property(0)

        def transform(self, frame: Frame) -> Frame:
            if frame.seq == self.at:
                raise ZeroDivisionError("division by zero")
            return frame

    register(fails=Fails)
    with pytest.raises(ElementFailure) as caught:
        Pipeline.parse(f"fakesrc num-buffers=100 ! identity ! fails at={number} ! fakesink").run(timeout_s=20)
    assert str(caught.value) == f"fails0: ZeroDivisionError: division by zero [at frame seq={number}]"
    assert caught.value.frame == f"frame seq={number}"
    assert isinstance(caught.value.cause, ZeroDivisionError)


@pytest.mark.parametrize("moment", ["configure", "drain", "event"])
def test_exceptions_outside_transform_name_the_element(register: Register, moment: str) -> None:
    """In every other call."""

    class Fails(Passing):
        """Fails at one moment."""

        def configure(self, sink_caps: Caps, src_caps: Caps) -> None:
            if moment == "configure":
                raise ValueError("no such size")

        def drain(self) -> Iterable[Frame]:
            if moment == "drain":
                raise ValueError("no such size")
            return ()

        def event(self, event: Event) -> None:
            if moment == "event":
                raise ValueError("no such size")

    def live(harness: Harness) -> None:
        harness.push(frame(0))
        harness.push(frame(1, epoch=1))
        harness.drain()

    with (
        Harness(Fails("f")) as harness,
        pytest.raises(ElementFailure, match=r"^f \(fails\): ValueError: no such size"),
    ):
        live(harness)


@pytest.mark.parametrize("wrong", [[b"row", b"row"], 3, "text"])
def test_a_result_that_is_no_frame_is_refused(wrong: object) -> None:
    """The error says what to return and what was returned."""

    class Forgetful(Transform):
        """Returns bare data."""

        sink = src = "ANY"

        def transform(self, frame: Frame) -> Frame:
            return wrong  # type: ignore[return-value]

    with (
        Harness(Forgetful("f")) as harness,
        pytest.raises(ElementFailure, match=r"^f \(forgetful\): TypeError: .*"),
    ):
        harness.push(frame())


def test_downstream_preference_reaches_upstream() -> None:
    """An element that keeps caps offers upstream what its peer accepts."""
    with Harness(Passing(), downstream="video/x-raw, format={ NV12, GRAY8 }") as harness:
        offered = harness.element.pads["sink"].query_caps()
    assert str(offered) == "video/x-raw, format=(string){ NV12, GRAY8 }"


def test_a_conversion_offers_its_own_templates() -> None:
    """With other templates on both sides any of them is possible; downstream chooses near the input."""

    class Convert(Transform):
        """Any format to another."""

        sink = "video/x-raw, format={ GRAY8, BGR }"
        src = "video/x-raw, format={ RGB, BGR }"

        def configure(self, sink_caps: Caps, src_caps: Caps) -> None:
            self.agreed = (sink_caps.get("format"), src_caps.get("format"))

        def transform(self, frame: Frame) -> Frame:
            return frame.replace(caps=self.src_caps)

    with Harness(Convert()) as harness:
        harness.push(frame(0, RAW.with_fields(format="BGR")))
        assert harness.element.agreed == ("BGR", "BGR")  # type: ignore[attr-defined]
        harness.push(frame(1, RAW))
        assert harness.element.agreed == ("GRAY8", "RGB")  # type: ignore[attr-defined]


def test_caps_may_be_known_with_the_first_frame_only() -> None:
    """`fixate` gives None: the frame's own caps are then checked and sent on before it."""

    class Decoder(Transform):
        """Only the data tells."""

        sink, src = "video/x-h264", "video/x-raw"

        def fixate(self, sink_caps: Caps, allowed: Caps) -> Caps | None:
            return None

        def transform(self, frame: Frame) -> Frame:
            return frame.replace(caps=RAW)

    coded = Caps("video/x-h264")
    with Harness(Decoder()) as harness:
        (out,) = harness.push(frame(0, coded))
        assert out.caps == RAW
        assert harness.element.src_caps == RAW
    with (
        Harness(Decoder(), downstream="video/x-raw, width=9") as harness,
        pytest.raises(Exception, match="disagree on width"),
    ):
        harness.push(frame(0, coded))


def test_a_passthrough_element_is_bypassed(register: Register) -> None:
    """Frames do not reach `transform`."""

    class Absent(Passing):
        """Does nothing."""

        def is_passthrough(self) -> bool:
            return True

    register(absent=Absent)
    with Pipeline.parse(
        "fakesrc num-buffers=2 ! video/x-raw,width=1 ! absent name=a ! appsink name=out"
    ) as pipeline:
        pipeline.play()
        assert len(list(pipeline["out"])) == 2
        assert 0 not in pipeline["a"].reported


def test_a_transform_without_its_method_says_so(register: Register) -> None:
    """As after a misspelt name."""

    class Misspelt(Transform):
        """Passes frames on, or not."""

        sink = src = "ANY"

        def tranform(self, frame: Frame) -> Frame:
            return frame

    register(misspelt=Misspelt)
    with pytest.raises(ElementFailure, match="Misspelt does not define transform"):
        Pipeline.parse("fakesrc num-buffers=1 ! misspelt ! fakesink").run(timeout_s=20)


@pytest.mark.parametrize(
    ("returned", "rule"),
    [
        (5, "transform returns a Frame, several, or None, got int: put data"),
        ([5], "transform returns a Frame, several, or None, got list of int: put data"),
        (("side", Frame(b"", Caps("a/b"))), 'got tuple of str: for another pad, write yield "side", frame'),
        ([("aside", Frame(b"", Caps("a/b")))], "'aside', which Answering does not declare; it has src, side"),
    ],
)
def test_what_no_pad_can_take_is_an_error(register: Register, returned: object, rule: str) -> None:
    """It would be lost without a word."""

    class Answering(Transform):
        """Answers each frame."""

        sink = src = "ANY"
        templates = (PadTemplate("side", Direction.SRC, Caps("ANY")),)

        def transform(self, frame: Frame) -> Any:
            return returned

    register(answering=Answering)
    with pytest.raises(ElementFailure, match=rule):
        Pipeline.parse("fakesrc num-buffers=1 ! answering ! fakesink").run(timeout_s=20)


class Draining(Transform):
    """Returns its frames at EOS, each through both src pads."""

    sink = src = "ANY"
    templates = (PadTemplate("side", Direction.SRC, Caps("ANY")),)

    def start(self) -> None:
        self.kept: list[Frame] = []

    def transform(self, frame: Frame) -> None:
        self.kept.append(frame)

    def drain(self) -> Iterator[Frame | tuple[str, Frame]]:
        for kept in self.kept:
            yield kept
            yield "side", kept


def test_eos_follows_frames_that_downstream_refuses(register: Register) -> None:
    """Else the threads behind would wait for it for ever."""
    register(draining=Draining)
    text = (
        "fakesrc num-buffers=5 ! draining name=d ! fakesink num-buffers=2  d.side ! queue ! fakesink name=out"
    )
    with Pipeline.parse(text) as pipeline:
        pipeline.run(timeout_s=20)
        assert pipeline["out"].pads["sink"].is_eos


def test_frames_of_drain_are_checked_as_those_of_transform() -> None:
    """An array that is not what the caps say fails the element, not the one behind it."""

    class Late(Passing):
        def drain(self) -> Iterable[Frame]:
            return (Frame(np.zeros((4, 2), np.uint8), RAW),)

    with Harness(Late("late")) as harness:
        harness.push(frame())
        with pytest.raises(ElementFailure, match=r"^late: ValueError: GRAY8 of 4 x 2 px is uint8\[2, 4\]"):
            harness.drain()


def test_a_drain_that_returns_none_has_nothing() -> None:
    """As a `transform` that does."""

    class Silent(Passing):
        def drain(self) -> None:
            return None

    with Harness(Silent("silent")) as harness:
        harness.push(frame())
        assert harness.drain() == []


@pytest.mark.parametrize("base", [Transform, Combine])
def test_one_frame_of_drain_is_an_error_with_the_rule(register: Register, base: type) -> None:
    """`return` where `yield` is meant."""

    class Holding(base):  # type: ignore[misc]
        """Holds a frame until the end."""

        sink = src = "ANY"

        def transform(self, frame: Frame) -> None:
            self.held = frame

        def combine(self, pad_name: str, frame: Frame) -> None:
            self.held = frame

        def drain(self) -> Any:
            return self.held

    register(holding=Holding)
    with pytest.raises(
        ElementFailure, match="drain returns several frames, got one Frame: write yield frame"
    ):
        Pipeline.parse("fakesrc num-buffers=1 ! holding ! fakesink").run(timeout_s=20)


def test_a_class_without_pads_is_refused() -> None:
    """Its author forgot them, and would read that the pipeline's link has no pad."""
    with pytest.raises(
        TypeError, match=r'^Bare declares no pads: write sink = src = "video/x-raw" in the class$'
    ):
        type("Bare", (Transform,), {})()
