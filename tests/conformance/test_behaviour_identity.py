"""identity, as behaviour.md tells."""

import sys
import threading
from typing import Any

import pytest

from streamkit import Caps, ElementFailure, EndOfStream, Frame, FrameFlags, Pipeline, PropertyError
from streamkit.elements.identity import Identity
from streamkit.flow.events import Flushing, Segment, SegmentEvent
from streamkit.testing import Harness, ManualClock

A = Caps("a/b")
SECOND = 1_000_000_000


def frame(number: int, data: bytes = b"", **fields: Any) -> Frame:
    """A frame."""
    return Frame(data, A, seq=number, arrival_ns=1, **fields)


def test_the_same_frame_comes_out() -> None:
    """id-same: the very object, with no reference kept."""
    with Harness("identity", silent=False) as harness:
        item = frame(0)
        before = sys.getrefcount(item)
        (out,) = harness.push(item)
        assert out is item
        del out
        assert sys.getrefcount(item) <= before + 1  # the harness's feed remembers the caps of the last frame


@pytest.mark.parametrize("wanted", [True, False])
def test_handoffs(wanted: bool) -> None:
    """id-handoff: with signal-handoffs, on by default, each frame is shown; else none is."""
    element = Identity("i", signal_handoffs=wanted, silent=False)
    shown: list[Frame] = []
    element.on_handoff(shown.append)
    with Harness(element) as harness:
        item = frame(0)
        harness.push(item)
    assert shown == ([item] if wanted else [])
    assert Identity().signal_handoffs


def held(clock: ManualClock) -> tuple[Harness, threading.Thread, list[BaseException]]:
    """An identity that holds a frame due 123456789 ns after the start."""
    harness = Harness("identity", clock=clock, sync=True)
    harness.element.timing.begin()
    feed = harness._feed("sink")
    feed.send_event(SegmentEvent(Segment()))
    errors: list[BaseException] = []

    def push() -> None:
        try:
            feed.push(frame(0, pts=123_456_789))
        except BaseException as error:
            errors.append(error)

    thread = threading.Thread(target=push)
    thread.start()
    assert clock.wait_for_waiter()
    return harness, thread, errors


def test_a_frame_is_held_until_its_time() -> None:
    """id-sync: until the clock reaches the running time of its timestamp."""
    clock = ManualClock()
    harness, thread, _ = held(clock)
    clock.advance(0.123456788)
    assert harness.take() == []
    clock.advance(0.000000001)
    thread.join(10)
    assert [out.pts for out in harness.take()] == [123_456_789]


def test_stopping_ends_the_wait() -> None:
    """id-stop: the frame that waits is dropped."""
    harness, thread, errors = held(ManualClock())
    harness.element.stopping.set()
    harness.element.halt()
    thread.join(10)
    assert not thread.is_alive()
    assert isinstance(errors[0], Flushing)
    assert harness.take() == []


def test_dropping_everything() -> None:
    """id-drop: with probability 1 no frame passes, EOS does."""
    pipeline = Pipeline.parse(
        "fakesrc num-buffers=10 ! identity name=i drop-probability=1.0 ! fakesink name=s"
    )
    pipeline.run(timeout_s=10)
    assert pipeline["s"].count == 0
    assert pipeline["i"].drops == {"drop-probability": 10}


def test_eos_and_errors_after_frames() -> None:
    """id-after: of ten frames two pass with either at 3; then EOS, or an error."""
    ended = Pipeline.parse("fakesrc num-buffers=10 ! identity eos-after=3 ! fakesink name=s")
    ended.run(timeout_s=10)
    assert ended["s"].count == 2
    failed = Pipeline.parse("fakesrc num-buffers=10 ! identity error-after=3 ! fakesink name=s")
    with pytest.raises(ElementFailure, match="error-after=3"):
        failed.run(timeout_s=10)
    assert failed["s"].count == 2


def test_eos_after_in_a_harness() -> None:
    """id-after: the frame that triggers it is answered with the end of the stream."""
    with Harness("identity", eos_after=1) as harness, pytest.raises(EndOfStream):
        harness.push(frame(0))


@pytest.mark.parametrize(
    ("flags", "marks", "passes"),
    [("discont", FrameFlags.DISCONTINUITY, False), ("corrupted", FrameFlags.DISCONTINUITY, True),
     ("discont+corrupted", FrameFlags.CORRUPT, False), ("delta-unit", 0, False),
     ("delta-unit", FrameFlags.KEYFRAME, True), ("gap+droppable", FrameFlags.DISCONTINUITY, True)],
)  # fmt: skip
def test_dropping_marked_frames(flags: str, marks: int, passes: bool) -> None:
    """drop-buffer-flags: any of the marks is enough."""
    with Harness("identity", drop_buffer_flags=flags) as harness:
        assert bool(harness.push(frame(0, flags=int(marks)))) is passes


def test_marks_it_does_not_know() -> None:
    """drop-buffer-flags: says which it takes."""
    with pytest.raises(PropertyError, match=r"it takes discont, corrupted, delta-unit, live, .*, joined by"):
        Identity(drop_buffer_flags="wet")


def test_stamps_from_a_data_rate() -> None:
    """datarate: 100 bytes at 1000 bytes a second are 0.1 s."""
    with Harness("identity", datarate=1000) as harness:
        out = [item for number in range(3) for item in harness.push(frame(number, bytes(100)))]
    assert [(item.pts, item.duration) for item in out] == [
        (0, SECOND // 10), (SECOND // 10, SECOND // 10), (SECOND // 5, SECOND // 10),
    ]  # fmt: skip


def test_one_segment_of_all() -> None:
    """single-segment: timestamps become running times."""
    with Harness("identity", single_segment=True) as harness:
        harness.push(frame(0, pts=5 * SECOND))
        harness.element.pads["sink"].receive_event(SegmentEvent(Segment(20 * SECOND, None, 7 * SECOND)))
        (out,) = harness.push(frame(1, pts=21 * SECOND))
        assert out.pts == 8 * SECOND
        assert harness.element.pads["src"].segment == Segment()


def test_imperfect_streams_are_told_of() -> None:
    """check-imperfect-timestamp, check-imperfect-offset: a gap in time, and a number left out."""
    with Harness("identity", check_imperfect_timestamp=True, check_imperfect_offset=True) as harness:
        harness.push(frame(0, pts=0, duration=SECOND))
        harness.push(frame(1, pts=SECOND, duration=SECOND))
        assert harness.messages == []
        harness.push(frame(5, pts=3 * SECOND, duration=SECOND))
        told = [message.fields for message in harness.messages]
    assert told == [
        {"name": "imperfect-timestamp", "expected_ns": 2 * SECOND, "pts": 3 * SECOND},
        {"name": "imperfect-offset", "expected": 2, "seq": 5},
    ]


def test_what_it_tells() -> None:
    """silent=false, dump: a message and a text for each frame, and its bytes."""
    with Harness("identity", silent=False, dump=True) as harness:
        harness.push(frame(0, b"abc"))
        element: Any = harness.element
        assert "(3 bytes, pts: None" in element.last_message
        assert element.stats == "application/x-identity-stats, num-bytes=3, num-buffers=1"
        assert harness.messages[-1].fields == {"name": "dump", "content": "00000000: 61 62 63"}


def test_by_default_it_costs_nothing() -> None:
    """Frames pass unseen, unless somebody wants to be shown them."""
    element = Identity()
    assert element.is_passthrough()
    element.on_handoff(print)
    assert not element.is_passthrough()
