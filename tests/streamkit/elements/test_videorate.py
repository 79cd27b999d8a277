"""videorate with extreme rates."""

import threading
import time

import pytest

from streamkit import ElementFailure, Pipeline
from tests.slowness import patience


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
