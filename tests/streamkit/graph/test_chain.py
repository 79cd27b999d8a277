"""Chains: what stands behind a src pad, composed once, counted, timed by samples."""

from collections import deque
from collections.abc import Callable, Iterable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from streamkit import Caps, ElementFailure, Frame, Pipeline, Property, Transform
from streamkit.element.registry import make_element
from streamkit.flow.events import Event
from streamkit.graph.chain import SAMPLE_EVERY, Chain

Register = Callable[..., None]
ANYTHING = Caps("a/b")


def test_a_chain_ends_at_the_first_element_that_is_no_transform() -> None:
    """Transforms run in one loop; the queue takes the frame over."""
    pipeline = Pipeline.parse(
        "fakesrc ! identity name=a ! a/b,x=1 ! identity name=b ! queue ! identity ! fakesink"
    )
    chain = Chain(pipeline["fakesrc0"].src_pad)
    assert [element.name for element in chain.transforms] == ["a", "capsfilter0", "b"]
    assert chain.terminal is pipeline["queue0"]


def test_an_open_end_is_not_linked() -> None:
    """The signal names the pad that has no peer; nothing is counted behind it."""
    from streamkit.flow.signals import NotLinked

    source, passing = make_element("fakesrc", "s"), make_element("identity", "i")
    source.pads["src"].link(passing.pads["sink"])
    chain = Chain(source.pads["src"])
    with pytest.raises(NotLinked, match=r"^i.src$"):
        chain.compose()(Frame(b"", ANYTHING))
    assert [element.name for element, _, _ in chain.received()] == ["i"]


class Twice(Transform):
    """Each frame two times, every third none."""

    sink = src = "ANY"

    def transform(self, frame: Frame) -> Iterable[Frame] | None:
        return None if frame.seq % 3 == 2 else (frame, frame)


def test_every_frame_is_counted_where_it_passes(register: Register) -> None:
    """In and out of each element agree with what it did, several and none included."""
    register(twice=Twice)
    with Pipeline.parse(
        "fakesrc num-buffers=300 ! identity silent=false ! twice ! identity ! fakesink"
    ) as pipeline:
        pipeline.run(timeout_s=30)
        rows = {row.element: (row.frames_in, row.frames_out) for row in pipeline.statistics()}
    assert rows == {
        "fakesrc0": (0, 300), "identity0": (300, 300), "twice0": (300, 400), "identity1": (400, 400),
        "fakesink0": (400, 0),
    }  # fmt: skip


def test_working_time_is_sampled(register: Register) -> None:
    """One frame in many is timed and stands for all."""

    class Slow(Transform):
        """Works for a while."""

        sink = src = "ANY"

        def transform(self, frame: Frame) -> Frame:
            sum(range(5000))
            return frame

    register(slow=Slow)
    with Pipeline.parse(f"fakesrc num-buffers={SAMPLE_EVERY * 2} ! slow ! fakesink") as pipeline:
        pipeline.run(timeout_s=30)
        busy = {row.element: row.busy_ns for row in pipeline.statistics()}
    assert busy["slow0"] > 2 * SAMPLE_EVERY * 5_000
    assert busy["slow0"] > busy["fakesink0"]


def test_an_error_downstream_is_not_renamed(register: Register) -> None:
    """The element that failed is named, however many chains and queues the error passes on its way."""

    class Fails(Transform):
        """Fails at once."""

        sink = src = "ANY"

        def transform(self, frame: Frame) -> Frame:
            raise OSError("lens cap on")

    register(fails=Fails, twice=Twice)
    with pytest.raises(ElementFailure, match=r"^f \(fails\): OSError: lens cap on \[at frame seq=0\]$"):
        Pipeline.parse(
            "fakesrc ! twice ! tee name=t t. ! identity ! fails name=f ! fakesink t. ! fakesink"
        ).run(10)


branches = st.lists(st.sampled_from(["identity", "queue", "queue max-size-buffers=1", "identity silent=false",
                                     "tee", "capsfilter caps=a/b,x=1"]), max_size=5)  # fmt: skip


@given(branches, st.lists(branches, min_size=1, max_size=3), st.integers(0, 70))
@settings(max_examples=25, deadline=None, derandomize=True)
def test_every_frame_arrives_once_and_in_order(trunk: list[str], tails: list[list[str]], count: int) -> None:
    """Whatever queues, tees and filters stand between: each sink gets every frame, in order, then EOS."""
    text = " ! ".join([f"fakesrc num-buffers={count}", *trunk, "tee name=t"])
    for number, tail in enumerate(tails):
        text += "  t. ! " + " ! ".join(["queue", *tail, f"appsink name=out{number} max-buffers=0"])
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        for number in range(len(tails)):
            assert [frame.seq for frame in pipeline[f"out{number}"]] == list(range(count)), text
        assert pipeline.wait(10) is not None


class Crops(Transform):
    """Hands on fewer rows than its caps say, in one of two ways."""

    sink = src = "video/x-raw, format=GRAY8"
    several: bool = Property(False, doc="Whether in a list.")

    def transform(self, frame: Frame) -> Frame | list[Frame]:
        cropped = frame.replace(data=frame.data[:2])
        return [cropped] if self.several else cropped


@pytest.mark.parametrize("several", [False, True])
def test_pixels_that_are_not_what_the_caps_say_are_an_error(register: Register, several: bool) -> None:
    """The element that made them is named, not the next one that stumbles."""
    register(crops=Crops)
    text = f"videotestsrc num-buffers=3 ! video/x-raw,width=8,height=4 ! crops several={several} ! fakesink"
    fault = r"^crops0: .*GRAY8 of 8 x 4 px is uint8\[4, 8\], got uint8\[2, 8\]: give the frame the caps"
    with pytest.raises(ElementFailure, match=fault):
        Pipeline.parse(text).run(timeout_s=30)


class Emptied:
    """A line that upstream empties whenever it is looked at for something special."""

    def __init__(self, frames: int, after: int) -> None:
        self.items: deque[Frame | Event] = deque(Frame(b"", ANYTHING, seq=n) for n in range(frames))
        self._after = after

    @property
    def care(self) -> int:
        """Nothing special, but frames are gone after so many looks."""
        self._after -= 1
        if self._after < 0:
            self.items.clear()
        return 0

    def weigh_out(self, frame: Frame) -> None:
        """Weighs nothing."""


@pytest.mark.parametrize("timed", [0, SAMPLE_EVERY + 1])
def test_a_line_emptied_from_upstream_is_no_failure(timed: int) -> None:
    """A queue that has just been made leaky may lose its oldest frames while a row of them is taken."""
    pipeline = Pipeline.parse("queue name=q ! fakesink name=s")
    chain = Chain(pipeline["q"].pads["src"])
    chain.compose()
    chain.due = timed
    pull = chain.src.pull
    assert pull is not None
    pull(Emptied(5, after=3 if timed else 2))
    assert chain.frames == (2 if timed else 1)
