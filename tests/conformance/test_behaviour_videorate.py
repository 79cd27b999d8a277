"""videorate, as behaviour.md tells."""

from collections.abc import Iterator
from fractions import Fraction
from typing import Any

import pytest

from streamkit import Caps, ElementFailure, Frame, NotNegotiated, Pipeline
from streamkit.element.pad import Pad
from streamkit.flow.caps import ANY
from streamkit.flow.events import CapsEvent, Flushing, Segment, SegmentEvent
from streamkit.testing import Harness

MS = 1_000_000
SECOND = 1000 * MS
SMALL = "video/x-raw, format=GRAY8, width=4, height=4"
MOST = "2147483647/1"
ANY_RATE = f"[ 0/1, {MOST} ]"


def video(rate: str = "25/1") -> Caps:
    """Caps of a small video."""
    return Caps(f"{SMALL}, framerate={rate}")


class Rate:
    """A videorate under test, with frames numbered as they are pushed."""

    def __init__(
        self,
        rate_in: str = "25/1",
        downstream: str | Caps = "video/x-raw, framerate=25/1",
        **properties: Any,
    ) -> None:
        self.harness = Harness("videorate", downstream=downstream, **properties)
        self.caps = video(rate_in)
        self.pushed = 0
        self.frames: list[Frame] = []

    def push(self, pts: int | None, duration: int | None = None) -> int:
        """Pushes a frame; how many have come out so far."""
        feed = self.harness._feed("sink")
        if not self.pushed:
            feed.send_event(CapsEvent(self.caps))
            feed.send_event(SegmentEvent(Segment()))
        feed.push(Frame(bytes([self.pushed % 256]), self.caps, pts, duration, arrival_ns=1))
        self.frames += self.harness.take()
        self.pushed += 1
        return len(self.frames)

    def end(self) -> int:
        """EOS; how many frames have come out in all."""
        self.frames += self.harness.drain()
        return len(self.frames)

    @property
    def counts(self) -> list[int]:
        """In, out, dropped, repeated."""
        element: Any = self.harness.element
        return [element.frames_in, element.out, element.drop, element.duplicate]

    @property
    def content(self) -> list[int]:
        """Which frame each output shows, from 1."""
        return [frame.data[0] + 1 for frame in self.frames]

    @property
    def times_ms(self) -> list[float]:
        """Timestamps."""
        return [(frame.pts or 0) / MS for frame in self.frames]


def test_the_first_frame_waits_for_the_second() -> None:
    """vr-one: one frame of latency."""
    rate = Rate()
    assert rate.push(0) == 0
    assert rate.counts == [1, 0, 0, 0]


def test_ticks_take_the_nearest_frame() -> None:
    """vr-more: content 1, 2, 2, 2, then the third; counters after each frame; numbers are consecutive."""
    rate = Rate()
    rate.push(0)
    rate.push(60 * MS)
    assert rate.counts == [2, 2, 0, 0]
    rate.push(240 * MS)
    assert rate.counts == [3, 7, 0, 4]
    assert rate.end() == 8
    assert rate.counts == [3, 8, 0, 4]
    assert rate.content == [1, 2, 2, 2, 3, 3, 3, 3]
    assert rate.times_ms == [40 * n for n in range(8)]
    assert [frame.seq for frame in rate.frames] == list(range(8))


def test_a_frame_older_than_the_first_is_dropped() -> None:
    """vr-order0: 1 s, 0 s, 2 s gives 26 and 25 frames."""
    rate = Rate()
    rate.push(SECOND)
    rate.push(0)
    assert rate.counts == [2, 0, 1, 0]
    assert rate.push(2 * SECOND) == 26 + 25
    assert rate.counts == [3, 51, 1, 49]
    assert rate.times_ms[-1] == 2000


def test_a_frame_older_than_the_last_is_dropped() -> None:
    """vr-order: 0, 1, 2, 0 s gives 51 frames, 48 of them repeated."""
    rate = Rate()
    assert [rate.push(n * SECOND) for n in (0, 1, 2, 0)] == [0, 26, 51, 51]
    assert rate.counts == [4, 51, 1, 48]


def test_a_long_gap_is_left_open() -> None:
    """vr-maxdup: with a limit of 2 s the gap from 2 to 5 s is not filled."""
    rate = Rate(max_duplication_time=2 * SECOND)
    assert [rate.push(n * SECOND) for n in (0, 1, 2, 5, 6)] == [0, 26, 51, 52, 76]
    assert rate.counts == [5, 76, 0, 71]
    assert rate.times_ms[51] == 5000
    assert rate.end() == 77


def test_caps_without_a_frame_rate_are_refused() -> None:
    """vr-nofps: the push fails, and says what is missing."""
    harness = Harness("videorate")
    with pytest.raises(NotNegotiated, match="no frame rate, which it needs; put framerate=0/1"):
        harness.push(Frame(b"", Caps(SMALL), 0, arrival_ns=1))


def test_new_sizes_follow_the_frame_before() -> None:
    """vr-size: the pending frame goes out first; each has its own caps."""
    harness = Harness("videorate")
    large = Caps("video/x-raw, format=GRAY8, width=8, height=4, framerate=25/1")
    out = harness.push(Frame(b"1", video(), 0, arrival_ns=1))
    assert out == []
    out = harness.push(Frame(b"2", large, 40 * MS, arrival_ns=1))
    assert [(frame.data, frame.caps["width"]) for frame in out] == [(b"1", 4)]
    out = harness.push(Frame(b"3", large, 80 * MS, arrival_ns=1)) + harness.drain()
    assert (out[0].data, out[0].caps["width"]) == (b"2", 8)
    assert out[-1].data == b"3"


def test_a_long_stream_gives_exactly_its_frames() -> None:
    """vr-flow: 100 s of 33 frames a second give 2500 at 25."""
    rate = Rate("33/1")
    for number in range(3300):
        rate.push(number * SECOND // 33)
    assert len(rate.frames) == 2500
    assert rate.counts == [3300, 2500, rate.counts[2], 0]


def test_what_downstream_answers_goes_up() -> None:
    """vr-flow: flushing downstream meets the push upstream."""
    rate = Rate()
    rate.push(0)

    def refuse(frame: Frame) -> None:
        raise Flushing("sink")

    rate.harness.element.pads["src"].push = refuse
    with pytest.raises(Flushing):
        rate.push(40 * MS)


def test_the_rate_wanted_is_asked_for_upstream() -> None:
    """vr-upnego: downstream wants 999/7, so the source makes that, and frames pass one for one."""
    text = "videotestsrc num-buffers=5 ! videorate name=v ! video/x-raw,framerate=999/7 ! appsink name=out"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        frames = list(pipeline["out"])
    assert frames[0].caps["framerate"] == Fraction(999, 7)
    assert pipeline["videotestsrc0"].src_caps["framerate"] == Fraction(999, 7)
    assert (pipeline["v"].drop, pipeline["v"].duplicate) == (0, 0)


ROWS = [
    ("", False, 0, "", f"={ANY_RATE}"),
    ("", False, 15, "", "=[ 0/1, 15/1 ]"),
    ("", True, 0, f"={ANY_RATE}", f"={ANY_RATE}"),
    ("", True, 15, f"=[ 0/1, 15/1 ];={ANY_RATE}", "=[ 0/1, 15/1 ]"),
    (f"={ANY_RATE}", False, 0, f"={ANY_RATE}", f"={ANY_RATE}"),
    (f"={ANY_RATE}", False, 15, f"={ANY_RATE}", "=[ 0/1, 15/1 ]"),
    (f"={ANY_RATE}", True, 0, f"={ANY_RATE}", f"={ANY_RATE}"),
    (f"={ANY_RATE}", True, 15, f"=[ 0/1, 15/1 ];={ANY_RATE}", "=[ 0/1, 15/1 ]"),
    ("=15/1", False, 0, f"=15/1;={ANY_RATE}", f"=15/1;={ANY_RATE}"),
    ("=15/1", False, 20, f"=15/1;={ANY_RATE}", "=15/1;=[ 0/1, 20/1 ]"),
    ("=15/1", True, 0, f"=15/1;=[ 15/1, {MOST} ];=0/1", "=15/1;=[ 0/1, 15/1 ]"),
    ("=15/1", True, 20, f"=15/1;=[ 15/1, {MOST} ];=0/1", "=15/1;=[ 0/1, 15/1 ]"),
    ("=[ 15/1, 30/1 ]", False, 0, f"=[ 15/1, 30/1 ];={ANY_RATE}", f"=[ 15/1, 30/1 ];={ANY_RATE}"),
    ("=[ 15/1, 30/1 ]", False, 20, f"=[ 15/1, 30/1 ];={ANY_RATE}", "=[ 15/1, 20/1 ];=[ 0/1, 20/1 ]"),
    ("=[ 15/1, 30/1 ]", True, 0, f"=[ 15/1, 30/1 ];=[ 15/1, {MOST} ];=0/1",
     "=[ 15/1, 30/1 ];=[ 0/1, 30/1 ]"),
    ("=[ 15/1, 30/1 ]", True, 20, f"=[ 15/1, 20/1 ];=[ 15/1, 30/1 ];=[ 15/1, {MOST} ];=0/1",
     "=[ 15/1, 20/1 ];=[ 0/1, 20/1 ]"),
    ("={ 15/1, 30/1 }", False, 0, f"={{ 15/1, 30/1 }};={ANY_RATE}", f"={{ 15/1, 30/1 }};={ANY_RATE}"),
    ("={ 15/1, 30/1 }", False, 20, f"={{ 15/1, 30/1 }};={ANY_RATE}", "=15/1;=[ 0/1, 20/1 ]"),
    ("={ 15/1, 30/1 }", True, 0, f"={{ 15/1, 30/1 }};=[ 15/1, {MOST} ];=0/1",
     "={ 15/1, 30/1 };=[ 0/1, 30/1 ]"),
    ("={ 15/1, 30/1 }", True, 20, f"=15/1;={{ 15/1, 30/1 }};=[ 15/1, {MOST} ];=0/1",
     "=15/1;=[ 0/1, 20/1 ]"),
    ("=0/1", True, 0, f"=0/1;={ANY_RATE}", f"=0/1;={ANY_RATE}"),
    ("=0/1", True, 15, f"=0/1;={ANY_RATE}", "=0/1;=[ 0/1, 15/1 ]"),
]  # fmt: skip


def rates(text: str) -> str:
    """Caps with each of the frame rates given."""
    parts = [f"video/x-raw, framerate{part}" if part else "video/x-raw" for part in text.split(";")]
    return str(Caps("; ".join(parts)))


@pytest.mark.parametrize(("rate", "drop_only", "max_rate", "sink", "src"), ROWS)
def test_rates_from_rates(rate: str, drop_only: bool, max_rate: int, sink: str, src: str) -> None:
    """vr-caps: what the sink pad takes where these caps follow, what the src pad gives where they come."""
    properties: dict[str, Any] = {"drop_only": drop_only}
    if max_rate:
        properties["max_rate"] = max_rate
    element: Any = Harness("videorate", **properties).element
    caps = Caps(rates(rate))
    assert str(element.transform_caps(caps, "src")) == rates(sink)
    assert str(element.transform_caps(caps, "sink")) == rates(src)


@pytest.mark.parametrize(
    ("downstream", "drop_only", "expected"),
    [("video/x-raw", False, "25/1"), ("video/x-raw, framerate=0/1", False, "0/1"),
     ("video/x-raw, framerate=0/1", True, "0/1")],
)  # fmt: skip
def test_a_rate_that_varies(downstream: str, drop_only: bool, expected: str) -> None:
    """vr-var: it is guessed from the interval, unless downstream or drop-only want it to vary."""
    rate = Rate("0/1", downstream, drop_only=drop_only)
    for number in range(3):
        rate.push(number * 40 * MS)
    rate.end()
    assert rate.frames[0].caps["framerate"] == 0
    assert rate.frames[-1].caps["framerate"] == Fraction(expected)
    assert rate.times_ms[:3] == [0, 40, 80]


@pytest.mark.parametrize(
    ("speed", "counts"), [(1.0, [34, 25, 8, 0]), (0.5, [34, 50, 0, 17]), (2.0, [34, 13, 20, 0])]
)
def test_speed(speed: float, counts: list[int]) -> None:
    """vr-rate: 34 frames at 33 a second; ticks stay 40 ms apart."""
    rate = Rate("33/1", rate=speed)
    for number in range(34):
        rate.push(number * (SECOND // 33))
    assert rate.counts == counts
    assert rate.times_ms == [40 * n for n in range(counts[1])]


def test_a_frame_without_a_timestamp_is_an_error() -> None:
    """vr-nopts: its place among the others is unknown."""
    rate = Rate()
    rate.push(0)
    with pytest.raises(ElementFailure, match="no timestamp"):
        rate.push(None)


def test_a_new_segment_begins_anew() -> None:
    """vr-seg: the pending frame goes out, then ticks count from the new segment."""
    rate = Rate()
    rate.push(0)
    pad: Pad = rate.harness.element.pads["sink"]
    pad.receive_event(SegmentEvent(Segment(start_ns=10 * SECOND)))
    rate.frames += rate.harness.take()
    assert rate.times_ms == [0]
    rate.push(10 * SECOND)
    rate.push(10 * SECOND + 40 * MS)
    assert rate.times_ms == [0, 10_000, 10_040]


def own() -> Iterator[Any]:
    """Frames a second in and out, properties, frames in, outputs before and after EOS."""
    yield "10/1", "25/1", {}, 10, [10, 23, 0, 13], 24
    yield "30/1", "10/1", {}, 30, [30, 10, 19, 0], 11
    yield "30/1", f"[ 0/1, {MOST} ]", {"drop_only": True, "max_rate": 10}, 30, [30, 10, 20, 0], 10


@pytest.mark.parametrize(("rate_in", "rate_out", "properties", "count", "counts", "ended"), list(own()))
def test_up_and_down(
    rate_in: str, rate_out: str, properties: dict[str, Any], count: int, counts: list[int], ended: int
) -> None:
    """vr-own: 10 to 25, 30 to 10, and 30 thinned out to 10 a second."""
    rate = Rate(rate_in, f"video/x-raw, framerate={rate_out}", **properties)
    for number in range(count):
        rate.push(int(number * SECOND / Fraction(rate_in)))
    assert rate.counts == counts
    assert rate.end() == ended


@pytest.mark.parametrize(
    ("rate_in", "rate_out", "count", "ended"),
    [("5/1", "5/1", 3, 3), ("30000/1001", "30000/1001", 7, 7), ("10/1", "30/1", 30, 90),
     ("30/1", "10/1", 30, 11), ("30/1", "10/1", 1, 1)],
)  # fmt: skip
def test_frames_with_durations_fill_them(rate_in: str, rate_out: str, count: int, ended: int) -> None:
    """As many frames as the input lasts, and an unused last one: at the same rate none is added at EOS."""
    rate = Rate(rate_in, f"video/x-raw, framerate={rate_out}")
    for number in range(count):
        rate.push(int(number * SECOND / Fraction(rate_in)), round(SECOND / Fraction(rate_in)))
    assert rate.end() == ended


def test_the_time_before_the_first_frame() -> None:
    """skip-to-first: filled from the segment's start, unless it is to be left out."""
    filled, skipped = Rate(), Rate(skip_to_first=True)
    for rate in (filled, skipped):
        rate.push(SECOND)
        rate.push(SECOND + 40 * MS)
    assert filled.times_ms[0] == 0
    assert skipped.times_ms == [1000, 1040]


def test_an_averaged_rate_lets_bursts_through() -> None:
    """average-period: frames at 5 a second all pass a limit of 10, those at 100 a second do not."""
    for step_ms, kept in ((200, 20), (10, 2)):
        rate = Rate("0/1", ANY, max_rate=10, average_period=SECOND)
        for number in range(20):
            rate.push(number * step_ms * MS)
        assert len(rate.frames) >= kept
        assert (rate.counts[2] == 0) == (step_ms == 200)
