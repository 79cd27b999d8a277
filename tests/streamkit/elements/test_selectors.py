"""input-selector and output-selector, as GStreamer's own tests have it."""

import pytest

from streamkit import ANY, DescriptionError, ElementFailure, Frame, Pipeline, PropertyError

IN = "input-selector name=s ! appsink name=out  appsrc name=a ! s.sink_0  appsrc name=b ! s.sink_1"


def test_first_input_is_active_by_default() -> None:
    """Two finite sources: only the first one's frames appear, then EOS."""
    text = (
        "input-selector name=s ! appsink name=out  "
        "fakesrc num-buffers=3 sizetype=fixed sizemax=1 ! s.sink_0  "
        "fakesrc num-buffers=5 sizetype=fixed sizemax=2 ! s.sink_1"
    )
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        assert [len(frame.data) for frame in pipeline["out"]] == [1] * 3


def test_an_active_input_that_is_not_there_is_refused() -> None:
    """Every frame would be dropped."""
    text = "input-selector name=s active-pad=sink_{} ! fakesink  fakesrc num-buffers=3 ! s."
    Pipeline.parse(text.format(0)).run(timeout_s=10)
    rule = r"active-pad cannot be 'sink_1': it takes the name of a pad \(sink_0\)$"
    with pytest.raises(ElementFailure, match=rule):
        Pipeline.parse(text.format(1)).run(timeout_s=10)


def test_switching_selects_the_other_input() -> None:
    """Only frames of the active input pass; those of the other are dropped and counted."""
    with Pipeline.parse(IN) as pipeline:
        pipeline.play()
        pipeline["a"].push(Frame(b"a", ANY))
        assert pipeline["out"].pull().data == b"a"
        pipeline["s"].set_property("active-pad", "sink_1")
        pipeline["b"].push(Frame(b"b", ANY))
        assert pipeline["out"].pull().data == b"b"
        pipeline["a"].push(Frame(b"a", ANY))
        pipeline["a"].end()
        pipeline["b"].end()
        assert pipeline["out"].pull() is None
        assert pipeline["s"].drops["input not active"] <= 1


def test_switching_to_an_ended_input_ends_the_stream() -> None:
    """An input that has had its EOS gives it at once when it becomes active."""
    with Pipeline.parse(IN) as pipeline:
        pipeline.play()
        pipeline["b"].end()
        while not pipeline["s"].pads["sink_1"].is_eos:
            assert not pipeline.ended.wait(0.01)
        pipeline["s"].set_property("active-pad", "sink_1")
        assert pipeline["out"].pull() is None


def test_output_selector_hands_to_the_active_branch() -> None:
    """All frames go to the first branch; EOS goes to both, so the pipeline ends."""
    text = "fakesrc num-buffers=4 ! output-selector name=s  s. ! fakesink name=one  s. ! fakesink name=two"
    with Pipeline.parse(text) as pipeline:
        pipeline.run(10)
        assert (pipeline["one"].count, pipeline["two"].count) == (4, 0)


def test_an_active_branch_that_is_not_there_is_refused() -> None:
    """Every frame would go to the first branch."""
    text = "fakesrc num-buffers=3 is-live=true ! output-selector name=s active-pad=src_{}  s. ! fakesink"
    rule = r"active-pad cannot be 'src_1': it takes the name of a pad \(src_0\)$"
    with pytest.raises(ElementFailure, match=rule):
        Pipeline.parse(text.format(1)).run(timeout_s=10)
    with pytest.raises(DescriptionError, match="cannot be 'src_x': it takes the name of a pad"):
        Pipeline.parse(text.format("x"))
    with Pipeline.parse(text.format(0)) as pipeline:
        pipeline.play()
        with pytest.raises(PropertyError, match=rule):
            pipeline["s"].set_property("active-pad", "src_1")


def test_output_selector_switches() -> None:
    """After a switch the other branch gets the frames."""
    text = "appsrc name=in ! output-selector name=s  s. ! appsink name=one  s. ! appsink name=two"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        pipeline["in"].push(Frame(b"1", ANY))
        assert pipeline["one"].pull().data == b"1"
        pipeline["s"].set_property("active-pad", "src_1")
        pipeline["in"].push(Frame(b"2", ANY))
        assert pipeline["two"].pull().data == b"2"
