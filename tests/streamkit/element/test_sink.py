"""Sinks: order of calls, errors, and synchronisation."""

from collections.abc import Callable

import numpy as np
import pytest

from streamkit import Caps, ElementFailure, Frame, MessageKind, NotNegotiated, Pipeline, Sink
from streamkit.flow.events import Flushing
from streamkit.testing import Harness, ManualClock

Register = Callable[..., None]
ANYTHING = Caps("a/b")


class Keeping(Sink):
    """Keeps what it is given."""

    sink = "ANY"

    def start(self) -> None:
        self.kept: list[object] = []

    def configure(self, sink_caps: Caps) -> None:
        self.kept.append(str(sink_caps))

    def render(self, frame: Frame) -> None:
        self.kept.append(frame.seq)

    def drain(self) -> None:
        self.kept.append("drained")


def test_caps_then_frames_then_drain() -> None:
    """The order of calls; EOS is reported once."""
    with Harness(Keeping("k")) as harness:
        harness.push(Frame(b"", ANYTHING, seq=0))
        harness.push(Frame(b"", ANYTHING, seq=1))
        harness.drain()
        harness.drain()
        kept, kinds = harness.element.kept, [str(m.kind) for m in harness.messages]  # type: ignore[attr-defined]
    assert kept == ["a/b", 0, 1, "drained"]
    assert kinds == ["eos"]


@pytest.mark.parametrize("moment", ["render", "configure", "drain"])
def test_an_exception_names_the_sink(register: Register, moment: str) -> None:
    """In any call; with the frame in `render`."""

    class Fails(Keeping):
        """Fails at one moment."""

        def render(self, frame: Frame) -> None:
            if moment == "render":
                raise ValueError("disk full")

        def configure(self, sink_caps: Caps) -> None:
            if moment == "configure":
                raise ValueError("disk full")

        def drain(self) -> None:
            if moment == "drain":
                raise ValueError("disk full")

    register(fails=Fails)
    where = r" \[at frame seq=0\]" if moment == "render" else ""
    with pytest.raises(ElementFailure, match=rf"^fails0: ValueError: disk full{where}$"):
        Pipeline.parse("fakesrc num-buffers=2 ! a/b,x=1 ! fails").run(timeout_s=10)


def test_caps_a_sink_cannot_take_are_refused() -> None:
    """nego-push: caps outside the template."""

    class Raw(Keeping):
        """Raw video only."""

        sink = "video/x-raw"

    with (
        Harness(Raw("r")) as harness,
        pytest.raises(
            NotNegotiated, match=r"disagree on media type: feed_sink.src offers a/b; r.sink takes video/x-raw"
        ),
    ):
        harness.push(Frame(b"", ANYTHING))


def test_sync_waits_for_each_frames_time(register: Register) -> None:
    """sk-sync: running time starts at the first frame; later ones wait for their timestamps."""
    register(keeping=Keeping)
    clock = ManualClock()
    with Pipeline.parse("appsrc name=in ! keeping name=k sync=true", clock=clock) as pipeline:
        pipeline.play()
        for seq, pts in enumerate((0, 2_000_000_000)):
            pipeline["in"].push(Frame(b"", ANYTHING, seq=seq, arrival_ns=1, pts=pts))
        assert clock.wait_for_waiter()
        clock.advance(1.9)
        assert pipeline["k"].kept == ["a/b", 0]
        clock.advance(0.1)
        pipeline["in"].end()
        assert pipeline.wait(10) is not None
        assert pipeline["k"].kept == ["a/b", 0, 1, "drained"]


@pytest.mark.parametrize(
    "text", ["keeping name=k sync=true ts-offset={}", "identity sync=true ts-offset={} ! keeping name=k"]
)
def test_an_offset_delays_the_first_frame_too(register: Register, text: str) -> None:
    """As in GStreamer, though running time starts with that frame."""
    register(keeping=Keeping)
    clock = ManualClock()
    with Pipeline.parse("appsrc name=in ! " + text.format(3_000_000_000), clock=clock) as pipeline:
        pipeline.play()
        pipeline["in"].push(Frame(b"", ANYTHING, seq=0, arrival_ns=1, pts=0))
        assert clock.wait_for_waiter()
        assert pipeline["k"].kept == ["a/b"]
        clock.advance(3)
        pipeline["in"].end()
        assert pipeline.wait(10) is not None
        assert pipeline["k"].kept == ["a/b", 0, "drained"]


def test_a_new_epoch_restarts_running_time() -> None:
    """Timestamps restart after a discontinuity without a wait."""
    clock = ManualClock()
    with Harness(Keeping("k", sync=True), clock=clock) as harness:
        harness.push(Frame(b"", ANYTHING, seq=0, pts=0))
        harness.push(Frame(b"", ANYTHING, seq=1, pts=10**15, epoch=1))
        harness.push(Frame(b"", ANYTHING, seq=2, pts=None, epoch=1))
        assert harness.element.kept == ["a/b", 0, 1, 2]  # type: ignore[attr-defined]


def test_stop_ends_the_wait(register: Register) -> None:
    """id-stop: a frame that is due in the far future does not delay the stop and is not rendered."""
    register(keeping=Keeping)
    clock = ManualClock()
    with Pipeline.parse("appsrc name=in ! keeping name=k sync=true", clock=clock) as pipeline:
        pipeline.play()
        for seq, pts in enumerate((0, 10**15)):
            pipeline["in"].push(Frame(b"", ANYTHING, seq=seq, arrival_ns=1, pts=pts))
        assert clock.wait_for_waiter()
    assert pipeline["k"].kept == ["a/b", 0]


@pytest.mark.parametrize("pts", [float("nan"), 1.5, "1"])
@pytest.mark.parametrize("properties", [{}, {"sync": True}])
def test_a_time_that_is_not_an_integer_is_an_error(pts: object, properties: dict[str, bool]) -> None:
    """Every sink refuses it, with and without `sync`; None and integers of NumPy are accepted."""
    with Harness(Keeping("k", **properties)) as harness:
        harness.push(Frame(b"", ANYTHING, seq=1))
        harness.push(Frame(b"", ANYTHING, pts=np.int64(5), seq=2))  # type: ignore[arg-type]
        with pytest.raises(ElementFailure, match="the pts of a frame must be an integer, ns, or None"):
            harness.push(Frame(b"", ANYTHING, pts=pts))  # type: ignore[arg-type]
        assert harness.element.kept == ["a/b", 1, 2]  # type: ignore[attr-defined]


def test_a_sink_gets_times_of_numpy_as_plain_integers() -> None:
    """A file or a message takes no other; nothing but the time changes."""
    with Pipeline.parse("appsrc name=in ! identity ! appsink name=out") as pipeline:
        pipeline.play()
        pipeline["in"].push(Frame(b"x", ANYTHING, pts=np.int64(5)))  # type: ignore[arg-type]
        pipeline["in"].end()
        (frame,) = pipeline["out"]
    assert (frame.data, frame.pts, type(frame.pts)) == (b"x", 5, int)


def test_frames_before_the_first_are_told_of_once() -> None:
    """They are dropped and counted; that their times descend is a fault of the program."""
    warned: list[str] = []
    with Pipeline.parse("appsrc name=in ! appsink name=out") as pipeline:
        pipeline.bus.watch(
            lambda message: warned.append(message.text) if message.kind is MessageKind.WARNING else None
        )
        pipeline.play()
        for pts in (10**9, 96 * 10**7, 92 * 10**7):
            pipeline["in"].push(Frame(b"", ANYTHING, pts=pts))
        pipeline["in"].end()
        assert [frame.pts for frame in pipeline["out"]] == [10**9]
        assert pipeline["out"].drops == {"outside the segment": 2}
    assert [text.partition(", and")[0] for text in warned] == [
        "a frame at 0.960 s is outside the stream, which begins at 1.000 s"
    ]


def test_a_frame_that_comes_amid_a_flush_is_not_waited_for() -> None:
    """Its wait would end at once, again and again, until the flush ends; the flush waits for its thread."""
    sink = Keeping("k", sync=True)
    sink.flush(begins=True)
    with pytest.raises(Flushing):
        sink.receiver(sink.pads["sink"])(Frame(b"", ANYTHING, pts=0))


def test_no_wait_blocks_again_once_the_pipeline_stops() -> None:
    """A flush in another thread may end at that moment."""
    sink = Keeping("k")
    sink.halt()
    sink.flush(begins=True)
    sink.flush(begins=False)
    assert not sink.wait_on_clock(sink.clock_ns() + 3600 * 10**9)
