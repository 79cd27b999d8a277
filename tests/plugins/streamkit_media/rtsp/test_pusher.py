import io
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from streamkit_media.rtsp.pusher import (
    PushAnswer,
    PushOrder,
    PushPacket,
    read_message,
    write_message,
)

Process = subprocess.Popen[bytes]
TIMES = st.integers(-(2**63), 2**63 - 1)
PACKETS = st.builds(PushPacket, TIMES, TIMES, TIMES, st.booleans(), st.binary(max_size=100))


@pytest.fixture
def process() -> Iterator[Process]:
    """A push process that waits for what it is to do."""
    command = [sys.executable, "-m", "streamkit_media.rtsp.pusher"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as begun:
        yield begun
        begun.kill()


def order(port: int, timeout_s: float) -> bytes:
    """The message to connect to a port here."""
    pipe = io.BytesIO()
    write_message(pipe, PushOrder(f"rtsp://127.0.0.1:{port}/live", {}, "h264", 64, 48, timeout_s))
    return pipe.getvalue()


def answers_of(data: bytes) -> list[PushAnswer]:
    """All answers in the output of a process."""
    pipe = io.BytesIO(data)
    return list(iter(lambda: read_message(pipe, PushAnswer), None))


def test_it_ends_without_input(process: Process) -> None:
    """The process ends by itself when its input does."""
    answers, _ = process.communicate(timeout=20)
    assert answers_of(answers) == [PushAnswer()]
    assert process.returncode == 0


def test_a_failure_is_its_last_answer(process: Process) -> None:
    """A refused connection is reported in FFmpeg's words."""
    answers, _ = process.communicate(order(1, 5.0), timeout=20)
    assert answers_of(answers) == [PushAnswer(), PushAnswer("Connection refused")]


def test_it_ends_also_without_its_parent(process: Process, serve: Callable[[int], int]) -> None:
    """An alarm ends a process that waits for a silent server after its parent has exited."""
    process.communicate(order(serve(0), 0.1), timeout=20)
    assert process.returncode == -signal.SIGALRM


@given(st.lists(PACKETS, max_size=8))
def test_messages_come_out_as_they_went_in(sent: list[PushPacket]) -> None:
    """Times, flag and data of any packet survive the pipe, and nothing is left."""
    pipe = io.BytesIO()
    for content in sent:
        write_message(pipe, content)
    pipe.seek(0)
    assert [read_message(pipe, PushPacket) for _ in sent] == sent
    assert read_message(pipe, PushPacket) is None


def test_a_message_cut_short_is_the_end() -> None:
    """Where the other side ends within a length, nothing more is read."""
    assert read_message(io.BytesIO(b"\0\0"), PushPacket) is None
