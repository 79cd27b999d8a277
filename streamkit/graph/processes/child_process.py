"""ChildProcess: one child, its control channel, and what is known of its end."""

from __future__ import annotations

import contextlib
import itertools
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

import msgspec

from streamkit.crossing.channel import Channel, ChannelClosed
from streamkit.errors import ProcessDied
from streamkit.graph.processes.orders import (
    ENCODER,
    REPORTS,
    Order,
    OrderResult,
    Report,
    Setup,
    decode_failure,
)
from streamkit.handoff.library_threads import thread_variables

CHILD = "streamkit.graph.processes.child"
POLL_S = 0.2
PING_POLLS = 4  # a silent child is asked for an answer once in so many polls
END_LIMIT_S = 5.0  # from the end of the control channel to that of the process
ANSWER_LIMIT_S = 30.0  # a loaded machine may need long


class ChildProcess(threading.Thread):
    """Starts a child, reads what it reports, and outlives it.

    The thread that starts a child has to live as long, because the kernel ends the child with it.

    Attributes:
        silence_limit_s: after which the process is killed, if it does not answer; 0 is never. Holds once it
            is set up: importing may hold the interpreter for long.
        reason: why the process has ended, in words; "" while it runs.
        has_died: whether it has ended in another way than by an order to stop, or was killed for its silence.
        is_reported: whether its end was reported, as it came while the pipeline did not stop.

    Args:
        home: name of the bin.
        setup: its first message.
        marks: descriptor of memory that goes with it; closed here.
        processes: that share the cores, this one included.
        reported: called, in this thread, with reports other than answers.
        ended: called last, in this thread.
    """

    def __init__(
        self,
        home: str,
        setup: Setup,
        marks: int,
        processes: int,
        reported: Callable[[Report], None],
        ended: Callable[[ChildProcess], None],
    ) -> None:
        super().__init__(name=f"streamkit:process:{home}")
        self.reason = ""
        self.has_died = self.is_reported = False
        self.silence_limit_s = setup.watchdog_s
        self._home = home
        self._setup, self._marks, self._processes = setup, marks, processes
        self._reported, self._ended = reported, ended
        self._numbers = itertools.count(1)
        self._lock = threading.Lock()
        self._answers: dict[int, Future[Any]] = {}  # guarded by `_lock`
        self._is_over = False
        self._is_set_up = threading.Event()
        self._process: subprocess.Popen[bytes] | None = None
        ours, self._theirs = Channel.pair()
        self._control = Channel(ours)
        self._silent_polls: int | None = None  # since the newest report; None before the first

    # Called from other threads.

    def order(
        self,
        name: str,
        *arguments: Any,
        descriptors: tuple[int, ...] = (),
        limit_s: float = ANSWER_LIMIT_S,
    ) -> Future[Any]:
        """Sends an order, within a time limit.

        Returns:
            A future that gets the answer, or the exception that ended the order or the process.
        """
        deadline = time.monotonic() + limit_s
        number, answer = next(self._numbers), Future[Any]()
        is_sent = self._is_set_up.wait(limit_s)
        with self._lock:
            if self._is_over:
                answer.set_exception(self.death())
                return answer
            self._answers[number] = answer
        if is_sent:
            message = ENCODER.encode(Order(number, name, list(arguments)))
            with contextlib.suppress(ChannelClosed):  # the thread then ends the answer
                is_sent = self._control.send(message, descriptors, lambda: time.monotonic() > deadline)
        if not is_sent and self._take_answer(number) is not None:
            text = f"the process of {self._home} has not answered for {limit_s:g} s"
            answer.set_exception(ProcessDied(text))
        return answer

    def kill(self, reason: str = "") -> None:
        """Ends the process at once."""
        if not self.reason:
            self.reason, self.has_died = reason, bool(reason)
        process = self._process
        if process is not None and process.poll() is None:
            process.kill()

    def death(self) -> ProcessDied:
        """The error for the end of the process."""
        return ProcessDied(f"the process of {self._home} {self.reason or 'has ended'}")

    # The thread.

    def run(self) -> None:
        """Starts the process and reads its reports until it has ended."""
        try:
            process = self._process = self._spawn()
            self._control.send(
                ENCODER.encode(self._setup), (self._marks,), lambda: process.poll() is not None
            )
            self._is_set_up.set()
            while True:
                messages = self._control.receive(POLL_S)
                for message in messages:
                    self._take_report(REPORTS.decode(message))
                self._check_silence(bool(messages))
        except ChannelClosed:
            pass
        except (msgspec.DecodeError, ValueError) as error:
            self.kill(f"has sent something unreadable and was ended: {error}")
        except OSError as error:
            self.reason = f"could not be started: {error}"
        finally:
            os.close(self._marks)
            self._reap()
            with self._lock:
                self._is_over = True
            self._is_set_up.set()
            for number in list(self._answers):
                if (answer := self._take_answer(number)) is not None:
                    answer.set_exception(self.death())
            self._ended(self)

    def _spawn(self) -> subprocess.Popen[bytes]:
        descriptor = self._theirs.fileno()
        path = os.pathsep.join(path for path in sys.path if path)
        variables = thread_variables(self._processes) | os.environ | {"PYTHONPATH": path}
        try:
            # A session of its own: Ctrl-C in a terminal is for the pipeline, which then ends this in order.
            return subprocess.Popen(
                [sys.executable, "-P", "-m", CHILD, str(descriptor), str(os.getpid())],
                stdin=subprocess.DEVNULL,
                pass_fds=(descriptor,),
                env=variables,
                start_new_session=True,
            )
        finally:
            self._theirs.close()

    def _check_silence(self, has_spoken: bool) -> None:
        """Asks a silent child for an answer; kills one that gives none.

        Time is counted in polls, because a suspended process does not hang.
        """
        if has_spoken:
            self._silent_polls = 0
        elif self.silence_limit_s and self._silent_polls is not None:
            self._silent_polls += 1
            if self._silent_polls % PING_POLLS == 1:
                self._control.send(ENCODER.encode(Order(0, "ping")), (), lambda: True)
            elif self._silent_polls * POLL_S >= self.silence_limit_s:
                self.kill(f"has not answered for {self.silence_limit_s:g} s and was killed")

    def _take_report(self, report: Report) -> None:
        if not isinstance(report, OrderResult):
            self._reported(report)
            return
        answer = self._take_answer(report.number)
        if answer is None:
            return
        if report.failure is None:
            answer.set_result(report.value)
        else:
            answer.set_exception(decode_failure(report.failure))

    def _take_answer(self, number: int) -> Future[Any] | None:
        with self._lock:
            return self._answers.pop(number, None)

    def _reap(self) -> None:
        """Waits for the end of the process, and notes what has ended it."""
        self._control.shut_down()
        if self._process is None:
            return
        try:
            self._process.wait(END_LIMIT_S)
        except subprocess.TimeoutExpired:
            self.kill("did not end by itself and was ended")
            with contextlib.suppress(subprocess.TimeoutExpired):  # one that waits for a device ends later
                self._process.wait(END_LIMIT_S)
        self._control.close()
        code = self._process.returncode or 0
        self.has_died = self.has_died or code != 0
        if code < 0:
            name = signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"
            self.reason = self.reason or f"was ended by signal {-code} ({name})"
        else:
            self.reason = self.reason or f"has ended with code {code}"
