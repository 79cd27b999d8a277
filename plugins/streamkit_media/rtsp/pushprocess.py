"""Starts a push process, sends it packets, watches and ends it."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
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
        is_refused: whether the server wants valid credentials.
        is_silent: whether the server did not answer in time: the process then ends by an alarm.
    """

    def __init__(self, reason: str, *, is_refused: bool = False, is_silent: bool = False) -> None:
        super().__init__(reason)
        self.reason, self.is_refused, self.is_silent = reason, is_refused, is_silent


class PushProcess:
    """A process that makes one connection.

    A thread sends it one message after another, and waits for the answer to each. The messages go through
    standard input, so that no password is in the list of processes. `check` raises a failure.

    Attributes:
        is_ready: whether the server records.
        is_done: whether the recording has ended.
        written: packets that are with the operating system.

    Raises:
        OSError: the process cannot be started.
    """

    def __init__(self, order: PushOrder) -> None:
        # A session of its own: Ctrl-C in a terminal is for the pipeline, which then ends this in order.
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", PUSHER],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        self._stdin = cast("BinaryIO", self._process.stdin)
        self._stdout = cast("BinaryIO", self._process.stdout)
        self._ready_limit_s = time.monotonic() + START_LIMIT_S + order.timeout_s
        self.is_ready = self.is_done = False
        self.written = self._sent = 0
        self._thread = ThreadPoolExecutor(1, "push")
        self._answers: deque[Future[None]] = deque([self._thread.submit(self._connect, order)])

    @property
    def pending(self) -> int:
        """Packets sent that are not with the operating system yet."""
        return self._sent - self.written

    def send(self, packet: PushPacket) -> None:
        """Queues a packet."""
        self._sent += 1
        self._answers.append(self._thread.submit(self._push, packet))

    def end(self) -> None:
        """Ends the recording once everything is written."""
        self._answers.append(self._thread.submit(self._finish))

    def check(self, wait_s: float = 0.0) -> None:
        """Waits for the next answer, for `wait_s` at most.

        Raises:
            PushFailure: the connection has failed, or the process has not started in time.
        """
        while self._answers:
            try:
                self._answers[0].result(wait_s)
            except TimeoutError:
                break
            self._answers.popleft()
            wait_s = 0.0
        if not self.is_ready and time.monotonic() > self._ready_limit_s:
            raise PushFailure(f"the push process has not started within {START_LIMIT_S:g} s")

    def close(self, limit_s: float) -> None:
        """Ends the process; kills it where the recording has not ended in time. Safe to call twice."""
        if self._stdout.closed:
            return
        for answer in self._answers:
            answer.cancel()
        self.end()
        try:
            self._process.wait(limit_s if self.is_ready else 0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait(KILL_LIMIT_S)
        self._thread.shutdown()
        self._stdout.close()

    # In the thread that speaks to the process.

    def _connect(self, order: PushOrder) -> None:
        self._take_answer()  # that it runs
        self._exchange(order)
        self.is_ready = True

    def _push(self, packet: PushPacket) -> None:
        self._exchange(packet)
        self.written += 1

    def _finish(self) -> None:
        with suppress(OSError):
            self._stdin.close()
        if self.is_ready:
            self._take_answer()
            self.is_done = True

    def _exchange(self, message: PushOrder | PushPacket) -> None:
        with suppress(BrokenPipeError):  # why it has ended is its answer
            write_message(self._stdin, message)
        self._take_answer()

    def _take_answer(self) -> None:
        answer = read_message(self._stdout, PushAnswer)
        if answer is None:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(KILL_LIMIT_S)
            if self._process.returncode == -signal.SIGALRM:
                raise PushFailure("the server was silent", is_silent=True)
            raise PushFailure("its process has ended without an answer")
        if answer.failure:
            raise PushFailure(answer.failure, is_refused=answer.is_refused)
