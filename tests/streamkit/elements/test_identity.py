"""identity: forwards frames; drops, delays, ends or fails on purpose."""

import pytest

from streamkit import Caps, ElementFailure, Frame, MessageKind, Pipeline
from streamkit.testing import Harness

ANYTHING = Caps("a/b")


def test_the_same_frame_comes_out() -> None:
    """id-same: the object itself."""
    first = Frame(b"x", ANYTHING, arrival_ns=1)
    for properties in ({}, {"drop_probability": 0.0, "silent": False}):
        with Harness("identity", **properties) as harness:
            harness.push(first)
            second = Frame(b"y", harness.element.sink_caps, arrival_ns=1)
            (out,) = harness.push(second)
            assert out is second


def test_all_frames_dropped_and_eos_passes() -> None:
    """id-drop: with probability 1 only EOS comes through."""
    pipeline = Pipeline.parse("fakesrc num-buffers=5 ! identity drop-probability=1.0 ! fakesink")
    pipeline.run(timeout_s=10)
    assert pipeline["fakesink0"].count == 0


def test_drops_are_the_same_every_time() -> None:
    """Same input, same seed: the same output; another seed, another."""

    def passed(seed: int) -> list[int]:
        dropping = f"identity drop-probability=0.5 seed={seed}"
        with Pipeline.parse(f"fakesrc num-buffers=50 ! {dropping} ! appsink name=out") as pipeline:
            pipeline.play()
            return [frame.seq for frame in pipeline["out"]]

    assert passed(1) == passed(1)
    assert passed(1) != passed(2)


def test_an_end_on_purpose() -> None:
    """id-after: with eos-after=3 two frames pass, then EOS."""
    pipeline = Pipeline.parse("fakesrc num-buffers=10 ! identity eos-after=3 ! fakesink")
    pipeline.run(timeout_s=10)
    assert pipeline["fakesink0"].count == 2


def test_an_end_on_purpose_behind_a_decoder() -> None:
    """The frames that a decoder still holds at the end are refused, too, and none counts as passed on."""
    text = (
        "videotestsrc num-buffers=30 ! encode ! decode ! identity name=last eos-after=10 ! fakesink name=out"
    )
    with Pipeline.parse(text) as pipeline:
        pipeline.run(timeout_s=30)
        passed = {row.element: row.frames_in for row in pipeline.statistics()}
    assert passed["last"] > 10  # else nothing was held
    assert passed["out"] == pipeline["out"].count == 9


def test_an_error_on_purpose() -> None:
    """id-after: with error-after=3 two frames pass, then the element fails."""
    pipeline = Pipeline.parse("fakesrc num-buffers=10 ! identity error-after=3 ! fakesink")
    with pytest.raises(
        ElementFailure,
        match=r"^identity0: error-after=3: the frame at which to fail has come \[at frame seq=2\]$",
    ):
        pipeline.run(timeout_s=10)
    assert pipeline["fakesink0"].count == 2


def test_it_reports_frames_unless_silent() -> None:
    """A message for each frame, with number, time and caps."""
    with Harness("identity", silent=False) as harness:
        harness.push(Frame(b"", ANYTHING, seq=4, pts=7))
        reported = [m.fields for m in harness.messages if m.kind is MessageKind.ELEMENT]
    assert reported == [{"name": "frame", "seq": 4, "pts": 7, "caps": "a/b"}]


def test_a_delay_ends_with_the_stop() -> None:
    """id-stop: with a delay of an hour per frame."""
    with Pipeline.parse("fakesrc ! identity name=i sleep-time=3600000000 ! fakesink") as pipeline:
        pipeline.play()
    assert str(pipeline.state) == "null"
