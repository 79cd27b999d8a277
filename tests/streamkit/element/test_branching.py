"""Combine and Split."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
import pytest

from streamkit import (
    Caps,
    Combine,
    Direction,
    ElementFailure,
    Frame,
    PadTemplate,
    Pipeline,
    Presence,
    Split,
    raw_video_caps,
)
from streamkit.flow.caps import ANY

Register = Callable[..., None]


class Join(Combine):
    """Frames of all inputs, marked with their pad."""

    src = "ANY"
    templates = (PadTemplate("sink_%u", Direction.SINK, ANY, Presence.REQUEST),)

    def combine(self, pad_name: str, frame: Frame) -> Frame | None:
        return frame.replace(data=pad_name)


class EvenOdd(Split):
    """Even numbers to one pad, odd ones to the other."""

    sink = "ANY"
    templates = (PadTemplate("even", Direction.SRC, ANY), PadTemplate("odd", Direction.SRC, ANY))

    def split(self, frame: Frame) -> Mapping[str, Frame]:
        return {"odd" if frame.seq % 2 else "even": frame}


def test_all_inputs_come_out_and_eos_once(register: Register) -> None:
    """f-pipe: frames of both sources, each in its order, and EOS after the last input has ended."""
    register(join=Join)
    text = """join name=j ! appsink name=out
              fakesrc num-buffers=3 ! queue ! j.  fakesrc num-buffers=5 ! queue ! j."""
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        frames = list(pipeline["out"])
        assert pipeline.wait(10) is not None
    for pad, count in (("sink_0", 3), ("sink_1", 5)):
        assert [f.seq for f in frames if f.data == pad] == list(range(count))
    assert len(frames) == 8


def test_drained_frames_precede_eos(register: Register) -> None:
    """`drain` runs once, when every input has ended."""

    class Pairs(Join):
        """Holds everything back."""

        def start(self) -> None:
            self.held: list[Frame] = []

        def combine(self, pad_name: str, frame: Frame) -> Frame | None:
            self.held.append(frame)
            return None

        def drain(self) -> Iterable[Frame]:
            return self.held

    register(pairs=Pairs)
    text = "pairs name=j ! appsink name=out  fakesrc num-buffers=2 ! j.  fakesrc num-buffers=2 ! j."
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        assert sorted(f.seq for f in pipeline["out"]) == [0, 0, 1, 1]


@pytest.mark.parametrize("moment", ["combine", "drain"])
def test_an_exception_names_the_combine(register: Register, moment: str) -> None:
    """Not the source whose thread runs it."""

    class Fails(Join):
        """Fails at one moment."""

        def combine(self, pad_name: str, frame: Frame) -> Frame | None:
            if moment == "combine":
                raise ValueError("sizes differ")
            return None

        def drain(self) -> Iterable[Frame]:
            if moment == "drain":
                raise ValueError("sizes differ")
            return ()

    register(fails=Fails)
    with pytest.raises(ElementFailure, match=r"^fails0: ValueError: sizes differ"):
        Pipeline.parse("fakesrc num-buffers=1 ! fails ! fakesink").run(timeout_s=10)


def test_a_split_sends_each_frame_to_its_pad(register: Register) -> None:
    """os-count: each output gets exactly its frames, and every output EOS."""
    register(evenodd=EvenOdd)
    text = "fakesrc num-buffers=5 ! evenodd name=s  s.even ! appsink name=a  s.odd ! queue ! appsink name=b"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        assert [f.seq for f in pipeline["a"]] == [0, 2, 4]
        assert [f.seq for f in pipeline["b"]] == [1, 3]


def test_a_split_offers_the_caps_common_to_all_outputs(register: Register) -> None:
    """os-nego-mode1: the intersection of all peers."""
    register(evenodd=EvenOdd)
    pipeline = Pipeline.parse(
        "fakesrc ! evenodd name=s  s.even ! a/b,x=[1,5],y=2 ! fakesink  s.odd ! a/b,x=[3,9] ! fakesink"
    )
    assert pipeline["s"].pads["sink"].query_caps() == Caps("a/b, x=[ 3, 5 ], y=2")


def test_an_error_at_eos_takes_precedence_over_an_end(register: Register) -> None:
    """t-flow: one output fails, another ends; the failure is raised."""
    from streamkit import EndOfStream, Sink

    class Fails(Sink):
        """Fails at EOS."""

        sink = "ANY"

        def render(self, frame: Frame) -> None:
            """Takes it."""

        def drain(self) -> None:
            raise ValueError("disk full")

    class Full(Fails):
        """Wants no more."""

        def drain(self) -> None:
            raise EndOfStream(self.name)

    register(evenodd=EvenOdd, fails=Fails, full=Full)
    with pytest.raises(ElementFailure, match=r"^fails0: ValueError: disk full"):
        Pipeline.parse("fakesrc num-buffers=2 ! evenodd name=s s.even ! fails s.odd ! full").run(timeout_s=10)


@pytest.mark.parametrize(
    ("returned", "rule"),
    [
        ({"third": Frame(b"", Caps("a/b"))}, "'third', which Wrong does not declare; it has even, odd"),
        (Frame(b"", Caps("a/b")), "split returns frames by the name of their pad, got Frame: write"),
        ({"even": np.zeros(3)}, "split gives frames, got ndarray: put data into a frame"),
        ({"even": Frame(np.zeros(3), raw_video_caps("GRAY8", 3, 1))}, "GRAY8 of 3 x 1 px is uint8"),
    ],
)
def test_what_no_pad_of_a_split_can_take_is_an_error(register: Register, returned: Any, rule: str) -> None:
    """It would be lost without a word."""

    class Wrong(EvenOdd):
        """Returns something else."""

        def split(self, frame: Frame) -> Any:
            return returned

    register(wrong=Wrong)
    with pytest.raises(ElementFailure, match=rule):
        Pipeline.parse("fakesrc num-buffers=1 ! wrong name=w  w.even ! fakesink  w.odd ! fakesink").run(
            timeout_s=20
        )


@pytest.mark.parametrize("returned", [np.zeros((2, 3)), "text", [b"row"]])
def test_what_is_no_frame_of_a_combine_is_an_error(register: Register, returned: Any) -> None:
    """An array has no truth value, and a text no caps: the error says what to return."""

    class Wrong(Join):
        """Returns something else."""

        def combine(self, pad_name: str, frame: Frame) -> Any:
            return returned

    register(wrong=Wrong)
    with pytest.raises(ElementFailure, match=r"combine gives frames, got (ndarray|str|bytes): put data into"):
        Pipeline.parse("wrong name=w ! fakesink  fakesrc num-buffers=1 ! w.").run(timeout_s=20)
