"""valve: forwards or drops frames; the cases are GStreamer's."""

from streamkit import ANY, Frame, FrameFlags, Pipeline, raw_video_caps
from streamkit.testing import Harness


def frame(number: int) -> Frame:
    """A numbered frame without content."""
    return Frame(b"", ANY, seq=number)


def test_open_passes_and_closed_drops() -> None:
    """Open, frames pass; closed, pushes succeed and nothing arrives, and each drop is counted."""
    with Harness("valve") as harness:
        assert [f.seq for n in range(2) for f in harness.push(frame(n))] == [0, 1]
        harness.element.set_property("drop", True)
        assert [f for n in range(2, 4) for f in harness.push(frame(n))] == []
        assert harness.element.drops["valve closed"] == 2


def test_first_frame_after_opening_is_a_discontinuity() -> None:
    """Only the first frame has the flag."""
    with Harness("valve", drop=True) as harness:
        harness.push(frame(0))
        harness.element.set_property("drop", False)
        first, second = harness.push(frame(1)) + harness.push(frame(2))
        assert first.flags & FrameFlags.DISCONTINUITY
        assert not second.flags & FrameFlags.DISCONTINUITY


def test_held_caps_precede_the_next_frame() -> None:
    """Opening sends nothing; the latest caps are sent with the next frame."""
    caps = raw_video_caps("GRAY8", 2, 2)
    with Harness("valve", drop=True) as harness:
        src = harness.element.pads["src"]
        harness.push(Frame(b"", caps))
        assert src.caps is None
        harness.element.set_property("drop", False)
        assert src.caps is None
        harness.push(Frame(b"", caps))
        assert src.caps == caps


def test_a_closed_valve_forwards_eos_if_set_to() -> None:
    """forward-sticky-events: no frame passes, EOS does."""
    with Pipeline.parse(
        "fakesrc num-buffers=3 ! valve drop=true drop-mode=forward-sticky-events ! fakesink name=end"
    ) as pipeline:
        pipeline.run(10)
        assert pipeline["end"].count == 0
