"""Sources: numbering, caps, EOS, errors, and pausing."""

import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from streamkit import (
    Caps,
    ElementFailure,
    Frame,
    NotNegotiated,
    Pipeline,
    Presence,
    Property,
    Source,
    Transform,
)
from streamkit.errors import ResourceError

RAW = Caps("video/x-raw, format=GRAY8, width=4, height=2, framerate=25/1")
Register = Callable[..., None]


class Counter(Source):
    """Frames that say nothing about themselves."""

    src = "ANY"
    total: int = Property(3)

    def frames(self) -> Iterator[Frame]:
        for _ in range(self.total):
            yield Frame(b"", RAW)


def run_to_end(text: str) -> list[Frame]:
    """All frames that reach the appsink `out`."""
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        return list(pipeline["out"])


def test_the_engine_fills_in_number_and_arrival(register: Register) -> None:
    """Numbers count from 0; the arrival is on the pipeline's clock; caps of equal text become one object."""
    register(counter=Counter)
    frames = run_to_end("counter total=4 ! appsink name=out")
    assert [frame.seq for frame in frames] == [0, 1, 2, 3]
    assert all(frame.arrival_ns > 0 for frame in frames)
    assert len({id(frame.caps) for frame in frames}) == 1


@pytest.mark.parametrize(
    ("item", "kind"), [(np.zeros((2, 4), np.uint8), "ndarray"), (("src", b""), "tuple"), (False, "bool")]
)
def test_what_is_no_frame_is_refused(register: Register, item: Any, kind: str) -> None:
    """Rather than lost; the error says what a source yields."""

    class Bare(Source):
        """Yields data without a frame."""

        src = "ANY"

        def frames(self) -> Iterator[Any]:
            yield item

    register(bare=Bare)
    rule = rf"frames\(\) yields Frame, \(pad name, Frame\) or Event, got {kind}: put data into a frame"
    with pytest.raises(ElementFailure, match=rule):
        run_to_end("bare ! appsink name=out")


@pytest.mark.parametrize(
    ("made", "rule"),
    [
        (None, r"frames\(\) must yield frames, as a generator does, got NoneType"),
        ([Frame(b"", "a/b")], r"the caps of a frame must be Caps, got 'a/b': write Caps\('a/b'\)"),  # type: ignore[arg-type]
    ],
)
def test_what_a_beginner_forgets_is_named(register: Register, made: Any, rule: str) -> None:
    """A `yield`; that caps are no text."""

    class Beginners(Source):
        """Lacks something."""

        src = "ANY"

        def frames(self) -> Any:
            return made

    register(beginners=Beginners)
    with pytest.raises(ElementFailure, match=rule):
        run_to_end("beginners ! appsink name=out")


def test_numbers_and_arrival_times_of_the_source_are_kept(register: Register) -> None:
    """The engine does not overwrite them."""

    class Numbered(Source):
        """Its own numbers."""

        src = "ANY"

        def frames(self) -> Iterator[Frame]:
            yield Frame(b"", RAW, seq=7, arrival_ns=11)
            yield Frame(b"", RAW, seq=9, arrival_ns=13)

    register(numbered=Numbered)
    frames = run_to_end("numbered ! appsink name=out")
    assert [(frame.seq, frame.arrival_ns) for frame in frames] == [(7, 11), (9, 13)]


def test_every_run_begins_anew(register: Register) -> None:
    """fs-reuse: the pipeline sends the same frames again after EOS and stop."""
    register(counter=Counter)
    pipeline = Pipeline.parse("counter ! queue ! appsink name=out")
    for _ in range(3):
        with pipeline:
            pipeline.play()
            assert [frame.seq for frame in pipeline["out"]] == [0, 1, 2]


def test_negotiate_gets_the_caps_that_downstream_accepts(register: Register) -> None:
    """In the order of downstream."""
    asked: list[str] = []

    class Choosy(Counter):
        """Takes the first offer."""

        src = "video/x-raw, format={ GRAY8, BGR }"

        def negotiate(self, allowed: Caps) -> Caps | None:
            asked.append(str(allowed))
            return super().negotiate(allowed)

        def frames(self) -> Iterator[Frame]:
            yield Frame(b"", self.src_caps)

    register(choosy=Choosy)
    (frame,) = run_to_end("choosy ! video/x-raw, format={ BGR, GRAY8, RGB }, width=2 ! appsink name=out")
    assert asked == ["video/x-raw, format=(string){ BGR, GRAY8 }, width=(int)2"]
    assert str(frame.caps) == "video/x-raw, format=(string)BGR, width=(int)2"


def test_downstream_is_configured_once_the_size_is_known(register: Register) -> None:
    """A camera that declares its format alone is no trouble for an element that needs the size."""
    configured: list[str] = []

    class Grey(Counter):
        """Frames of a size that is not declared."""

        src = "video/x-raw, format=GRAY8"

        def frames(self) -> Iterator[Frame]:
            yield Frame(np.zeros((2, 4), np.uint8), RAW)

    class Sized(Transform):
        """Needs the size."""

        sink = src = "video/x-raw, format=GRAY8"

        def configure(self, sink_caps: Caps, src_caps: Caps) -> None:
            configured.append(f"{sink_caps['width']} x {src_caps['height']}")

        def transform(self, frame: Frame) -> Frame:
            return frame

    register(grey=Grey, sized=Sized)
    assert len(run_to_end("grey ! sized ! appsink name=out")) == 1
    assert configured == ["4 x 2"]


def test_caps_known_from_the_data_only_are_checked(register: Register) -> None:
    """The first frame decides the caps; a refusal names pads, caps and field."""

    class Unknown(Counter):
        """Only the data tells."""

        src = "video/x-raw"

        def negotiate(self, allowed: Caps) -> Caps | None:
            return None

    register(unknown=Unknown)
    assert [frame.caps for frame in run_to_end("unknown total=1 ! appsink name=out")] == [RAW]
    with pytest.raises(
        NotNegotiated,
        match=r"unknown0.src -> capsfilter0.sink: not negotiated, the pads disagree on width: "
        r"unknown0.src offers .*width=\(int\)4.*; capsfilter0.sink takes video/x-raw, width=\(int\)8",
    ):
        Pipeline.parse("unknown ! video/x-raw, width=8 ! fakesink").run(timeout_s=10)


def test_new_caps_in_the_middle_go_downstream_before_their_frame(register: Register) -> None:
    """q-order: each frame arrives with its caps, through a queue too."""

    class Growing(Source):
        """Two sizes."""

        src = "video/x-raw"

        def negotiate(self, allowed: Caps) -> Caps | None:
            return None

        def frames(self) -> Iterator[Frame]:
            for width in (2, 2, 4, 4):
                yield Frame(b"", RAW.with_fields(width=width))

    register(growing=Growing)
    frames = run_to_end("growing ! queue ! identity ! appsink name=out")
    assert [frame.caps["width"] for frame in frames] == [2, 2, 4, 4]


def test_an_exception_names_the_source(register: Register) -> None:
    """Whatever `frames` raises becomes an ElementFailure with element and cause; `stop` still runs."""
    stopped = threading.Event()

    class Broken(Counter):
        """Fails after one frame."""

        def frames(self) -> Iterator[Frame]:
            yield Frame(b"", RAW)
            raise ZeroDivisionError("bad arithmetic")

        def stop(self) -> None:
            stopped.set()

    register(broken=Broken)
    with pytest.raises(
        ElementFailure, match=r"^cam \(broken\): ZeroDivisionError: bad arithmetic$"
    ) as caught:
        Pipeline.parse("broken name=cam ! fakesink").run(timeout_s=10)
    assert (caught.value.element, caught.value.factory) == ("cam", "broken")
    assert isinstance(caught.value.cause, ZeroDivisionError)
    assert stopped.is_set()


def test_the_text_of_a_resource_error_is_kept(register: Register) -> None:
    """It follows the name of the element."""

    class Missing(Counter):
        """No such file."""

        def start(self) -> None:
            raise ResourceError("cannot open x.mp4: no such file")

    register(missing=Missing)
    with pytest.raises(ElementFailure, match=r"^missing0: cannot open x.mp4: no such file$"):
        Pipeline.parse("missing ! fakesink").run(timeout_s=10)


def test_a_blocked_source_is_woken_by_interrupt(register: Register) -> None:
    """`stop` calls `interrupt` from another thread; the generator is closed."""
    waiting, closed = threading.Event(), threading.Event()

    class Blocked(Counter):
        """Waits for a peer that never comes."""

        def __init__(self, name: str = "", **properties: Any) -> None:
            self.woken = threading.Event()
            super().__init__(name, **properties)

        def frames(self) -> Iterator[Frame]:
            try:
                yield Frame(b"", RAW)
                waiting.set()
                assert self.woken.wait(10)
                yield Frame(b"", RAW)
            finally:
                closed.set()

        def interrupt(self) -> None:
            self.woken.set()

    register(blocked=Blocked)
    with Pipeline.parse("blocked ! fakesink") as pipeline:
        pipeline.play()
        assert waiting.wait(10)
    assert closed.is_set()


@pytest.mark.parametrize("presence", Presence)
def test_a_source_may_feed_several_pads(register: Register, presence: Presence) -> None:
    """(pad name, frame) pairs; each pad numbers its frames; unlinked pads, there or not, are skipped."""
    from streamkit import Direction, PadTemplate

    class Two(Source):
        """Pictures and telemetry."""

        templates = (
            PadTemplate("video", Direction.SRC, RAW),
            PadTemplate("data", Direction.SRC, Caps("meta/x-klv"), presence),
        )

        def negotiate(self, allowed: Caps) -> Caps | None:
            return None

        def frames(self) -> Iterator[Frame | tuple[str, Frame]]:
            for _ in range(2):
                yield "data", Frame(b"k", Caps("meta/x-klv"))
                yield Frame(b"v", RAW)

    register(two=Two)
    with Pipeline.parse("two name=s  s.video ! appsink name=v  s.data ! appsink name=d") as pipeline:
        pipeline.play()
        assert [(frame.seq, frame.data) for frame in pipeline["v"]] == [(0, b"v"), (1, b"v")]
        assert [(frame.seq, frame.data) for frame in pipeline["d"]] == [(0, b"k"), (1, b"k")]
    assert len(run_to_end("two name=s  s.video ! appsink name=out")) == 2


def test_pause_holds_a_live_source() -> None:
    """No frame is lost or sent while paused; `finish` ends with EOS."""
    with Pipeline.parse("fakesrc ! appsink name=out max-buffers=1") as pipeline:
        pipeline.play()
        before = pipeline["out"].pull().seq
        pipeline.pause()
        pipeline.play()
        after = pipeline["out"].pull().seq
        assert after == before + 1
        pipeline.finish()
        rest = [frame.seq for frame in pipeline["out"]]
        assert rest == list(range(after + 1, after + 1 + len(rest)))
        assert len(rest) <= 3
