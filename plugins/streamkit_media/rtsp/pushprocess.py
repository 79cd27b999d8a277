"""Starts a push process, sends it packets, watches and ends it."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import time
from typing import Any

import msgspec

from streamkit_media.rtsp.pusher import PushMessage, PushPacket, message, take_messages

PUSHER = "streamkit_media.rtsp.pusher"
START_LIMIT_S = 30.0  # a loaded machine may need long to start Python; the server is not spoken to before
KILL_LIMIT_S = 5.0
READ_BYTES = 65_536


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
    """One process and the one connection that it makes; not for two threads at once.

    Its orders go through standard input, so that no password is in the list of processes.

    Attributes:
        is_opened: whether `open` was called.
        is_ready: whether the server records.
        is_done: whether the recording has ended.
        pending: packets offered that are not with the operating system yet.
        written: packets that are.

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
            bufsize=0,
            start_new_session=True,
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._stdin, self._stdout = self._process.stdin, self._process.stdout
        for pipe in (self._stdin, self._stdout):
            os.set_blocking(pipe.fileno(), False)
        self._outgoing = bytearray()
        self._received = bytearray()
        self._is_running = False
        self._began = time.monotonic()
        self.is_opened = self.is_ready = self.is_done = False
        self.pending = self.written = 0

    def open(self, order: dict[str, Any]) -> None:
        """Makes it connect by an order of `pusher.Push`, which has the longest silence `timeout_s`, too."""
        self.is_opened = True
        self._send_message(message(PushMessage.OPEN, order))

    def offer(self, packet: PushPacket) -> None:
        """Queues a packet; the next `exchange` raises a failure."""
        self.pending += 1
        self._send_message(message(PushMessage.PACKET, packet))

    def end(self) -> None:
        """Ends the recording once everything is written."""
        self._send_message(message(PushMessage.END))

    def exchange(self, wait_s: float) -> None:
        """Sends and receives what can be, after at most `wait_s`.

        Raises:
            PushFailure: the connection has failed, or the process has not started in time.
        """
        poller = select.poll()
        poller.register(self._stdout, select.POLLIN)
        if self._outgoing:
            poller.register(self._stdin, select.POLLOUT)
        for descriptor, _ in poller.poll(wait_s * 1000):
            if descriptor == self._stdin.fileno():
                self._send()
            else:
                self._receive()
        if not self._is_running and time.monotonic() - self._began > START_LIMIT_S:
            raise PushFailure(f"the push process has not started within {START_LIMIT_S:g} s")

    def close(self, limit_s: float) -> None:
        """Ends the process; kills it where the recording has not ended in time. Safe to call twice."""
        if self._stdin.closed:
            return
        self._outgoing.clear()
        self._stdin.close()
        try:
            self._process.wait(limit_s if self.is_ready else 0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait(KILL_LIMIT_S)
        try:
            self._receive()
        except PushFailure:
            pass  # it has ended: that is what was wanted
        finally:
            self._stdout.close()

    def _send_message(self, data: bytes) -> None:
        self._outgoing += data
        self._send()

    def _send(self) -> None:
        try:
            while self._outgoing:
                del self._outgoing[: os.write(self._stdin.fileno(), self._outgoing)]
        except BlockingIOError:
            pass
        except BrokenPipeError:
            self._outgoing.clear()  # why it has ended is among its answers

    def _receive(self) -> None:
        while not self.is_done:
            try:
                data = os.read(self._stdout.fileno(), READ_BYTES)
            except BlockingIOError:
                return
            if not data:
                if self._process.wait(KILL_LIMIT_S) == -signal.SIGALRM:
                    raise PushFailure("the server was silent", is_silent=True)
                raise PushFailure("its process has ended without an answer")
            self._received += data
            for kind, content in take_messages(self._received):
                self._handle(kind, content)

    def _handle(self, kind: PushMessage, content: bytes) -> None:
        if kind is PushMessage.AWAKE:
            self._is_running = True
        elif kind is PushMessage.READY:
            self.is_ready = True
        elif kind is PushMessage.WRITTEN:
            self.pending -= 1
            self.written += 1
        elif kind is PushMessage.DONE:
            self.is_done = True
        elif kind is PushMessage.FAILED:
            report = msgspec.msgpack.decode(content)
            raise PushFailure(str(report["reason"]), is_refused=bool(report["is_refused"]))
