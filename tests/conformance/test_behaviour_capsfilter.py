"""capsfilter and negotiation through it, as behaviour.md tells."""

import pytest

from streamkit import Caps, ElementFailure, Frame, NotNegotiated, Pipeline
from streamkit.elements.capsfilter import CapsFilter
from streamkit.flow.events import CapsEvent, GapEvent, Segment, SegmentEvent
from streamkit.testing import Harness


def frame(caps: str, number: int = 0) -> Frame:
    """A frame of some caps."""
    return Frame(b"", Caps(caps), seq=number, arrival_ns=1)


def test_the_property() -> None:
    """cf-prop: set, replaced, and taken away, which reads as ANY."""
    element = CapsFilter("c", caps="a/b")
    assert element.caps == Caps("a/b")
    element.caps = Caps("c/d, x=1")
    assert element.caps == Caps("c/d, x=1")
    element.caps = None
    assert element.caps is not None
    assert element.caps.is_any


def test_a_query() -> None:
    """cf-query: what lies beyond, within the filter; nothing where they are disjoint."""
    with Harness("capsfilter", caps="a/b", downstream="c/d") as harness:
        assert harness.element.pads["sink"].query_caps().is_empty
    with Harness("capsfilter", caps="a/b, x=1", downstream="a/b, y=2") as harness:
        assert str(harness.element.pads["sink"].query_caps()) == "a/b, x=(int)1, y=(int)2"


def test_matching_and_other_caps() -> None:
    """cf-accept: matching caps pass, others are refused, on both pads."""
    with Harness("capsfilter", caps="a/b, x=1") as harness:
        for pad in harness.element.pads.values():
            accepted = pad.query_caps()
            assert not (accepted & Caps("a/b, x=1")).is_empty
            assert (accepted & Caps("a/b, x=2")).is_empty


def test_open_caps_behind_an_open_source() -> None:
    """cf-unfixed: an error that says so, and no frame; fixed caps are supplied."""
    pipeline = Pipeline.parse("fakesrc num-buffers=1 ! a/b, x=[ 1, 9 ] ! fakesink name=s")
    with pytest.raises((ElementFailure, NotNegotiated), match="do not completely specify the output format"):
        pipeline.run(timeout_s=10)
    assert pipeline["s"].count == 0
    fixed = Pipeline.parse("fakesrc num-buffers=1 ! a/b, x=1 ! fakesink name=s")
    fixed.run(timeout_s=10)
    assert fixed["s"].last_frame.caps == Caps("a/b, x=1")


def test_the_order_of_events() -> None:
    """cf-events: caps, then the segment, then what else came before the first frame."""
    with Pipeline.parse("appsrc name=in caps=a/b ! capsfilter caps=a/b ! appsink name=out") as pipeline:
        for item in (frame("a/b"), GapEvent(1)):
            pipeline["in"].push(item)
        pipeline["in"].end()
        pipeline.play()
        objects = [pipeline["out"].pull_object(10) for _ in range(4)]
    assert objects[:2] == [CapsEvent(Caps("a/b")), SegmentEvent(Segment())]
    assert isinstance(objects[2], Frame)
    assert objects[3] == GapEvent(1)


@pytest.mark.parametrize("mode", ["delayed", "immediate"])
def test_changed_while_frames_come(mode: str) -> None:
    """cf-delayed: the caps before pass until new ones have come; with immediate they are refused at once."""
    with Harness("capsfilter", caps="a/b, x=1", caps_change_mode=mode) as harness:
        assert harness.push(frame("a/b, x=1"))
        harness.element.set_property("caps", Caps("a/b, x=2"))
        old = Caps("a/b, x=1") & harness.element.pads["sink"].query_caps()
        assert old.is_empty is (mode == "immediate")
        assert harness.push(frame("a/b, x=2"))
        assert (Caps("a/b, x=1") & harness.element.pads["sink"].query_caps()).is_empty


def test_renegotiation() -> None:
    """cf-reneg: changed again and again while it plays: each frame has caps that were in force, no error."""
    text = """videotestsrc ! capsfilter name=c caps="video/x-raw, format=GRAY8, width=16, height=16"
              ! appsink name=out max-buffers=1"""
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        for width in (16, 24, 32, 40, 16, 32):
            caps = Caps(f"video/x-raw, format=GRAY8, width={width}, height=16")
            pipeline["c"].set_property("caps", caps)
            frames = (pipeline["out"].pull() for _ in range(50))
            arrived = next(item for item in frames if item.caps["width"] == width)
            assert arrived.data.shape == (16, width)
        assert pipeline.error is None


def test_wrong_caps() -> None:
    """cf-wrong: not negotiated, and one error that names both sides."""
    with Pipeline.parse("appsrc name=in ! capsfilter caps=a/b,x=1 ! fakesink") as pipeline:
        pipeline.play()
        pipeline["in"].push(frame("a/b, x=2"))
        message = pipeline.wait(10)
        assert message is not None
        assert "disagree on x" in message.text
        assert pipeline.wait(0.05) is None


@pytest.mark.parametrize(
    ("wanted", "width"), [("width=[ 10, 20 ]", 20), ("width={ 100, 50 }", 100), ("width=[ 1, 4096 ]", 320)]
)
def test_fixing_inside_the_filter(wanted: str, width: int) -> None:
    """nego-fixate: near the source's preferred 320, or the first of a list."""
    text = f"videotestsrc num-buffers=1 ! video/x-raw, format=GRAY8, {wanted}, height=16 ! appsink name=out"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        assert pipeline["out"].pull().caps["width"] == width


def test_accepting_caps() -> None:
    """nego-accept: caps that have anything in common with what a pad takes are taken, unknown fields too."""
    with Harness("capsfilter", caps="a/b, x=1") as harness:
        assert harness.push(frame("a/b, x=1, unknown=5"))
        with pytest.raises(NotNegotiated):
            harness.push(frame("c/d"))
