"""Processes: orders to children that die, hang or are started again at the worst moment."""

import os
import signal
import threading
import time
from collections.abc import Callable

import pytest

from streamkit import ElementFailure
from streamkit.crossing.channel import Channel
from streamkit.flow.messages import MessageKind
from streamkit.graph.pipeline import Pipeline
from streamkit.graph.processes import processes
from streamkit.graph.processes.process_link import ProcessLink

LIMIT_S = 80.0  # a busy machine takes long to start a process
POLL_S = 0.01


def until(condition: Callable[[], bool]) -> None:
    """Waits for a condition."""
    deadline = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(POLL_S)


def child_of(pipeline: Pipeline, number: int = 0) -> int:
    """The process of a bin."""
    return pipeline.process_statistics()[1 + number].pid


def kill(pid: int) -> None:
    """Kills a process and waits until nothing answers for it."""
    os.kill(pid, signal.SIGKILL)
    until(lambda: not os.path.exists(f"/proc/{pid}"))


def test_a_start_that_holds_the_interpreter_is_ended() -> None:
    """The limit of silence holds as soon as the process is set up."""
    text = "( process=true watchdog-s=1 fakesrc ! doomed name=d how=hold at=-2 ) ! fakesink"
    with Pipeline.parse(text) as pipeline:
        with pytest.raises(ElementFailure, match="has not answered for 1 s") as error:
            pipeline.ready()
        assert error.value.element == "d"


def test_a_death_before_the_pipeline_streams_is_an_error_when_it_does() -> None:
    """Nothing else would end the run."""
    with Pipeline.parse("fakesrc ! ( process=true identity ) ! fakesink") as pipeline:
        pipeline.ready()
        kill(child_of(pipeline))
        pipeline.play()
        with pytest.raises(ElementFailure, match="SIGKILL"):
            raise_error(pipeline)


def raise_error(pipeline: Pipeline) -> None:
    """Raises the failure that ends a pipeline."""
    message = pipeline.wait(LIMIT_S)
    assert message is not None
    assert message.error is not None
    raise message.error


def test_the_error_of_a_start_names_the_process_that_died() -> None:
    """Not the first one of the description."""
    text = "fakesrc ! ( process=true identity ) ! ( process=true doomed name=d how=kill at=-2 ) ! fakesink"
    with Pipeline.parse(text) as pipeline:
        with pytest.raises(ElementFailure, match="SIGKILL") as error:
            pipeline.ready()
        assert error.value.element == "d"


def test_finish_reaches_a_process_that_is_started_again() -> None:
    """Its new sources end, too; else there would be no EOS."""
    with Pipeline.parse("( process=true restart=1 fakesrc is-live=true ) ! fakesink") as pipeline:
        pipeline.play()
        kill(child_of(pipeline))
        assert pipeline.bus.pop(LIMIT_S, (MessageKind.WARNING,)) is not None
        pipeline.finish()
        message = pipeline.wait(LIMIT_S)
    assert message is not None
    assert message.kind is MessageKind.EOS


def test_a_dead_process_adds_no_latency() -> None:
    """`play` asks for it, also where a live pipeline resumes while a process is started again."""
    with Pipeline.parse("( process=true fakesrc is-live=true ) ! fakesink") as pipeline:
        pipeline.ready()
        kill(child_of(pipeline))
        assert pipeline.latency().minimum_ns == 0


def test_counters_before_the_start() -> None:
    """All are zero."""
    pipeline = Pipeline.parse("fakesrc ! ( process=true identity ) ! fakesink")
    assert {row.frames_in for row in pipeline.statistics()} == {0}


def test_counters_while_the_process_leaves(monkeypatch: pytest.MonkeyPatch) -> None:
    """A stop in another thread may end the child between two looks at it."""
    with Pipeline.parse("fakesrc num-buffers=3 ! ( process=true identity ) ! fakesink") as pipeline:
        pipeline.ready()
        part = pipeline._processes._parts[pipeline.graph.processes[0]]
        looks = iter([part.child])
        monkeypatch.setattr(type(part), "child", property(lambda _: next(looks, None)), raising=False)
        assert len(part.statistics()[1]) == 1
        monkeypatch.undo()


def test_a_stop_does_not_wait_for_the_messages_of_a_process_that_hangs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The reader of its EOS waits for what it has posted before."""
    monkeypatch.setattr(processes, "STOP_LIMIT_S", 0.2)
    text = "( process=true fakesrc num-buffers=3 ) ! fakesink"
    with Pipeline.parse(text, watchdog_s=0.0) as pipeline:
        pipeline.ready()
        pid, link, waits = child_of(pipeline), pipeline["processlink0"], threading.Event()
        await_messages = link.before_end

        def before_end() -> None:
            os.kill(pid, signal.SIGSTOP)
            waits.set()
            await_messages()

        link.before_end = before_end
        pipeline.play()
        assert waits.wait(LIMIT_S)
        pipeline.stop()  # raises where a thread has not ended


def test_a_property_too_long_for_a_process_that_hangs() -> None:
    """It fills the socket; the process is ended for its silence all the same."""
    text = "fakesrc is-live=true ! ( process=true watchdog-s=1 doomed name=d ) ! fakesink"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        os.kill(child_of(pipeline), signal.SIGSTOP)
        pipeline["d"].note = "long" * 2**18
        with pytest.raises(ElementFailure, match="has not answered for 1 s"):
            raise_error(pipeline)


def test_a_death_after_the_end_of_everything_in_a_process_is_a_warning() -> None:
    """Also while the end is not known yet, because another process has to report its failures first."""
    source = "( process=true name={} fakesrc is-live=true ! fakesink )"
    with Pipeline.parse(source.format("a") + source.format("b")) as pipeline:
        pipeline.play()
        ended, other = child_of(pipeline), child_of(pipeline, 1)
        os.kill(other, signal.SIGSTOP)
        pipeline._processes._parts[pipeline.graph.processes[0]].try_ask("finish")
        until(lambda: any(thread.name == "a:end" for thread in threading.enumerate()))
        kill(ended)
        message = pipeline.bus.pop(LIMIT_S, (MessageKind.WARNING, MessageKind.ERROR))
        os.kill(other, signal.SIGCONT)
    assert message is not None
    assert message.text.startswith("after its end: ")


def test_a_process_that_cannot_be_started_again_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where this process has no descriptor left."""

    def refuse() -> None:
        raise OSError(24, "too many open files")

    with Pipeline.parse("fakesrc is-live=true ! ( process=true restart=1 identity ) ! fakesink") as pipeline:
        pipeline.play()
        monkeypatch.setattr(Channel, "pair", refuse)
        kill(child_of(pipeline))
        with pytest.raises(ElementFailure, match=r"cannot be started again: .*too many open files"):
            raise_error(pipeline)


def test_a_dead_process_of_a_branch_does_not_hold_up_the_others() -> None:
    """The branch is dropped, also where its last process was idle; the one before no longer waits."""
    text = (
        "fakesrc num-buffers=100 ! tee name=t  t. ! ( process=true name=a identity ) "
        "! ( process=true name=b shm-frames=1 identity sleep-time=1000000 ! fakesink on-error=drop-branch ) "
        "t. ! queue ! fakesink name=s"
    )
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        until(lambda: pipeline["processlink0"].is_waiting)
        kill(child_of(pipeline, 1))
        message = pipeline.wait(LIMIT_S)
        counts = {row.element: row.frames_in for row in pipeline.statistics()}
    assert message is not None
    assert message.kind is MessageKind.EOS
    assert counts["s"] == 100


def test_a_failure_is_known_before_the_links_end_the_stream(monkeypatch: pytest.MonkeyPatch) -> None:
    """Else a sink may end the run with EOS, as if the frames so far were all."""
    known = []
    give_up = ProcessLink.give_up
    with Pipeline.parse("fakesrc is-live=true ! ( process=true identity ) ! fakesink") as pipeline:

        def note_and_give_up(link: ProcessLink) -> None:
            known.append(pipeline.error is not None)
            give_up(link)

        monkeypatch.setattr(ProcessLink, "give_up", note_and_give_up)
        pipeline.play()
        kill(child_of(pipeline))
        until(lambda: len(known) == 2)
    assert known == [True, True]


def test_a_process_that_is_started_again_waits_for_none_that_is_not() -> None:
    """The branch behind it was dropped: the new process learns that, and its other branch goes on."""
    text = (
        "fakesrc is-live=true ! ( process=true restart=1 name=a tee name=t ) "
        "t. ! ( process=true name=b identity ! fakesink on-error=drop-branch ) "
        "t. ! appsink name=out drop=true max-buffers=1"
    )
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        assert pipeline["out"].pull(LIMIT_S) is not None
        for victim in (1, 0):
            kill(child_of(pipeline, victim))
            assert pipeline.bus.pop(LIMIT_S, (MessageKind.WARNING,)) is not None
        epochs = [0]
        while epochs.count(1) < 50:  # more than are on the way to a process
            epochs.append(pipeline["out"].pull(LIMIT_S).epoch)
