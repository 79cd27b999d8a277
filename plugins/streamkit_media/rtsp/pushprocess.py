"""Starts a push process, sends it packets, watches and ends it."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time
from collections import deque
from contextlib import suppress
from typing import BinaryIO, cast

from streamkit_media.rtsp.pusher import PushAnswer, PushOrder, PushPacket, read_message, write_message

PUSHER = "streamkit_media.rtsp.pusher"
START_LIMIT_S = 30.0  # a loaded machine may need long to start Python; the server is not spoken to before
KILL_LIMIT_S = 5.0


class PushFailure(Exception):
    """A connection has failed.

    Attributes:
        reason: in FFmpeg's words.
        is_refused: whether the server wants other credentials.
        is_silent: whether the server did not answer in time: the process then ends by an alarm.
    """

    def __init__(self, reason: str, *, is_refused: bool = False, is_silent: bool = False) -> None:
        super().__init__(reason)
        self.reason, self.is_refused, self.is_silent = reason, is_refused, is_silent


class PushProcess:
    """One process and the one connection that it makes.

    A thread sends it one message after another, and waits for the answer to each. The messages go through
    standard input, so that no password is in the list of processes.

    Raises:
        OSError: the process cannot be started.
    """

    def __init__(self) -> None:
        # A session of its own: Ctrl-C in a terminal is for the pipeline, which then ends this in order.
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", PUSHER],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        self._began = time.monotonic()
        self._changed = threading.Condition()
        self._messages: deque[PushOrder | PushPacket | None] = deque()
        self._failure: PushFailure | None = None
        self._sent = self._answers = 0
        self.is_done = False  # whether the recording has ended
        # A daemon: without a call of `close` it must not keep the interpreter from ending.
        self._thread = threading.Thread(target=self._run, name="push", daemon=True)
        self._thread.start()

    @property
    def is_opened(self) -> bool:
        """Whether an order was sent."""
        return self._sent > 0

    @property
    def is_ready(self) -> bool:
        """Whether the server records; the first answer is that the process runs."""
        return self._answers > 1

    @property
    def written(self) -> int:
        """Packets that are with the operating system."""
        return max(0, self._answers - 2)

    @property
    def pending(self) -> int:
        """Packets sent that are not with the operating system yet."""
        return max(0, self._sent - 1) - self.written

    def send(self, message: PushOrder | PushPacket) -> None:
        """Queues a message, the first of which is an order; `check` raises a failure."""
        self._sent += 1
        self._queue(message)

    def end(self) -> None:
        """Ends the recording once everything is written."""
        self._queue(None)

    def _queue(self, message: PushOrder | PushPacket | None) -> None:
        with self._changed:
            self._messages.append(message)
            self._changed.notify_all()

    def check(self, wait_s: float = 0.0) -> None:
        """Waits for the next answer, for `wait_s` at most.

        Raises:
            PushFailure: the connection has failed, or the process has not started in time.
        """
        with self._changed:
            if wait_s and self._failure is None:
                self._changed.wait(wait_s)
        if self._failure is not None:
            raise self._failure
        if not self._answers and time.monotonic() - self._began > START_LIMIT_S:
            raise PushFailure(f"the push process has not started within {START_LIMIT_S:g} s")

    def close(self, limit_s: float) -> None:
        """Ends the process; kills it where the recording has not ended in time. Safe to call twice."""
        with self._changed:
            self._messages.clear()
        self.end()
        try:
            self._process.wait(limit_s if self.is_ready else 0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait(KILL_LIMIT_S)
        self._thread.join(KILL_LIMIT_S)

    # The thread that speaks to the process.

    def _run(self) -> None:
        stdin, stdout = cast("BinaryIO", self._process.stdin), cast("BinaryIO", self._process.stdout)
        failure: PushFailure | None = None
        with stdout:
            try:
                self._take_answer(stdout)
                while (message := self._next_message()) is not None:
                    with suppress(BrokenPipeError):  # why it has ended is its answer
                        write_message(stdin, message)
                    self._take_answer(stdout)
                with suppress(OSError):
                    stdin.close()
                if self.is_ready:
                    self._take_answer(stdout, is_last=True)
            except PushFailure as error:
                failure = error
            with suppress(OSError):
                stdin.close()
        with self._changed:
            self._failure = failure
            self._changed.notify_all()

    def _next_message(self) -> PushOrder | PushPacket | None:
        with self._changed:
            while not self._messages:
                self._changed.wait()
            return self._messages.popleft()

    def _take_answer(self, stdout: BinaryIO, *, is_last: bool = False) -> None:
        answer = read_message(stdout, PushAnswer)
        if answer is None:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(KILL_LIMIT_S)
            if self._process.returncode == -signal.SIGALRM:
                raise PushFailure("the server was silent", is_silent=True)
            raise PushFailure("its process has ended without an answer")
        if answer.failure:
            raise PushFailure(answer.failure, is_refused=answer.is_refused)
        with self._changed:
            self._answers += not is_last
            self.is_done = is_last
            self._changed.notify_all()
