"""tee: the same frames to several branches."""

from collections.abc import Callable

import pytest

from streamkit import Caps, ElementFailure, EndOfStream, Frame, Pipeline, Sink
from streamkit.element.registry import make_element
from streamkit.flow.events import Flushing, NotLinked

Register = Callable[..., None]
ANYTHING = Caps("a/b")


def test_every_branch_gets_every_frame() -> None:
    """t-copies: 15 branches, three frames each."""
    pipeline = Pipeline.parse("fakesrc num-buffers=3 ! tee name=t" + "  t. ! queue ! fakesink" * 15)
    pipeline.run(timeout_s=20)
    assert [pipeline[f"fakesink{n}"].count for n in range(15)] == [3] * 15


@pytest.mark.one_process
def test_branches_share_the_frame() -> None:
    """t-shared: the same object, not a copy."""
    with Pipeline.parse(
        "fakesrc num-buffers=2 ! tee name=t t. ! queue ! appsink name=a t. ! queue ! appsink name=b"
    ) as pipeline:
        pipeline.play()
        for one, other in zip(pipeline["a"], pipeline["b"], strict=True):
            assert one is other


def test_a_slow_branch_without_leak_loses_nothing() -> None:
    """t-slow: both branches get all frames, whatever the pace."""
    text = """fakesrc num-buffers=20 ! tee name=t
              t. ! queue max-size-buffers=1 ! identity sleep-time=1000 ! fakesink
              t. ! queue max-size-buffers=1 ! fakesink"""
    pipeline = Pipeline.parse(text)
    pipeline.run(timeout_s=20)
    assert (pipeline["fakesink0"].count, pipeline["fakesink1"].count) == (20, 20)


def test_a_leaky_branch_does_not_hold_the_other_up() -> None:
    """t-slow-leaky: the blocked branch drops and counts, the fast one gets everything."""
    text = """fakesrc num-buffers=100 ! tee name=t
              t. ! queue name=q max-size-buffers=1 leaky=downstream ! appsink name=stuck max-buffers=1
              t. ! queue ! appsink name=fast max-buffers=0"""
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        assert [frame.seq for frame in pipeline["fast"]] == list(range(100))
        stuck = [frame.seq for frame in pipeline["stuck"]]
        assert len(stuck) + pipeline["q"].drops["queue full, oldest dropped"] == 100
        assert stuck[-1] == 99
        assert len(stuck) < 100


class Answers(Sink):
    """Answers every frame in its way."""

    sink = "ANY"
    answer: Exception | None = None

    def start(self) -> None:
        self.count = 0

    def render(self, frame: Frame) -> None:
        self.count += 1
        if self.answer is not None:
            raise self.answer


@pytest.mark.parametrize(
    ("one", "other", "expected"),
    [
        (None, None, None),
        (NotLinked("x"), None, None),
        (NotLinked("x"), NotLinked("x"), NotLinked),
        (EndOfStream("x"), None, EndOfStream),
        (EndOfStream("x"), EndOfStream("x"), EndOfStream),
        (NotLinked("x"), EndOfStream("x"), EndOfStream),
        (Flushing("x"), None, Flushing),
        (None, Flushing("x"), Flushing),
        (ValueError("x"), None, ValueError),
        (NotLinked("x"), ValueError("x"), ValueError),
    ],
)
def test_flow_results_of_branches_are_combined(
    one: Exception | None, other: Exception | None, expected: type[Exception] | None
) -> None:
    """t-flow: flushing, ended or failed if any branch is; not linked only if all are."""
    tee = make_element("tee", "t")
    for answer in (one, other):
        sink = Answers()
        sink.answer = answer
        sink.start()
        pad = tee.request_pad(tee.pad_templates["src_%u"])
        pad.link(sink.pads["sink"])
        pad.push = sink.render
    take = tee.receiver(tee.pads["sink"])
    if expected is None:
        take(Frame(b"", ANYTHING))
    else:
        with pytest.raises(expected):
            take(Frame(b"", ANYTHING))


@pytest.mark.one_process
def test_a_branch_that_ends_ends_the_stream() -> None:
    """t-flow: the source ends then, and EOS reaches all; the second branch is one frame behind."""
    pipeline = Pipeline.parse("fakesrc num-buffers=10 ! tee name=t t. ! fakesink num-buffers=3 t. ! fakesink")
    pipeline.run(timeout_s=10)
    assert (pipeline["fakesink0"].count, pipeline["fakesink1"].count) == (3, 2)


def test_a_tee_without_branches() -> None:
    """t-allow: an error that names the tee, unless it is allowed."""
    with pytest.raises(ElementFailure, match=r"pad t.src_%u is not linked; link it to a sink$"):
        Pipeline.parse("fakesrc num-buffers=3 ! tee name=t").run(timeout_s=10)
    Pipeline.parse("fakesrc num-buffers=3 ! tee allow-not-linked=true").run(timeout_s=10)


def test_names_of_request_pads() -> None:
    """t-reqnames: names given are kept."""
    tee = make_element("tee")
    template = tee.pad_templates["src_%u"]
    names = [tee.request_pad(template, name).name for name in ("", "src_100", "src_10", "")]
    assert names == ["src_0", "src_100", "src_10", "src_101"]
