"""videorate at speeds nobody needs: it can be stopped, and says what it cannot do."""

import threading
import time

import pytest

from streamkit import ElementFailure, Pipeline


@pytest.mark.parametrize("more", ["", "drop-only=true", "skip-to-first=true"])
def test_endless_ticks_end_with_the_pipeline(more: str) -> None:
    """A tiny rate asks for more frames than there will ever be; a stop comes through, and memory holds."""
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
    assert time.monotonic() - began < 4.0


def _counted(tick, reached: threading.Event):
    count = 0

    def ticked(ahead: int = 0) -> int:
        nonlocal count
        count += 1
        if count > 1000:
            reached.set()
        return tick(ahead)

    return ticked


def test_a_time_without_end_is_refused() -> None:
    """The smallest rates make times infinite."""
    text = "videotestsrc num-buffers=3 ! videorate rate=1e-305 ! video/x-raw, framerate=10/1 ! fakesink"
    with pytest.raises(ElementFailure, match="rate=1e-305 makes the time of the frame infinite"):
        Pipeline.parse(text).run(timeout_s=10.0)
