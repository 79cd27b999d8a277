"""videorate with extreme rates."""

import threading
import time
from collections.abc import Iterator
from fractions import Fraction

import numpy as np
import pytest

from streamkit import ElementFailure, Frame, Message, MessageKind, Pipeline, raw_video_caps
from tests.slowness import patience

CAPS = raw_video_caps("GRAY8", 4, 4, Fraction(10))


@pytest.mark.parametrize("more", ["", "drop-only=true", "skip-to-first=true"])
def test_a_stop_ends_a_very_long_gap(more: str) -> None:
    """Memory stays bounded."""
    text = (
        f"videotestsrc num-buffers=5 ! video/x-raw, framerate=10/1 ! videorate name=v rate=1e-290 {more} "
        "! video/x-raw, framerate=30/1 ! fakesink name=out"
    )
    pipeline = Pipeline.parse(text.replace("30/1", "10/1") if "drop" in more else text)
    reached = threading.Event()
    pipeline["v"].__dict__["_tick_ns"] = _counted(pipeline["v"]._tick_ns, reached)
    pipeline.play()
    assert reached.wait(20.0)
    began = time.monotonic()
    pipeline.stop()
    assert time.monotonic() - began < patience(4.0)


def _counted(tick, reached: threading.Event):
    count = 0

    def ticked(ahead: int = 0) -> int:
        nonlocal count
        count += 1
        if count > 1000:
            reached.set()
        return tick(ahead)

    return ticked


def test_an_infinite_timestamp_is_refused() -> None:
    """Very small rates make timestamps infinite."""
    text = "videotestsrc num-buffers=3 ! videorate rate=1e-305 ! video/x-raw, framerate=10/1 ! fakesink"
    with pytest.raises(ElementFailure, match="rate=1e-305 makes the time of the frame infinite"):
        Pipeline.parse(text).run(timeout_s=10.0)


def test_the_last_message_has_the_number_of_duplicates() -> None:
    """Also where the held frame is sent once more at the end of a stream whose end is unknown."""
    text = "appsrc name=in ! videorate name=v silent=false ! video/x-raw, framerate=30/1 ! fakesink"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        for seq, pts in enumerate((0, 100_000_000)):
            pipeline["in"].push(Frame(np.zeros((4, 4), np.uint8), CAPS, seq=seq, pts=pts))
        pipeline["in"].end()
        counts = [
            message.fields["count"]
            for message in _until_the_end(pipeline)
            if message.fields.get("name") == "duplicate"
        ]
        assert counts[-1] == pipeline["v"].duplicate == len(counts) > 0


def _until_the_end(pipeline: Pipeline) -> Iterator[Message]:
    while (message := pipeline.bus.pop(10.0, (MessageKind.ELEMENT, MessageKind.EOS))) is not None:
        if message.kind is MessageKind.EOS:
            return
        yield message
