"""Chains: the transforms behind a src pad, called, counted and timed in one loop."""

import re
import time
from collections.abc import Callable, Iterable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from streamkit import (
    Caps,
    Direction,
    ElementFailure,
    Frame,
    PadTemplate,
    Pipeline,
    Property,
    Transform,
    raw_video_caps,
)
from streamkit.element.registry import make_element
from streamkit.graph.chain import Chain

Register = Callable[..., None]
ANYTHING = Caps("a/b")


def test_a_chain_ends_at_the_first_element_that_is_no_transform() -> None:
    """Transforms run in one loop; the queue takes the frame over."""
    pipeline = Pipeline.parse(
        "fakesrc ! identity name=a ! a/b,x=1 ! identity name=b ! queue ! identity ! fakesink"
    )
    chain = Chain(pipeline["fakesrc0"].src_pad)
    assert [stage.element.name for stage in chain.stages] == ["a", "capsfilter0", "b", "queue0"]
    assert chain.stages[-1].is_terminal


def test_an_unlinked_end_raises_not_linked() -> None:
    """The exception names the pad."""
    from streamkit.flow.events import NotLinked

    source, passing = make_element("fakesrc", "s"), make_element("identity", "i")
    source.pads["src"].link(passing.pads["sink"])
    chain = Chain(source.pads["src"])
    with pytest.raises(NotLinked, match=r"^i.src$"):
        chain.push(Frame(b"", ANYTHING))
    assert [stage.element.name for stage, _ in chain.received()] == ["i"]


def test_an_element_that_raises_at_an_event_is_named(register: Register) -> None:
    """Not the element before it; EOS, at which it raises again, ends the thread without a traceback."""

    def fail(*_: object) -> None:
        raise ValueError("no such table")

    register(picky=type("Picky", (Transform,), {"sink": ANYTHING, "src": ANYTHING, "receive_event": fail}))
    with (
        Pipeline.parse("fakesrc ! queue ! picky ! fakesink") as pipeline,
        pytest.raises(ElementFailure, match=r"^picky0: ValueError: no such table$") as caught,
    ):
        pipeline.run(timeout_s=20)
    assert caught.value.place.startswith("test_chain.py:")


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


def test_working_time_is_that_of_each_element(register: Register) -> None:
    """Every frame is timed, each element by itself."""

    class Slow(Transform):
        """Works for a while."""

        sink = src = "ANY"

        def transform(self, frame: Frame) -> Frame:
            time.sleep(0.05)
            return frame

    register(slow=Slow)
    with Pipeline.parse("fakesrc num-buffers=4 ! slow ! fakesink") as pipeline:
        pipeline.run(timeout_s=30)
        busy = {row.element: row.busy_ns for row in pipeline.statistics()}
    assert busy["slow0"] >= 4 * 50_000_000
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
@settings(max_examples=25)
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
    """Returns fewer rows than its caps say, in one of two ways."""

    sink = src = "video/x-raw, format=GRAY8"
    several: bool = Property(False, doc="Whether in a list.")

    def transform(self, frame: Frame) -> Frame | list[Frame]:
        cropped = frame.replace(data=frame.data[:2])
        return [cropped] if self.several else cropped


@pytest.mark.parametrize("several", [False, True])
def test_an_array_that_contradicts_its_caps_is_an_error(register: Register, several: bool) -> None:
    """Of the element that made it."""
    register(crops=Crops)
    text = f"videotestsrc num-buffers=3 ! video/x-raw,width=8,height=4 ! crops several={several} ! fakesink"
    fault = r"^crops0: .*GRAY8 of 8 x 4 px is uint8\[4, 8\], got uint8\[2, 8\]: give the frame the caps"
    with pytest.raises(ElementFailure, match=fault):
        Pipeline.parse(text).run(timeout_s=30)


@pytest.mark.parametrize("tail", ["videoconvert ! video/x-raw,format=BGR ! fakesink", "stitch ! fakesink"])
@pytest.mark.parametrize(
    ("data", "fault"),
    [
        ([[0] * 8] * 4, "got list: make it an array, as np.array"),
        (bytes(32), "got bytes: make .* np.frombuffer"),
    ],
)
def test_raw_video_that_is_no_array_is_explained(tail: str, data: object, fault: str) -> None:
    """An element that fails at it says what the frame should hold, not what its own code ran into."""
    with Pipeline.parse(f"appsrc name=in ! {tail}") as pipeline:
        pipeline.play()
        pipeline["in"].push(Frame(data, raw_video_caps("GRAY8", 8, 4)))
        message = pipeline.wait(30)
    assert message is not None
    assert re.search(rf"GRAY8 of 8 x 4 px is uint8\[4, 8\], {fault}", message.text)


class Masks(Transform):
    """Forwards each frame, and every second one through another pad as well."""

    sink = src = "ANY"
    templates = (PadTemplate("mask", Direction.SRC),)

    def transform(self, frame: Frame) -> Iterable[Frame | tuple[str, Frame]]:
        if frame.seq % 2:
            yield "mask", frame
        yield frame


def test_a_transform_may_feed_several_pads(register: Register) -> None:
    """A pair of a pad's name and a frame goes to that pad, with the caps and the end of the stream."""
    register(masks=Masks)
    text = "fakesrc num-buffers=6 ! a/b,x=1 ! masks name=m ! appsink name=out  m.mask ! appsink name=masks"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        assert [frame.seq for frame in pipeline["out"]] == [0, 1, 2, 3, 4, 5]
        assert [frame.seq for frame in pipeline["masks"]] == [1, 3, 5]
        assert str(pipeline["masks"].sink_caps) == "a/b, x=(int)1"


def test_a_failure_names_the_input_frame_of_the_stage(register: Register) -> None:
    """Not the frame before it."""

    class Third(Transform):
        """Fails at the third frame."""

        sink = src = "ANY"

        def transform(self, frame: Frame) -> Frame:
            if frame.seq == 2:
                raise ValueError("no more")
            return frame

    register(third=Third)
    with pytest.raises(ElementFailure, match=r"^third0: ValueError: no more \[at frame seq=2\]$"):
        Pipeline.parse("fakesrc ! third ! queue ! fakesink").run(10)
