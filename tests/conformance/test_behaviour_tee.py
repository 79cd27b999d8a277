"""tee, as behaviour.md tells."""

import threading
from collections.abc import Callable

import numpy as np
import pytest

from streamkit import Caps, ElementFailure, EndOfStream, Frame, Pipeline, Sink, Transform
from streamkit.element.pad import Pad
from streamkit.element.registry import make_element
from streamkit.elements.tee import Tee
from streamkit.flow.events import Flushing, NotLinked
from streamkit.graph.pipeline import StateChange

Register = Callable[..., None]
ANYTHING = Caps("a/b")
FRAME = Frame(b"", ANYTHING)


def make_tee(**properties: object) -> Tee:
    """A tee without branches."""
    tee = make_element("tee", "t", **properties)
    assert isinstance(tee, Tee)
    return tee


def branch(tee: Tee, answer: Exception | None = None, name: str = "") -> tuple[Pad, list[Frame]]:
    """A new branch that takes frames, or answers them with an exception."""
    pad = tee.request_pad(tee.pad_templates["src_%u"], name)
    taken: list[Frame] = []

    def take(frame: Frame) -> None:
        taken.append(frame)
        if answer is not None:
            raise answer

    pad.push = take
    return pad, taken


def test_every_branch_gets_every_frame() -> None:
    """t-copies: 15 queued branches, 3 frames each, one EOS."""
    text = "fakesrc num-buffers=3 ! tee name=t" + " t. ! queue ! fakesink" * 15
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        assert pipeline.wait(20) is not None
        assert pipeline.wait(0.0) is None
        assert [pipeline[f"fakesink{n}"].count for n in range(15)] == [3] * 15


def test_branches_share_the_frame(register: Register) -> None:
    """t-shared: the same object in both; one that writes gets a copy, the other's stays as it was."""

    class Writes(Transform):
        """Writes into the picture."""

        sink = src = "a/b"

        def transform(self, frame: Frame) -> Frame:
            """Writes."""
            mine = frame.writable()
            mine.data[:] = 9
            return mine

    register(writes=Writes)
    text = """appsrc name=in caps=a/b ! tee name=t  t. ! queue ! appsink name=plain
              t. ! queue ! writes ! appsink name=written"""
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        pipeline["in"].push(np.zeros(4, np.uint8))
        plain, written = pipeline["plain"].pull(), pipeline["written"].pull()
    assert plain.data.tolist() == [0, 0, 0, 0]
    assert written.data.tolist() == [9, 9, 9, 9]


@pytest.mark.parametrize(
    ("one", "other", "expected"),
    [
        (None, NotLinked("x"), None),
        (NotLinked("x"), NotLinked("x"), NotLinked),
        (Flushing("x"), None, Flushing),
        (None, Flushing("x"), Flushing),
        (NotLinked("x"), Flushing("x"), Flushing),
        (EndOfStream("x"), None, EndOfStream),
        (ValueError("x"), None, ValueError),
        (NotLinked("x"), ValueError("x"), ValueError),
    ],
)
def test_flow(one: Exception | None, other: Exception | None, expected: type[Exception] | None) -> None:
    """t-flow: flushing if any flushes, an error if any fails, not linked only if all are."""
    tee = make_tee()
    branch(tee, one)
    branch(tee, other)
    take = tee.receiver(tee.pads["sink"])
    if expected is None:
        take(FRAME)
    else:
        with pytest.raises(expected):
            take(FRAME)


@pytest.mark.parametrize("branches", [0, 1, 2])
def test_unlinked_branches_may_be_allowed(branches: int) -> None:
    """t-allow: frames go nowhere and nobody minds; without it the tee is not linked."""
    tee = make_tee(allow_not_linked=True)
    for _ in range(branches):
        tee.request_pad(tee.pad_templates["src_%u"])
    take = tee.receiver(tee.pads["sink"])
    take(FRAME)
    tee.allow_not_linked = False
    with pytest.raises(NotLinked):
        take(FRAME)
    assert tee.num_src_pads == branches


def test_names() -> None:
    """t-reqnames: asked for by number or not; each is new."""
    tee = make_tee()
    names = [branch(tee, name=name)[0].name for name in ("src_%u", "src_100", "src_10", "src_%u")]
    assert names[:3] == ["src_0", "src_100", "src_10"]
    assert len(set(names)) == 4


def test_what_the_tee_takes_is_what_all_branches_take() -> None:
    """t-links: the sink pad answers for every branch, also when branches come and go."""
    tee = make_tee()
    sinks = []
    for caps in ("a/b, x={ 1, 2 }", "a/b, x={ 2, 3 }"):
        pad = tee.request_pad(tee.pad_templates["src_%u"])
        sink = make_element("appsink", caps=caps)
        pad.link(sink.pads["sink"])
        sinks.append(pad)
    assert str(tee.pads["sink"].query_caps()) == "a/b, x=(int)2"
    tee.release_pad(sinks[0])
    assert tee.pads["sink"].query_caps() == Caps("a/b, x={ 2, 3 }")


def test_branches_leave_while_frames_flow() -> None:
    """t-release, t-stress: pads come and go again and again; the branch that stays misses no frame."""
    tee = make_tee()
    _, stays = branch(tee)
    take = tee.receiver(tee.pads["sink"])
    stopped = threading.Event()
    failures: list[BaseException] = []

    def come_and_go() -> None:
        try:
            while not stopped.is_set():
                pad, _ = branch(tee)
                tee.release_pad(pad)
        except BaseException as error:
            failures.append(error)

    threads = [threading.Thread(target=come_and_go) for _ in range(2)]
    for thread in threads:
        thread.start()
    for number in range(3000):
        take(Frame(b"", ANYTHING, seq=number))
    stopped.set()
    for thread in threads:
        thread.join(10)
    assert not failures
    assert [frame.seq for frame in stays] == list(range(3000))


@pytest.mark.one_process
def test_branches_come_and_go_in_a_pipeline() -> None:
    """t-stress: added and removed while playing; the branch that was there gets every frame."""
    text = "fakesrc num-buffers=5000 ! tee name=t ! queue ! appsink name=out max-buffers=8"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        numbers: list[int] = []

        def pull(count: int) -> None:
            numbers.extend(pipeline["out"].pull().seq for _ in range(count))

        for _ in range(5):
            added = pipeline.add_branch("t", "queue ! fakesink")
            pull(20)
            pulling = threading.Thread(target=pull, args=(200,))
            pulling.start()
            pipeline.remove_branch(added)
            pulling.join(20)
    assert numbers == list(range(len(numbers)))


@pytest.mark.one_process
def test_two_sinks_without_queues_do_not_preroll() -> None:
    """t-preroll: the first sink holds its frame, so the second never gets one: the pipeline stays ASYNC."""
    with Pipeline.parse("fakesrc ! tee name=t t. ! fakesink t. ! fakesink") as pipeline:
        assert pipeline.pause() is StateChange.ASYNC
        assert not pipeline.wait_prerolled(0.3)


def test_two_sinks_that_do_not_preroll_run() -> None:
    """t-preroll2: with async=false the same runs to EOS."""
    text = "fakesrc num-buffers=5 ! tee name=t t. ! fakesink async=false t. ! fakesink async=false"
    pipeline = Pipeline.parse(text)
    pipeline.run(timeout_s=10)
    assert [pipeline[f"fakesink{n}"].count for n in range(2)] == [5, 5]


class Gate(Sink):
    """Takes a frame whenever it is let."""

    sink = "ANY"

    def start(self) -> None:
        """Closed."""
        self.permits = threading.Semaphore(0)
        self.count = 0

    def render(self, frame: Frame) -> None:
        """Waits for a permit."""
        while not self.permits.acquire(timeout=0.05):
            if self.stopping.is_set():
                raise Flushing(self.name)
        self.count += 1


@pytest.mark.parametrize("leaky", [False, True])
def test_a_slow_branch(register: Register, leaky: bool) -> None:
    """t-slow, t-slow-leaky: it holds the others up through its queue, unless that leaks."""
    register(gate=Gate)
    leak = "leaky=downstream" if leaky else ""
    text = f"""fakesrc num-buffers=100 ! tee name=t
        t. ! queue max-size-buffers=1 {leak} name=q ! gate name=slow
        t. ! queue max-size-buffers=1 ! appsink name=fast max-buffers=0"""
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        fast, slow = pipeline["fast"], pipeline["slow"]
        if leaky:
            assert [frame.seq for frame in fast] == list(range(100))
        else:
            assert [fast.pull().seq for _ in range(2)] == [0, 1]
            assert fast.try_pull(0.1) is None
            slow.permits.release()
            assert fast.pull().seq == 2
        for _ in range(100):
            slow.permits.release()
        assert pipeline.wait(20) is not None
        dropped = sum(pipeline["q"].drops.values())
        assert slow.count + dropped == 100
        assert (dropped > 0) == leaky


def test_a_failing_branch_is_named(register: Register) -> None:
    """t-flow: the error of a branch reaches the application under the name of the element that failed."""

    class Fails(Sink):
        """Fails."""

        sink = "ANY"

        def render(self, frame: Frame) -> None:
            """Fails."""
            raise ValueError("bad")

    register(fails=Fails)
    with pytest.raises(ElementFailure, match=r"^fails0: ValueError: bad"):
        Pipeline.parse("fakesrc ! tee name=t t. ! queue ! fakesink t. ! fails").run(timeout_s=10)
