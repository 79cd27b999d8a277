"""The sender of the pad `mosaic`."""

import threading

import numpy as np
import pytest

from streamkit import (
    CapsEvent,
    EndOfStream,
    EosEvent,
    FlushEvent,
    Frame,
    GapEvent,
    Segment,
    SegmentEvent,
    raw_video_caps,
)
from streamkit_stitcher.mosaic_pad import MosaicPad

CAPS = raw_video_caps("GRAY8", 8, 8)


class Pad:
    """A src pad whose consumer takes each frame when the gate opens."""

    def __init__(self):
        self.caps = None
        self.got = []
        self.gate = threading.Event()
        self.begun = threading.Event()
        self.ends_at = None

    def push(self, frame):
        self.begun.set()
        assert self.gate.wait(30)
        if frame.pts == self.ends_at:
            raise EndOfStream("consumer")
        self.got.append(frame.pts)

    def send_event(self, event):
        if isinstance(event, CapsEvent):
            self.caps = event.caps
        else:
            self.got.append(event if isinstance(event, FlushEvent) else type(event).__name__)


def frame(number):
    """A frame with a number."""
    return Frame(np.zeros((8, 8), np.uint8), CAPS, pts=number)


@pytest.fixture
def served():
    """A pad, its sender, the thread, and the dropped frames."""
    pad, skipped, stopping = Pad(), [], threading.Event()
    shown = MosaicPad(lambda: pad, lambda: skipped.append(1))
    thread = threading.Thread(target=shown.serve, args=(stopping,))
    thread.start()
    yield pad, shown, thread, skipped
    stopping.set()
    pad.gate.set()
    shown.wake()
    thread.join(10)
    assert not thread.is_alive()


def test_a_slow_consumer_gets_the_newest(served):
    """Of the frames that come while it is busy it gets the last; the others are counted as dropped."""
    pad, shown, thread, skipped = served
    shown.put(frame(0))
    assert pad.begun.wait(10)
    for number in range(1, 5):
        shown.put(frame(number))
    shown.put_event(EosEvent())
    pad.gate.set()
    thread.join(10)
    assert pad.got == [0, 4, "EosEvent"]
    assert len(skipped) == 3


def test_nothing_follows_the_end(served):
    """What comes after EOS is not sent."""
    pad, shown, thread, _ = served
    pad.gate.set()
    shown.put_event(EosEvent())
    shown.put(frame(1))
    shown.put_event(GapEvent(0))
    thread.join(10)
    assert pad.got == ["EosEvent"]


def test_events_keep_their_order_and_do_not_pile_up(served):
    """Events stay before or behind the frame they came before or behind; of a row the newest is kept."""
    pad, shown, thread, _ = served
    shown.put(frame(0))
    assert pad.begun.wait(10)
    for number in range(1000):
        shown.put_event(GapEvent(number))
    shown.put_event(SegmentEvent(Segment()))
    shown.put(frame(1))
    shown.put_event(EosEvent())
    pad.gate.set()
    thread.join(10)
    assert pad.got == [0, "GapEvent", "SegmentEvent", 1, "EosEvent"]


def test_after_a_flush_comes_nothing_from_before_it(served):
    """What waits is dropped, the segment kept; what comes in the flush is refused; then it goes on."""
    pad, shown, thread, _ = served
    shown.put(frame(0))
    assert pad.begun.wait(10)
    shown.put_event(SegmentEvent(Segment()))
    shown.put(frame(1))
    shown.flush(FlushEvent(begins=True))
    shown.put(frame(2))
    pad.gate.set()
    shown.flush(FlushEvent(begins=False))
    before = len(pad.got)
    shown.put(frame(3))
    shown.put_event(EosEvent())
    thread.join(10)
    assert set(pad.got[:before]) == {FlushEvent(begins=True), 0, FlushEvent(begins=False)}
    assert pad.got[-3:] == ["SegmentEvent", 3, "EosEvent"]
    assert pad.got.index(FlushEvent(begins=False)) > pad.got.index(0)
    assert not {1, 2} & set(pad.got)


def test_after_end_of_stream_from_downstream_nothing_is_pushed(served):
    """EOS is sent at once, and the thread ends."""
    pad, shown, thread, _ = served
    pad.ends_at = 1
    pad.gate.set()
    shown.put(frame(1))
    thread.join(10)
    shown.put(frame(2))
    assert pad.got == ["EosEvent"]
