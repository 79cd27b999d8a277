"""A graph of 200 elements, 50 queues and 8 sinks starts, streams and stops, in time that hardly counts."""

import threading
import time
from collections.abc import Callable

from streamkit import Pipeline
from tests.slowness import patience

BRANCHES, QUEUES, ELEMENTS, FRAMES = 8, 50, 200, 100
LIMIT_S = 6.0  # on an idle machine it is a small part of one


def description() -> str:
    """A source and a tee, then branches of queues and elements that do something or nothing."""
    rest = ELEMENTS - 2 - BRANCHES - QUEUES
    parts = [f"fakesrc num-buffers={FRAMES} ! tee name=t"]
    for branch in range(BRANCHES):
        queues = QUEUES // BRANCHES + (branch < QUEUES % BRANCHES)
        others = rest // BRANCHES + (branch < rest % BRANCHES)
        chain = ["queue max-size-buffers=5"] * queues
        for number in range(others):
            chain.insert(1 + number * 2 % len(chain), ("identity", "identity silent=false")[number % 2])
        parts.append(f"t. ! {' ! '.join(chain)} ! fakesink name=sink{branch}")
    return "  ".join(parts)


def test_a_large_graph_starts_and_stops_quickly(record_property: Callable[[str, object], None]) -> None:
    """Every sink gets every frame; no thread is left; building, starting and stopping are bounded."""
    before = set(threading.enumerate())
    began_s = time.monotonic()
    pipeline = Pipeline.parse(description())
    assert len(pipeline.graph.elements) == ELEMENTS
    assert sum(element.factory == "queue" for element in pipeline.graph.elements) == QUEUES
    pipeline.play()
    started_s = time.monotonic()
    message = pipeline.wait(60)
    ended_s = time.monotonic()
    pipeline.stop()
    stopped_s = time.monotonic()
    assert message is not None
    assert message.error is None
    rows = {row.element: row for row in pipeline.statistics()}
    assert [rows[f"sink{branch}"].frames_in for branch in range(BRANCHES)] == [FRAMES] * BRANCHES
    assert set(threading.enumerate()) <= before
    record_property("start_s", started_s - began_s)
    record_property("stop_s", stopped_s - ended_s)
    assert started_s - began_s + stopped_s - ended_s < patience(LIMIT_S)


def test_a_large_graph_is_stopped_in_the_middle() -> None:
    """With full queues and waiting threads."""
    before = set(threading.enumerate())
    pipeline = Pipeline.parse(description().replace(f"num-buffers={FRAMES}", "num-buffers=-1"))
    with pipeline:
        pipeline.play()
        while min(row.frames_in for row in pipeline.statistics() if row.factory == "fakesink") < 5:
            assert pipeline.error is None
        began_s = time.monotonic()
    assert time.monotonic() - began_s < patience(LIMIT_S)
    assert set(threading.enumerate()) <= before
