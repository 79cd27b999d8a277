"""Flushes of pipelines of which parts run in processes of their own."""

import threading
import time

import pytest

from streamkit import Frame, MessageKind
from streamkit.graph.pipeline import Pipeline

LIMIT_S = 80.0  # a busy machine takes long to start a process


@pytest.mark.parametrize(
    "text",
    [
        "fakesrc num-buffers=40 ! ( process=true identity ) ! appsink name=out max-buffers=1",
        "( process=true fakesrc num-buffers=40 ) ! appsink name=out max-buffers=1",
        "( process=true fakesrc num-buffers=40 ! queue max-size-buffers=4 ) "
        "! ( process=true queue max-size-buffers=4 ) ! appsink name=out max-buffers=1",
    ],
)
def test_a_flush_drops_what_is_on_the_way(text: str) -> None:
    """In the sink, in processes and between them; EOS is kept."""
    with Pipeline.parse(text) as pipeline:
        source = pipeline["fakesrc0"]
        pipeline.play()
        assert pipeline["out"].pull(LIMIT_S).seq == 0
        while pipeline.statistics()[pipeline.graph.elements.index(source)].frames_out < 10:
            time.sleep(0.001)
        pipeline.flush()
        numbers = [frame.seq for frame in pipeline["out"]]
        lost = sum(row.total_dropped for row in pipeline.statistics())
    assert numbers[0] >= 9
    assert numbers[-1] == 39
    assert len(numbers) + 1 + lost == 40


@pytest.mark.parametrize(
    "text",
    [
        "( process=true fakesrc ! queue ) ! fakesink",
        "fakesrc ! ( process=true queue ! fakesink )",
        "fakesrc ! ( process=true fakesink )",
        "( process=true fakesrc num-buffers=3 ) ! queue ! fakesink",
    ],
)
def test_sinks_preroll_again_after_a_flush(text: str) -> None:
    """In whichever process they and their sources are."""
    with Pipeline.parse(text) as pipeline:
        pipeline.pause()
        for _ in range(3):
            assert pipeline.wait_prerolled(LIMIT_S)
            pipeline.flush()
        assert pipeline.wait_prerolled(LIMIT_S)
        pipeline.play()
        pipeline.finish()
        message = pipeline.wait(LIMIT_S)
    assert message is not None
    assert message.kind is MessageKind.EOS


def test_a_flush_keeps_the_eos_of_another_process_that_waits_for_its_turn() -> None:
    """It waits at concat, in the thread that reads from the process."""
    text = "fakesrc name=f ! concat name=c ! fakesink  ( process=true fakesrc num-buffers=0 ) ! c."
    with Pipeline.parse(text) as pipeline:
        pipeline.pause()
        assert pipeline.wait_prerolled(LIMIT_S)
        pipeline.flush()
        pipeline.play()
        pipeline["f"].finish()
        assert pipeline.wait(LIMIT_S) is not None


def test_counters_of_a_process_outlive_it() -> None:
    """After a stop they are the last ones."""
    with Pipeline.parse("fakesrc num-buffers=20 ! ( process=true identity ) ! fakesink") as pipeline:
        pipeline.run(LIMIT_S)
        rows = {row.element: row for row in pipeline.statistics()}
        processes = pipeline.process_statistics()
    assert rows["identity0"].frames_in == rows["identity0"].frames_out == 20
    assert processes[1].frames == 20


def test_frames_in_a_link_are_counted_when_the_pipeline_stops() -> None:
    """Those that the process downstream has not taken, and the one that waits for room."""
    text = "fakesrc ! ( process=true identity ) ! appsink name=out max-buffers=1"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        assert pipeline["out"].pull(LIMIT_S) is not None
        # The program, the sink, the second link and the thread before it have 11: one is in the first link.
        while pipeline.statistics()[1].frames_in < 12:
            time.sleep(0.001)
    links = [row for row in pipeline.statistics() if row.factory == "processlink"]
    assert len(links) == 2
    for row in links:
        assert row.dropped["pipeline stopped"] > 0
        assert row.frames_in == row.frames_out + row.total_dropped


def test_a_flush_waits_for_the_frame_that_is_on_its_way() -> None:
    """It came before the flush: it would pass if its thread rested for as long as the flush takes."""
    text = "( process=true fakesrc num-buffers=3 ) ! identity name=i ! fakesink"
    is_there, may_go_on, has_flushed = threading.Event(), threading.Event(), threading.Event()

    def hold(frame: Frame) -> None:
        is_there.set()
        assert may_go_on.wait(LIMIT_S)

    with Pipeline.parse(text) as pipeline:
        pipeline["i"].on_handoff.append(hold)
        pipeline.play()
        assert is_there.wait(LIMIT_S)
        thread = threading.Thread(target=lambda: (pipeline.flush(), has_flushed.set()))
        thread.start()
        assert not has_flushed.wait(0.3)
        may_go_on.set()
        assert has_flushed.wait(LIMIT_S)
        thread.join(LIMIT_S)
