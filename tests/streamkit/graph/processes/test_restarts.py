"""A process that dies is started again: the stream goes on in a new epoch, and what is lost is counted."""

import itertools
import os
import random
import signal

import pytest

from streamkit import DescriptionError, ElementFailure, Frame, FrameFlags
from streamkit.flow.messages import Message
from streamkit.graph.pipeline import Pipeline
from streamkit.graph.processes.part import Part

LIMIT_S = 80.0  # a busy machine takes long to start a process
LOST = "lost with the process that had them"


def play(text: str, watchdog_s: float = 30.0) -> tuple[list[Frame], list[Message], dict[str, dict[str, int]]]:
    """Frames of the appsink `out`, messages, and drops by element."""
    with Pipeline.parse(text, watchdog_s=watchdog_s) as pipeline:
        pipeline.play()
        frames = list(pipeline["out"])
        messages = list(iter(pipeline.bus.pop, None))
        return frames, messages, {row.element: row.dropped for row in pipeline.statistics()}


def assert_accounted(frames: list[Frame], sent: int, lost: int, restarts: int) -> None:
    """Each frame has arrived once or is counted; one that arrived may be counted, too, at each death."""
    numbers = [frame.seq for frame in frames]
    assert numbers == sorted(set(numbers))
    assert sent <= len(numbers) + lost <= sent + restarts


@pytest.mark.parametrize("how", ["kill", "segfault", "exit"])
def test_the_stream_goes_on_in_a_new_epoch(how: str) -> None:
    """A discontinuity, a new epoch, a warning, and a count of what is lost."""
    text = (
        "fakesrc num-buffers=100 sizetype=fixed sizemax=100 ! "
        f"( process=true restart=2 shm-frames=4 doomed how={how} at=50 ) ! appsink name=out"
    )
    frames, messages, drops = play(text)
    (warning,) = [message for message in messages if message.fields.get("code") == "process-restart"]
    assert "doomed0" in warning.text
    assert "[at frame seq=50]" in warning.text
    lost = drops["processlink0"][LOST]
    assert_accounted(frames, 100, lost, 1)
    assert 1 <= lost <= 5
    after = [frame for frame in frames if frame.seq > 50]
    assert {frame.epoch for frame in frames if frame.seq < 50} == {0}
    assert {frame.epoch for frame in after} == {1}
    assert [bool(frame.flags & FrameFlags.DISCONTINUITY) for frame in after[:2]] == [True, False]


def test_a_source_that_is_started_again_counts_on() -> None:
    """The numbers of a live source are never used twice."""
    text = (
        "( process=true restart=1 fakesrc is-live=true num-buffers=10 ! doomed how=exit at=5 ) "
        "! appsink name=out"
    )
    with pytest.raises(ElementFailure, match="has ended with code 7"):  # at its frame 5, each time
        play(text)


@pytest.mark.parametrize("how", ["sleep", "hold"])
def test_a_process_that_hangs_is_started_again(how: str) -> None:
    """Whether the interpreter runs or not."""
    text = (
        "fakesrc num-buffers=60 ! "
        f"( process=true restart=1 watchdog-s=1 doomed how={how} at=30 ) ! appsink name=out"
    )
    frames, _, drops = play(text)
    assert_accounted(frames, 60, drops["processlink0"][LOST], 1)
    assert frames[-1].seq == 59


def test_a_process_that_hangs_as_it_starts_to_stream_is_ended() -> None:
    """Its answer to the order to play never comes; the limit of silence holds from that order on."""
    text = "( process=true watchdog-s=1 fakesrc ! doomed how=hold at=0 ) ! appsink name=out"
    with pytest.raises(ElementFailure, match="has not answered for 1 s"):
        play(text)


def test_no_more_often_than_allowed() -> None:
    """The error is that of the last death."""
    text = (
        "fakesrc num-buffers=100 ! ( process=true restart=2 shm-frames=1 "
        "doomed how=kill at=10 ! doomed how=kill at=20 ! doomed how=kill at=30 ) ! appsink name=out"
    )
    with pytest.raises(ElementFailure, match=r"SIGKILL.*\[at frame seq=30\]"):
        play(text)


def test_a_file_is_not_begun_again() -> None:
    """Frames would come twice."""
    with pytest.raises(DescriptionError, match="would start over"):
        Pipeline.parse("( process=true restart=1 fakesrc num-buffers=5 ) ! fakesink")


def test_random_kills() -> None:
    """Children killed at random times: the run ends with EOS, and every frame is accounted for."""
    sent, dice = 400, random.Random(1)
    text = (
        f"fakesrc num-buffers={sent} sizetype=fixed sizemax=10000 datarate=2000000 ! "
        "( process=true restart=1000 name=a identity ) ! "
        "( process=true restart=1000 name=b identity ) ! appsink name=out max-buffers=1"
    )
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        frames = []
        kills = 0
        for index in itertools.count():
            frame = pipeline["out"].pull(LIMIT_S)
            if frame is None:
                break
            frames.append(frame)
            if index % 60 == 30:
                victim = dice.choice(children())
                os.kill(victim, signal.SIGKILL)
                kills += 1
        messages = list(iter(pipeline.bus.pop, None))
        drops = {row.element: row.dropped for row in pipeline.statistics()}
    assert kills >= 4
    assert sum(message.fields.get("code") == "process-restart" for message in messages) <= kills
    epochs = [frame.epoch for frame in frames]
    assert epochs == sorted(epochs)
    lost = sum(dropped.get(LOST, 0) for dropped in drops.values())
    numbers = [frame.seq for frame in frames]
    assert numbers == sorted(set(numbers))
    assert sent <= len(numbers) + lost


def children() -> list[int]:
    """The processes that this one has started for bins."""
    found = []
    for entry in os.listdir("/proc"):
        try:
            with open(f"/proc/{entry}/stat") as stat, open(f"/proc/{entry}/cmdline") as command:
                if int(stat.read().rpartition(")")[2].split()[1]) == os.getpid():
                    found += [int(entry)] if "processes.child" in command.read() else []
        except (OSError, ValueError):
            continue
    return found


def test_what_both_processes_of_a_link_had_is_counted() -> None:
    """Both are killed at the same time, with frames on the way between them."""
    sent = 100
    text = (
        f"fakesrc num-buffers={sent} sizetype=fixed sizemax=100 ! ( process=true restart=9 identity ) ! "
        "( process=true restart=9 identity sleep-time=10000 ) ! appsink name=out"
    )
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        frames = [pipeline["out"].pull(LIMIT_S) for _ in range(10)]
        for victim in children():
            os.kill(victim, signal.SIGKILL)
        frames += list(pipeline["out"])
        lost = sum(row.dropped.get(LOST, 0) for row in pipeline.statistics())
    assert_accounted([frame for frame in frames if frame is not None], sent, lost, 2)
    assert lost > 8


def test_the_delay_of_two_thousand_restarts_is_bounded() -> None:
    """It doubles up to 5 s, and never overflows."""
    text = "fakesrc ! ( process=true restart=2000 restart-window-s=1e9 identity ) ! fakesink"
    graph = Pipeline.parse(text).graph
    part = Part(graph, graph.processes[0])
    delays = [part.next_delay_s() or 0.0 for _ in range(2000)]
    assert delays[:7] == [0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 5.0]
    assert (min(delays), max(delays), part.next_delay_s()) == (0.1, 5.0, None)
