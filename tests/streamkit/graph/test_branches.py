"""Branches added and removed while playing, and pads that the stream adds."""

import threading
import time
from collections.abc import Callable, Iterator

import pytest

from streamkit import (
    Caps,
    DescriptionError,
    Direction,
    Element,
    ElementFailure,
    Frame,
    PadTemplate,
    Pipeline,
    Presence,
    ResourceError,
    Sink,
    Source,
)
from streamkit.errors import Place
from streamkit.flow.caps import ANY
from streamkit.graph import branches
from streamkit.graph.graph import Graph
from streamkit.graph.negotiate import negotiate

Register = Callable[..., None]
ANYTHING = Caps("a/b")


class Gathering(Sink):
    """Keeps the numbers of its frames."""

    sink = "ANY"

    def start(self) -> None:
        self.numbers: list[int] = []
        self.is_stopped = False
        self.changed = threading.Condition()

    def render(self, frame: Frame) -> None:
        with self.changed:
            self.numbers.append(frame.seq)
            self.changed.notify_all()

    def stop(self) -> None:
        self.is_stopped = True

    def wait_for(self, count: int) -> bool:
        with self.changed:
            return self.changed.wait_for(lambda: len(self.numbers) >= count, timeout=10)


class Refusing(Sink):
    """Cannot be started."""

    sink = "ANY"

    def start(self) -> None:
        raise ResourceError("no room")

    def render(self, frame: Frame) -> None:
        raise NotImplementedError


def push(pipeline: Pipeline, numbers: range) -> None:
    """Gives the pipeline numbered frames."""
    for number in numbers:
        pipeline["in"].push(Frame(b"", ANYTHING, seq=number, arrival_ns=1))


def test_a_branch_is_added_and_removed_while_playing(register: Register) -> None:
    """It gets all frames in between, drains, and is stopped."""
    register(gathering=Gathering)
    with Pipeline.parse("appsrc name=in ! tee name=t t. ! queue ! gathering name=a") as pipeline:
        pipeline.play()
        push(pipeline, range(10))
        assert pipeline["a"].wait_for(10)
        branch = pipeline.add_branch("t", "queue ! gathering name=b")
        joined = pipeline["b"]
        push(pipeline, range(10, 20))
        assert joined.wait_for(10)
        pipeline.remove_branch(branch)
        assert joined.is_stopped
        push(pipeline, range(20, 30))
        pipeline["in"].end()
        assert pipeline.wait(10) is not None
        assert joined.numbers == list(range(10, 20))
        assert pipeline["a"].numbers == list(range(30))
        assert [pad.name for pad in pipeline["t"].src_pads()] == ["src_0"]
        with pytest.raises(KeyError):
            pipeline["b"]


def test_the_end_waits_for_a_branch_that_joined(register: Register) -> None:
    """One EOS, when the new sink has it too."""
    register(gathering=Gathering)
    with Pipeline.parse("appsrc name=in ! tee name=t t. ! gathering name=a") as pipeline:
        pipeline.play()
        push(pipeline, range(1))
        assert pipeline["a"].wait_for(1)
        pipeline.add_branch("t", "queue ! gathering name=b")
        push(pipeline, range(1, 50))
        pipeline["in"].end()
        assert pipeline.wait(10) is not None
        assert pipeline["b"].numbers == list(range(1, 50))


def test_a_hundred_branches_leave_no_thread_or_element(register: Register) -> None:
    """Other branches lose no frame."""
    register(gathering=Gathering)
    text = "videotestsrc ! video/x-raw,width=16,height=16 ! tee name=t t. ! queue ! gathering name=a"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        assert pipeline["a"].wait_for(1)
        elements, threads = len(pipeline.graph.elements), set(threading.enumerate())
        for _ in range(100):
            branch = pipeline.add_branch("t", "queue ! gathering name=b")
            assert pipeline["b"].wait_for(1)
            pipeline.remove_branch(branch)
        assert len(pipeline.graph.elements) == elements
        assert set(threading.enumerate()) <= threads  # those of earlier tests may end
        numbers = list(pipeline["a"].numbers)
        assert numbers == list(range(len(numbers)))


class Holding(Sink):
    """Holds its first frame until it is told to go on."""

    sink = "ANY"

    def start(self) -> None:
        self.has_frame, self.may_go_on, self.has_drained = (threading.Event() for _ in range(3))

    def render(self, frame: Frame) -> None:
        self.has_frame.set()
        self.may_go_on.wait(20)

    def drain(self) -> None:
        self.has_drained.set()


@pytest.mark.parametrize("is_added_first", [False, True])
def test_the_end_of_a_removed_branch_does_not_overtake_a_frame(
    register: Register, is_added_first: bool
) -> None:
    """However long the frame takes, within the time limit of the removal."""
    register(holding=Holding)
    with Pipeline.parse("appsrc name=in ! tee name=t t. ! queue ! fakesink") as pipeline:
        if not is_added_first:
            pipeline.play()
        branch = pipeline.add_branch("t", "holding name=b")
        pipeline.play()
        held = pipeline["b"]
        push(pipeline, range(1))
        assert held.has_frame.wait(20)
        remover = threading.Thread(target=pipeline.remove_branch, args=(branch, 20.0))
        remover.start()
        assert not held.has_drained.wait(1.0)
        held.may_go_on.set()
        assert held.has_drained.wait(20)
        remover.join(20)
        assert not remover.is_alive()
        pipeline["in"].end()
        assert pipeline.wait(20) is not None
        assert pipeline.error is None


def test_a_branch_leaves_a_paused_pipeline_that_continues(register: Register) -> None:
    """The frame on its way is given up; those that follow reach the other branch."""
    register(gathering=Gathering)
    with Pipeline.parse("appsrc name=in ! tee name=t t. ! queue ! gathering name=a") as pipeline:
        branch = pipeline.add_branch("t", "fakesink name=b")
        pipeline.pause()
        push(pipeline, range(5))
        assert pipeline.wait_prerolled(20)
        pipeline.remove_branch(branch, 0.1)
        pipeline.play()
        pipeline["in"].end()
        assert pipeline.wait(20) is not None
        assert pipeline["a"].numbers == list(range(5))


def test_a_branch_that_cannot_start_leaves_nothing(register: Register) -> None:
    """st-fail: the pipeline continues."""
    register(gathering=Gathering, refusing=Refusing)
    with Pipeline.parse("appsrc name=in ! tee name=t t. ! gathering name=a") as pipeline:
        pipeline.play()
        with pytest.raises(ElementFailure, match="no room"):
            pipeline.add_branch("t", "queue ! refusing")
        push(pipeline, range(3))
        pipeline["in"].end()
        assert pipeline.wait(10) is not None
        assert pipeline["a"].numbers == [0, 1, 2]
        assert [pad.name for pad in pipeline["t"].src_pads()] == ["src_0"]


def test_a_branch_without_its_converter_yet_restricts_no_source(monkeypatch: pytest.MonkeyPatch) -> None:
    """A source may ask what is accepted while the branch is being negotiated."""
    with Pipeline.parse("appsrc ! tee name=t t. ! queue ! fakesink") as pipeline:
        pipeline.play()
        accepted = []

        def ask_and_negotiate(graph: Graph, places: dict[Element, Place]) -> None:
            accepted.append(pipeline["t"].query_caps(pipeline["t"].pads["sink"]))
            negotiate(graph, places)

        monkeypatch.setattr(branches, "negotiate", ask_and_negotiate)
        pipeline.add_branch("t", "queue ! video/x-raw,format=GRAY8 ! fakesink")
    assert accepted == [ANY]


def test_a_branch_gets_a_converter_where_it_needs_one() -> None:
    """Raw video of another format is converted for the new branch, and the converter leaves with it."""
    with Pipeline.parse(
        "videotestsrc ! video/x-raw,format=BGR ! tee name=t t. ! queue ! fakesink"
    ) as pipeline:
        pipeline.play()
        branch = pipeline.add_branch("t", "queue ! video/x-raw,format=GRAY8 ! appsink name=out max-buffers=2")
        assert next(iter(pipeline["out"])).caps["format"] == "GRAY8"
        assert any(element.factory == "videoconvert" for element in branch.elements)
        pipeline.remove_branch(branch)
        assert not any(element.factory == "videoconvert" for element in pipeline.graph.elements)


def test_only_elements_with_request_pads_take_branches() -> None:
    """The error says what to put there."""
    with (
        Pipeline.parse("fakesrc ! identity name=i ! fakesink") as pipeline,
        pytest.raises(DescriptionError, match="tee"),
    ):
        pipeline.add_branch("i", "fakesink")


def test_a_name_that_is_taken_is_refused() -> None:
    """Automatic names are numbered on; an element keeps the name that it was given."""
    with Pipeline.parse("fakesrc ! tee name=t t. ! fakesink name=k") as pipeline:
        branch = pipeline.add_branch("t", "queue ! fakesink")
        assert [element.name for element in branch.elements] == ["queue0", "fakesink0"]
        again = pipeline.add_branch("t", "queue ! fakesink")
        assert [element.name for element in again.elements] == ["queue1", "fakesink1"]
        for taken in ("fakesink name=k", "fakesink name=fakesink0"):
            with pytest.raises(DescriptionError, match=f"has an element '{taken[14:]}' already"):
                pipeline.add_branch("t", f"queue ! {taken}")
        named = pipeline.add_branch("t", "queue name=queue7 ! fakesink")
        assert [element.name for element in named.elements] == ["queue7", "fakesink2"]


class Discovering(Source):
    """Finds out while it streams which pads it has."""

    templates = (PadTemplate("stream_%u", Direction.SRC, Caps("a/b"), Presence.SOMETIMES),)

    def negotiate(self, allowed: Caps) -> None:
        return None

    def frames(self) -> Iterator[tuple[str, Frame]]:
        names = [self.add_pad("stream_%u").name for _ in range(2)]
        self.no_more_pads()
        for number in range(3):
            for name in names:
                yield name, Frame(b"", ANYTHING, seq=number, arrival_ns=1)


def test_links_wait_for_pads_that_the_stream_brings(register: Register) -> None:
    """y02: the link is made when the pad comes, and its frames reach the sink."""
    register(discovering=Discovering, gathering=Gathering)
    with Pipeline.parse("discovering name=d d.stream_1 ! queue ! gathering name=a") as pipeline:
        pipeline.run(timeout_s=10)
        assert pipeline["a"].numbers == [0, 1, 2]


def test_a_branch_cannot_wait_for_pads(register: Register) -> None:
    """The link would never be made: it is refused, and the branch with it."""
    register(discovering=Discovering, gathering=Gathering)
    with Pipeline.parse("fakesrc ! tee name=t t. ! fakesink") as pipeline:
        with pytest.raises(DescriptionError, match=r"d\.stream_0 ! b: a branch cannot wait for a pad"):
            pipeline.add_branch("t", "gathering name=a discovering name=d d.stream_0 ! gathering name=b")
        assert [element.name for element in pipeline.graph.elements] == ["fakesrc0", "t", "fakesink0"]


def test_a_pad_that_never_comes_is_warned_of(register: Register) -> None:
    """y05: the waiting sink gets EOS, and the bus a warning."""
    register(discovering=Discovering, gathering=Gathering)
    text = "discovering name=d d.stream_0 ! gathering name=a d.stream_7 ! gathering name=b"
    with Pipeline.parse(text) as pipeline:
        warnings: list[object] = []
        pipeline.bus.watch(lambda message: warnings.append(message.fields.get("code")))
        pipeline.run(timeout_s=10)
        assert "delayed-link" in warnings
        assert pipeline["a"].numbers == [0, 1, 2]
        assert pipeline["b"].numbers == []


def test_a_branch_that_got_no_frame_streams_in_the_next_run() -> None:
    """Its pad no longer waits for a first frame that carries caps and segment."""
    with Pipeline.parse("appsrc name=in ! tee name=t  t. ! queue ! fakesink") as pipeline:
        pipeline.play()
        pipeline.add_branch("t", "queue ! appsink name=added")
        pipeline.stop()
        pipeline["in"].push(Frame(b"", Caps("a/b")))
        pipeline.play()
        assert pipeline["added"].pull(20.0) is not None
        assert pipeline["added"].sink_caps == Caps("a/b")


def test_a_branch_that_is_added_after_the_end_of_the_stream_is_not_waited_for() -> None:
    """EOS has passed the tee, but not the sinks: the run still waits for those, and not for the new one."""
    with Pipeline.parse("fakesrc num-buffers=3 name=f ! tee name=t t. ! queue ! fakesink") as pipeline:
        pipeline.pause()
        assert pipeline.wait_prerolled(10)
        while not pipeline["t"].pads["sink"].has_upstream_ended:
            time.sleep(0.001)
        pipeline.add_branch("t", "queue ! fakesink")
        pipeline.play()
        assert pipeline.wait(10) is not None


def test_a_flush_reaches_the_eos_of_a_branch_that_got_no_frame() -> None:
    """Its sink holds EOS in the thread of a queue, for which the flush would wait."""
    with Pipeline.parse("appsrc name=in ! queue ! tee name=t ! queue ! fakesink") as pipeline:
        pipeline.pause()
        pipeline.add_branch("t", "fakesink name=added")
        pipeline["in"].end()
        assert pipeline.wait_prerolled(10)
        pipeline.flush()
        assert pipeline["added"].flushes > 0
        pipeline.play()
        assert pipeline.wait(10) is not None


@pytest.mark.parametrize("branch", ["queue ! appsink name=added", "appsink name=added"])
def test_a_branch_that_is_added_after_the_end_of_the_stream_ends_at_once(branch: str) -> None:
    """It gets EOS as it joins, not only as it leaves."""
    with Pipeline.parse("fakesrc num-buffers=0 ! tee name=t ! fakesink") as pipeline:
        pipeline.play()
        assert pipeline.wait(10) is not None
        pipeline.add_branch("t", branch)
        assert pipeline["added"].pull(10.0) is None


def test_the_failure_of_a_branch_that_ends_at_once_is_reported(register: Register) -> None:
    """The thread that sends EOS to it is not waited for."""
    failing = threading.Event()

    class Fails(Sink):
        """Fails at EOS, once it may."""

        sink = "ANY"

        def drain(self) -> None:
            failing.wait(10)
            raise ValueError("bad")

    register(fails=Fails)
    with Pipeline.parse("fakesrc num-buffers=0 name=f ! tee name=t ! queue ! fakesink") as pipeline:
        pipeline.pause()
        while not pipeline["t"].pads["sink"].has_upstream_ended:
            time.sleep(0.001)
        pipeline.add_branch("t", "fails")
        pipeline.play()
        failing.set()
        message = pipeline.wait(10)
    assert message is not None
    assert str(message.error) == "fails0: ValueError: bad"


def test_a_branch_that_leaves_with_a_frame_on_its_way_stops_no_other(register: Register) -> None:
    """The frame that waits for room in the branch is lost; those that follow reach the others."""

    class Holds(Sink):
        """Takes no second frame."""

        sink = "ANY"

        def render(self, frame: Frame) -> None:
            self.stopping.wait(20)

    register(holds=Holds)
    with Pipeline.parse("fakesrc num-buffers=50 ! queue ! tee name=t ! fakesink name=k") as pipeline:
        pipeline.pause()
        branch = pipeline.add_branch("t", "queue max-size-buffers=1 ! holds")
        pipeline.play()
        while pipeline["k"].count < 3:
            time.sleep(0.001)
        pipeline.remove_branch(branch, timeout_s=0.1)
        assert pipeline.wait(10) is not None
        assert pipeline["k"].count == 50


def test_the_bins_of_a_branch_have_names_of_their_own() -> None:
    """They come and go with it, the enclosing ones, too."""
    with Pipeline.parse("fakesrc ! tee name=t  t. ! ( name=out fakesink )  t. ! ( fakesink )") as pipeline:
        before = list(pipeline.graph.bins)
        branch = pipeline.add_branch("t", "( ( fakesink ) )")
        names = [group.name for group in pipeline.graph.bins]
        assert len(set(names)) == len(before) + 2
        pipeline.remove_branch(branch)
        assert pipeline.graph.bins == before
        with pytest.raises(DescriptionError, match="has an element 'out' already"):
            pipeline.add_branch("t", "( name=out fakesink )")


def test_a_branch_without_a_queue_is_removed_while_paused() -> None:
    """Its sink would hold EOS until the pipeline plays, which waits for the removal."""
    with Pipeline.parse("fakesrc ! tee name=t ! fakesink") as pipeline:
        pipeline.pause()
        assert pipeline.wait_prerolled(10)
        branch = pipeline.add_branch("t", "fakesink")
        pipeline.remove_branch(branch, timeout_s=0.1)
        pipeline.play()
