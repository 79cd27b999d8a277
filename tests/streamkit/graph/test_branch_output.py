"""BranchOutput: branches that join and leave, and those that may be dropped after a failure."""

from collections.abc import Callable

import pytest

from streamkit import Caps, ElementFailure, Frame, MessageKind, Pipeline, Property, Sink, Transform
from streamkit.element.pad import Direction, Pad, PadTemplate
from streamkit.elements.tee import Tee
from streamkit.flow.caps import ANY
from streamkit.flow.events import CapsEvent, EosEvent, Event, Flushing
from streamkit.graph.branches import BranchOutput

Register = Callable[..., None]


class Breaks(Transform):
    """Fails at the third frame."""

    sink = src = "ANY"

    def transform(self, frame: Frame) -> Frame:
        if frame.seq == 2:
            raise OSError("publisher died")
        return frame


class BreaksAtEnd(Sink):
    """Cannot finish what it took."""

    sink = "ANY"
    after: int = Property(0, doc="Unused.")

    def render(self, frame: Frame) -> None:
        pass

    def drain(self) -> None:
        raise OSError("no space left")


@pytest.fixture(autouse=True)
def _elements(register: Register) -> None:
    register(breaks=Breaks, breaksatend=BreaksAtEnd)


TEXT = "fakesrc num-buffers=50 ! tee name=t  t. ! queue ! appsink name=kept max-buffers=0  t. ! {branch}"


@pytest.mark.parametrize(
    "branch",
    [
        "breaks ! fakesink on-error=drop-branch",
        "queue ! breaks ! fakesink on-error=drop-branch",
        "breaks ! queue ! fakesink on-error=drop-branch",
        "queue ! identity ! queue ! breaks ! tee name=u  u. ! fakesink on-error=drop-branch  "
        "u. ! queue ! fakesink on-error=drop-branch",
        "queue ! breaksatend on-error=drop-branch",
        "breaksatend on-error=drop-branch",
    ],
)
def test_the_other_branch_gets_every_frame(branch: str) -> None:
    """The failure is a warning; EOS is posted as usual."""
    with Pipeline.parse(TEXT.format(branch=branch)) as pipeline:
        pipeline.play()
        assert [frame.seq for frame in pipeline["kept"]] == list(range(50))
        warning = pipeline.bus.pop(20, (MessageKind.WARNING,))
        assert warning is not None
        assert warning.fields["code"] == "branch-dropped"
        assert "is dropped, the others continue" in warning.text
        end = pipeline.wait(20)
        assert end is not None
        assert end.kind is MessageKind.EOS
        assert pipeline.error is None


def test_frames_that_a_dropped_branch_missed_are_counted() -> None:
    """The tee accounts for each; nothing is lost unseen."""
    with Pipeline.parse(TEXT.format(branch="breaks ! fakesink name=k on-error=drop-branch")) as pipeline:
        pipeline.play()
        assert pipeline.wait(20) is not None
        drops = pipeline["t"].drops
        assert drops["branch dropped after its failure"] == 50 - 3
        assert pipeline["k"].count == 2


@pytest.mark.parametrize(
    "text",
    [
        TEXT.format(branch="breaks ! fakesink"),
        TEXT.format(branch="breaks ! tee name=u  u. ! fakesink on-error=drop-branch  u. ! fakesink"),
        "fakesrc num-buffers=9 ! breaks ! fakesink on-error=drop-branch",
        "fakesrc num-buffers=9 ! tee name=t  t. ! breaks ! fakesink on-error=drop-branch",
    ],
)
def test_a_failure_ends_the_pipeline_unless_the_branch_may_be_dropped(text: str) -> None:
    """`on-error` of a sink is `end`, the branch feeds another sink, or it is the only one."""
    with pytest.raises(ElementFailure, match="publisher died"):
        Pipeline.parse(text).run(timeout_s=20)


@pytest.mark.parametrize("branch", ["breaks ! fakesink name=k", "queue ! breaks ! fakesink name=k"])
def test_a_dropped_branch_is_there_in_the_next_run(branch: str) -> None:
    """A pipeline whose branch was dropped plays again, with all its branches."""
    with Pipeline.parse(TEXT.format(branch=f"{branch} on-error=drop-branch")) as pipeline:
        for _ in range(2):
            pipeline.play()
            assert [frame.seq for frame in pipeline["kept"]] == list(range(50))
            end = pipeline.wait(20)  # the dropped branch has taken what it takes
            assert end is not None
            pipeline.stop()
            assert pipeline["k"].count == 2
            assert len(list(pipeline.graph.links())) == len(pipeline.graph.elements) - 1


def test_an_added_branch_may_be_dropped() -> None:
    """Like those of the description."""
    with Pipeline.parse("fakesrc num-buffers=-1 ! tee name=t  t. ! queue ! appsink name=kept") as pipeline:
        pipeline.play()
        pipeline["kept"].pull()
        pipeline.add_branch("t", "queue ! breaksatend name=b on-error=drop-branch")
        pipeline.add_branch("t", "queue ! fakesink name=other")
        pipeline["kept"].drop = True
        pipeline.finish()
        end = pipeline.wait(20)
        assert end is not None
        assert end.kind is MessageKind.EOS


class EventPad(Pad):
    """A src pad that records its events, and calls a function while caps pass."""

    __slots__ = ("during_caps", "events")

    def send_event(self, event: Event) -> None:
        super().send_event(event)
        self.events.append(type(event))
        if isinstance(event, CapsEvent):
            self.during_caps()


def remove(output: BranchOutput) -> None:
    """Removes a branch at once."""
    output.remove(0.0)


@pytest.mark.parametrize("leave", [remove, BranchOutput.fail])
def test_a_branch_that_leaves_while_it_joins_gets_no_frame(leave: Callable[[BranchOutput], None]) -> None:
    """EOS goes out once; of a failed branch, frames are counted."""
    tee = Tee("t")
    src = EventPad(tee, PadTemplate("src_%u", Direction.SRC, ANY), "src_0")
    sent: list[Frame] = []
    src.awaits_first_frame = True
    output = BranchOutput(src, sent.append, lambda *_: False)
    src.events, src.during_caps = [], lambda: leave(output)
    frame = Frame(b"", Caps("text/x-raw"))
    for _ in range(2):
        src.push(frame)
    assert sent == []
    assert src.events.count(EosEvent) == 1
    assert tee.drops.total() == (2 if leave is BranchOutput.fail else 0)


class Stopping(Sink):
    """Takes nothing more, as once its branch has been removed."""

    sink = "ANY"

    def receive_event(self, pad: Pad, event: Event) -> None:
        raise Flushing(self.name)


def test_a_branch_that_stops_as_it_gets_eos_ends_no_other() -> None:
    """The thread that brings the next frame sends EOS if it comes before the one that removes the branch."""
    src = Pad(Tee("t"), PadTemplate("src_%u", Direction.SRC, ANY), "src_0")
    src.link(Stopping("s").pads["sink"])
    output = BranchOutput(src, lambda _: None, lambda *_: False)
    with output._sending:
        output.remove(0.0)
        src.push(Frame(b"", Caps("text/x-raw")))
