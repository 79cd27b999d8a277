"""fakesrc and fakesink, as behaviour.md tells."""

import threading
from collections.abc import Callable
from typing import Any

import pytest

from streamkit import Caps, ElementFailure, EndOfStream, Frame, Pipeline
from streamkit.elements.fakesink import FakeSink
from streamkit.elements.fakesrc import FakeSrc
from streamkit.flow.events import EOS, FLUSH_START, FLUSH_STOP, CapsEvent, GapEvent, Segment, SegmentEvent
from streamkit.flow.messages import MessageKind
from streamkit.graph.pipeline import State, StateChange
from streamkit.testing import ManualClock

Register = Callable[..., None]
A = Caps("a/b")
SECOND = 1_000_000_000


def frame(number: int = 0, **fields: Any) -> Frame:
    """A frame."""
    return Frame(b"", A, seq=number, arrival_ns=1, **fields)


def made(text: str) -> list[Frame]:
    """The frames of a source."""
    with Pipeline.parse(f"{text} ! appsink name=out max-buffers=0") as pipeline:
        pipeline.play()
        return list(pipeline["out"])


@pytest.mark.parametrize("count", [3, 0])
def test_number_of_frames(count: int) -> None:
    """fs-num: exactly so many, then EOS; 0 is EOS at once."""
    assert [item.seq for item in made(f"fakesrc num-buffers={count}")] == list(range(count))


def test_without_end() -> None:
    """fs-num: -1 never ends."""
    assert FakeSrc().num_buffers == -1
    with Pipeline.parse("fakesrc num-buffers=-1 ! appsink name=out") as pipeline:
        pipeline.play()
        assert [pipeline["out"].pull().seq for _ in range(300)] == list(range(300))


def test_frames_are_empty() -> None:
    """fs-empty: by default."""
    assert [item.data for item in made("fakesrc num-buffers=2")] == [b"", b""]


def test_frames_of_one_size() -> None:
    """fs-fixed: all of 8192 bytes."""
    assert [len(item.data) for item in made("fakesrc num-buffers=3 sizetype=fixed sizemax=8192")] == [
        8192
    ] * 3


def test_frames_of_any_size() -> None:
    """fs-random: within the bounds, and not all the same."""
    sizes = [
        len(item.data) for item in made("fakesrc num-buffers=30 sizetype=random sizemin=4096 sizemax=8192")
    ]
    assert all(4096 <= size <= 8192 for size in sizes)
    assert len(set(sizes)) > 1


@pytest.mark.parametrize(
    ("fill", "first", "second"),
    [("zero", [0, 0, 0], [0, 0, 0]), ("nothing", [0, 0, 0], [0, 0, 0]), ("pattern", [0, 1, 2], [0, 1, 2]),
     ("pattern-span", [0, 1, 2], [3, 4, 5])],
)  # fmt: skip
def test_content(fill: str, first: list[int], second: list[int]) -> None:
    """filltype: what the bytes are."""
    one, other = made(f"fakesrc num-buffers=2 sizetype=fixed sizemax=3 filltype={fill}")
    assert (list(one.data), list(other.data)) == (first, second)


def test_parts_of_a_whole() -> None:
    """data=subbuffer: frames share the bytes of a larger one."""
    frames = made(
        "fakesrc num-buffers=5 sizetype=fixed sizemax=4 data=subbuffer parentsize=8 filltype=pattern"
    )
    assert [bytes(item.data) for item in frames] == [
        b"\0\1\2\3", b"\4\5\6\7", b"\0\1\2\3", b"\4\5\6\7", b"\0\1\2\3",
    ]  # fmt: skip


def test_stamps() -> None:
    """datarate: 100 bytes at 1000 a second are 0.1 s; do-timestamp is the running time."""
    frames = made("fakesrc num-buffers=3 sizetype=fixed sizemax=100 datarate=1000")
    assert [(item.pts, item.duration) for item in frames] == [
        (n * SECOND // 10, SECOND // 10) for n in range(3)
    ]
    assert made("fakesrc num-buffers=1 do-timestamp=true")[0].pts is not None


def test_a_live_source_does_not_preroll() -> None:
    """fs-live: NO_PREROLL, twice."""
    pipeline = Pipeline.parse("fakesrc is-live=true ! fakesink")
    for _ in range(2):
        with pipeline:
            assert pipeline.pause() is StateChange.NO_PREROLL


def test_three_rounds() -> None:
    """fs-reuse: ten frames in each."""
    pipeline = Pipeline.parse("fakesrc num-buffers=10 ! queue ! fakesink name=s")
    for _ in range(3):
        pipeline.run(timeout_s=10)
        assert pipeline["s"].count == 10


def test_a_source_shows_its_frames() -> None:
    """signal-handoffs, dump, silent: each frame before it goes out."""
    pipeline = Pipeline.parse(
        "fakesrc name=s num-buffers=1 signal-handoffs=true silent=false dump=true ! fakesink"
    )
    shown: list[Any] = []
    pipeline["s"].on_handoff(lambda item, pad: shown.append((item.seq, pad.path)))
    pipeline.run(timeout_s=10)
    assert shown == [(0, "s.src")]
    assert pipeline["s"].last_message.startswith("create   *******"[:6])


class Fed:
    """A fakesink that is fed by hand."""

    def __init__(self, **properties: Any) -> None:
        self.sink = FakeSink("s", **properties)
        self.messages: list[Any] = []
        self.sink.poster = self.messages.append
        self.sink.start()
        self.pad = self.sink.pads["sink"]

    def push(self, item: Frame) -> None:
        """Pushes a frame, as the pipeline's state stands."""
        self.sink.receiver(self.pad)(item)

    def send(self, *events: Any) -> None:
        """Sends events."""
        for event in events:
            self.pad.receive_event(event)


def test_frames_outside_the_segment() -> None:
    """fk-clip: those wholly outside are dropped and do not preroll; the first inside does."""
    prerolled: list[Any] = []
    fed = Fed(signal_handoffs=True)
    fed.sink.on_preroll_handoff(lambda item, pad: prerolled.append(item.pts))
    fed.send(CapsEvent(A), SegmentEvent(Segment(SECOND, 5 * SECOND)))
    fed.push(frame(pts=0))
    fed.push(frame(pts=5 * SECOND))
    assert (fed.sink.count, fed.sink.drops) == (0, {"outside the segment": 2})
    fed.sink.timing.running.clear()
    holding = threading.Event()
    fed.sink.on_preroll_handoff(lambda item, pad: holding.set())

    def push_both() -> None:
        fed.push(frame(pts=0))
        fed.push(frame(pts=SECOND))

    pushing = threading.Thread(target=push_both)
    pushing.start()
    assert holding.wait(10)
    fed.sink.timing.running.set()
    pushing.join(10)
    assert prerolled == [SECOND]
    assert fed.sink.count == 1


def test_one_preroll_a_pause() -> None:
    """fk-preroll: the frame that waits for its time prerolls again at the next pause."""
    clock = ManualClock()
    text = "appsrc name=in ! fakesink name=s sync=true signal-handoffs=true"
    pipeline = Pipeline.parse(text, clock=clock)
    prerolls: list[int] = []
    pipeline["s"].on_preroll_handoff(lambda item, pad: prerolls.append(item.seq))
    with pipeline:
        pipeline.pause()
        pipeline["in"].push(frame(0, pts=0))
        assert pipeline.wait_prerolled(10)
        assert prerolls == [0]
        pipeline.play()
        pipeline["in"].push(frame(1, pts=3600 * SECOND))
        assert clock.wait_for_waiter(10)
        pipeline.pause()
        assert pipeline.wait_prerolled(10)
        assert prerolls == [0, 1]
        assert pipeline["s"].count == 1
    assert pipeline.state is State.NULL


def test_after_eos_nothing_is_taken() -> None:
    """fk-eos: until a flush."""
    fed = Fed()
    fed.send(EOS, EOS)
    ends = [message for message in fed.messages if message.kind is MessageKind.EOS]
    assert len(ends) == 1
    with pytest.raises(EndOfStream):
        fed.push(frame())
    fed.send(FLUSH_START, FLUSH_STOP, SegmentEvent(Segment()))
    fed.push(frame())
    assert fed.sink.count == 1


def test_a_limit_of_frames() -> None:
    """fk-eos2: with num-buffers=1 the first frame is answered with EOS, and so is every later one."""
    fed = Fed(num_buffers=1)
    for _ in range(3):
        with pytest.raises(EndOfStream):
            fed.push(frame())
    assert fed.sink.count == 1


def test_reading_what_was_done_while_stopping() -> None:
    """fk-race: last-message of many sinks while they stop."""
    text = "fakesrc ! tee name=t" + " t. ! queue ! fakesink silent=false" * 6
    for _ in range(3):
        with Pipeline.parse(text) as pipeline:
            pipeline.play()
            pipeline["fakesink5"].post_message("begun")
            readers = [
                threading.Thread(target=lambda sink: [sink.last_message for _ in range(200)], args=(sink,))
                for sink in (pipeline[f"fakesink{n}"] for n in range(6))
            ]
            for reader in readers:
                reader.start()
        for reader in readers:
            reader.join(10)


def test_a_new_run_leaves_eos_behind() -> None:
    """fk-restart: after the next start frames are taken again."""
    fed = Fed()
    fed.send(EOS)
    fed.sink.stop()
    fed.sink.start()
    fed.push(frame())
    assert fed.sink.count == 1


@pytest.mark.parametrize("kept", [True, False])
def test_the_last_frame(kept: bool) -> None:
    """bs-last: kept after EOS, or not; switching it off lets go of it."""
    pipeline = Pipeline.parse(f"fakesrc num-buffers=3 ! fakesink name=s enable-last-sample={kept}")
    pipeline.run(timeout_s=10)
    last = pipeline["s"].last_frame
    assert (last.seq if last is not None else None) == (2 if kept else None)
    pipeline["s"].set_property("enable-last-sample", False)
    assert pipeline["s"].last_frame is None


def test_a_gap_prerolls() -> None:
    """bs-gap: a gap counts for preroll, and EOS is told afterwards."""
    with Pipeline.parse("appsrc name=in ! fakesink") as pipeline:
        pipeline.pause()
        pipeline["in"].push(GapEvent(0, SECOND))
        assert pipeline.wait_prerolled(10)
        pipeline["in"].end()
        pipeline.play()
        assert pipeline.wait(10) is not None


def test_eos_prerolls() -> None:
    """bs-eos-play: EOS in PAUSED prerolls; the message comes only after PLAYING."""
    with Pipeline.parse("fakesrc num-buffers=0 ! fakesink") as pipeline:
        pipeline.pause()
        assert pipeline.wait_prerolled(10)
        assert pipeline.wait(0.05) is None
        pipeline.play()
        assert pipeline.wait(10) is not None


def test_a_sink_shows_its_frames() -> None:
    """signal-handoffs, silent, dump: each frame, with its pad."""
    fed = Fed(signal_handoffs=True, silent=False, dump=True)
    shown: list[Any] = []
    fed.sink.on_handoff(lambda item, pad: shown.append((item.seq, pad.path)))
    fed.push(Frame(b"ab", A, seq=7, arrival_ns=1))
    assert shown == [(7, "s.sink")]
    assert "(s.sink) (2 bytes" in str(fed.sink.last_message)
    assert [message.text for message in fed.messages] == ["frame", "dump"]
    assert fed.sink.stats == "application/x-sink-stats, rendered=1, dropped=0"


@pytest.mark.parametrize("sync", [False, True])
def test_frames_outside_may_be_kept(sync: bool) -> None:
    """drop-out-of-segment=false: they are taken while the pipeline plays."""
    fed = Fed(drop_out_of_segment=False, sync=sync)
    fed.send(SegmentEvent(Segment(SECOND, 5 * SECOND)))
    fed.push(frame(pts=0))
    assert fed.sink.count == 1


@pytest.mark.parametrize("change", ["null-to-ready", "ready-to-paused", "paused-to-playing"])
def test_failing_on_the_way_up(change: str) -> None:
    """state-error: the start fails and says why."""
    with pytest.raises(ElementFailure, match=f"state-error={change}"):
        Pipeline.parse(f"fakesrc num-buffers=1 ! fakesink state-error={change}").run(timeout_s=10)
