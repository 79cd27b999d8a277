"""After an error the element that failed gets no frames and is not drained; others finish their work."""

from collections.abc import Callable, Iterable
from typing import ClassVar

import pytest

from streamkit import Caps, ElementFailure, Frame, Pipeline, Sink, StreamError, Transform

Register = Callable[..., None]


class Holding(Transform):
    """Holds the newest frame, as an encoder does; the held one comes out with the next, or at EOS."""

    sink = src = "ANY"
    held: Frame | None = None

    def transform(self, frame: Frame) -> Iterable[Frame]:
        before, self.held = self.held, frame
        return [] if before is None else [before]

    def drain(self) -> Iterable[Frame]:
        return [] if self.held is None else [self.held]


class Failing(Transform):
    """Fails at the third frame."""

    sink = src = "ANY"
    drained: ClassVar[list[str]] = []

    def transform(self, frame: Frame) -> Frame:
        if frame.seq == 2:
            raise StreamError("the third frame is wrong")
        return frame

    def drain(self) -> Iterable[Frame]:
        self.drained.append(self.name)
        return ()


class Journal(Sink):
    """Notes its calls; refuses caps with a width of 320."""

    sink = "ANY"
    calls: ClassVar[list[str]] = []

    def configure(self, sink_caps: Caps) -> None:
        if sink_caps["width"] == 320:
            raise StreamError("too small")

    def render(self, frame: Frame) -> None:
        self.calls.append(f"frame {frame.seq}")

    def drain(self) -> None:
        self.calls.append("drain")


@pytest.fixture(autouse=True)
def elements(register: Register) -> None:
    """The elements above, with nothing noted."""
    register(holding=Holding, failing=Failing, journal=Journal)
    Failing.drained, Journal.calls = [], []


@pytest.mark.parametrize("between", ["", "identity ! ", "queue ! "])
def test_a_sink_that_refuses_the_caps_gets_nothing(between: str) -> None:
    """Not even what an element before it gives at EOS."""
    text = f"videotestsrc num-buffers=3 ! video/x-raw,width=320 ! holding ! {between}journal"
    with pytest.raises(ElementFailure, match="too small"):
        Pipeline.parse(text).run(20)
    assert Journal.calls == []


def test_an_element_that_failed_is_not_drained_and_what_is_behind_it_is() -> None:
    """A file behind it is completed with the frames that came."""
    with pytest.raises(ElementFailure, match="the third frame is wrong"):
        Pipeline.parse("videotestsrc num-buffers=9 ! video/x-raw,width=64 ! holding ! failing ! journal").run(
            20
        )
    assert Failing.drained == []
    assert Journal.calls == ["frame 0", "frame 1", "drain"]


def test_the_next_run_begins_without_the_failure() -> None:
    """A pipeline can be played again."""
    pipeline = Pipeline.parse("videotestsrc num-buffers=9 ! video/x-raw,width=64 ! failing name=f ! journal")
    for _ in range(2):
        with pytest.raises(ElementFailure, match="the third frame is wrong"):
            pipeline.run(20)
    assert Journal.calls == ["frame 0", "frame 1", "drain"] * 2
