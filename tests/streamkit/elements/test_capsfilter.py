"""capsfilter: restricts the caps of a link."""

import pytest

from streamkit import Caps, Frame, NotNegotiated, Pipeline
from streamkit.errors import ElementFailure
from streamkit.testing import Harness


def test_fixed_caps_are_given_to_a_source_without_caps() -> None:
    """cf-unfixed."""
    with Pipeline.parse("fakesrc num-buffers=1 ! video/x-raw, width=4 ! appsink name=out") as pipeline:
        pipeline.play()
        (frame,) = pipeline["out"]
    assert frame.caps == Caps("video/x-raw, width=4")


def test_caps_that_are_not_fixed_are_refused() -> None:
    """cf-unfixed: a source that accepts anything cannot choose; the error names the remedy."""
    with pytest.raises(
        (NotNegotiated, ElementFailure),
        match="do not completely specify the output format; give every field one value",
    ):
        Pipeline.parse("fakesrc num-buffers=1 ! video/x-raw, width=[ 1, 9 ] ! fakesink").run(timeout_s=10)


def test_frames_of_other_caps_do_not_pass() -> None:
    """cf-wrong, cf-accept: the pads and the field in conflict are named."""
    with Harness("capsfilter", caps="a/b, x=1") as harness:
        assert len(harness.push(Frame(b"", Caps("a/b, x=1, y=2")))) == 1
        with pytest.raises(NotNegotiated, match="disagree on x"):
            harness.push(Frame(b"", Caps("a/b, x=2")))


def test_its_order_is_the_preference() -> None:
    """What it offers upstream keeps the filter's order, and both sides bound it."""
    with Harness("capsfilter", caps="a/b, f={ z, y, x }", downstream="a/b, f={ x, z }") as harness:
        assert str(harness.element.pads["sink"].query_caps()) == "a/b, f=(string){ z, x }"


def test_without_caps_everything_passes() -> None:
    """cf-prop: the default is ANY."""
    with Harness("capsfilter") as harness:
        assert harness.element.caps.is_any  # type: ignore[attr-defined]
        assert len(harness.push(Frame(b"", Caps("c/d")))) == 1
