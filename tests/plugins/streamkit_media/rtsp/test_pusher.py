import signal
import subprocess
import sys
from collections.abc import Callable, Iterator

import msgspec
import pytest

from streamkit_media.rtsp.pusher import PushMessage, message, take_messages

Process = subprocess.Popen[bytes]


@pytest.fixture
def process() -> Iterator[Process]:
    """A push process that waits for what it is to do."""
    command = [sys.executable, "-m", "streamkit_media.rtsp.pusher"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as begun:
        yield begun
        begun.kill()


def order(port: int, timeout_s: float) -> bytes:
    """The message to connect to a port here."""
    url = f"rtsp://127.0.0.1:{port}/live"
    content = {"url": url, "options": {}, "codec": "h264", "width": 64, "height": 48, "timeout_s": timeout_s}
    return message(PushMessage.OPEN, content)


def test_it_ends_without_input(process: Process) -> None:
    """The process ends by itself when its input does."""
    answers, _ = process.communicate(timeout=20)
    assert take_messages(bytearray(answers)) == [(PushMessage.AWAKE, b""), (PushMessage.DONE, b"")]
    assert process.returncode == 0


def test_a_failure_is_its_last_answer(process: Process) -> None:
    """A refused connection is reported in FFmpeg's words."""
    answers, _ = process.communicate(order(1, 5.0), timeout=20)
    (_, (kind, content)) = take_messages(bytearray(answers))
    assert kind is PushMessage.FAILED
    assert msgspec.msgpack.decode(content) == {"reason": "Connection refused", "is_refused": False}


def test_it_ends_also_without_its_parent(process: Process, serve: Callable[[int], int]) -> None:
    """An alarm ends a process that waits for a silent server after its parent has exited."""
    process.communicate(order(serve(0), 0.1), timeout=20)
    assert process.returncode == -signal.SIGALRM
