"""ChildProcess: one child, its control channel, and what is known of its end."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any

import msgspec

from streamkit.crossing.channel import POLL_S, Channel, ChannelClosed
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

if TYPE_CHECKING:
    from streamkit.graph.processes.part import Part
    from streamkit.graph.processes.processes import Processes

CHILD = "streamkit.graph.processes.child"
PING_POLLS = 4  # a silent child is asked for an answer once in so many polls
END_LIMIT_S = 5.0  # from the end of the control channel to that of the process
ANSWER_LIMIT_S = 30.0  # a loaded machine may need long


class ChildProcess(threading.Thread):
    """Starts a child and sets it up, reads what it reports until its channel closes, and waits for its end.

    An order waits until the child is set up, and for its answer until the child has ended. The thread has to
    live as long as the child, because the kernel ends the child with the thread that started it.

    Attributes:
        silence_limit_s: after which the process is killed, if it does not answer; 0 is never. Holds once it
            is set up: importing may hold the interpreter for long.
        reason: why the process has ended, in words; "" while it runs.
        has_died: whether it has ended in another way than by an order to stop.
        is_reported: whether its end was reported, as it came while the pipeline did not stop.

    Args:
        part: whose elements it runs.
        setup: its first message.
        marks: descriptor of memory that goes with it; closed here.
        processes: get, in this thread, reports other than answers, and its end, last.
    """

    def __init__(self, part: Part, setup: Setup, marks: int, processes: Processes) -> None:
        self._home = part.home.name
        super().__init__(name=f"streamkit:process:{self._home}")
        self.reason = ""
        self.has_died = self.is_reported = False
        self.silence_limit_s = setup.watchdog_s
        self._part, self._setup, self._marks, self._processes = part, setup, marks, processes
        self._lock = threading.Lock()  # guards the next three
        self._orders = 0
        self._waiting: dict[int, Future[Any]] = {}  # orders without an answer, by number
        self._end: ProcessDied | None = None  # why no more answers arrive
        self._takes_orders = threading.Event()  # it is set up, or has ended
        self._process: subprocess.Popen[bytes] | None = None
        ours, self._theirs = Channel.pair()
        self._control = Channel(ours)

    # Called from other threads.

    def order(
        self, name: str, *arguments: Any, descriptors: tuple[int, ...] = (), limit_s: float = ANSWER_LIMIT_S
    ) -> Future[Any]:
        """Sends an order, within a time limit.

        Returns:
            A future that gets the answer, or the exception that ended the order or the process.
        """
        deadline, answer = time.monotonic() + limit_s, Future[Any]()
        with self._lock:
            number = self._orders = self._orders + 1
            self._waiting[number] = answer
            end = self._end
        is_sent = end is None and self._takes_orders.wait(limit_s)
        if is_sent and not answer.done():
            message = ENCODER.encode(Order(number, name, list(arguments)))
            with contextlib.suppress(ChannelClosed):  # the thread then ends the answer
                is_sent = self._control.send(message, descriptors, lambda: time.monotonic() > deadline)
        if not is_sent:
            text = f"the process of {self._home} has not answered for {limit_s:g} s"
            self._answer(number, error=end or ProcessDied(text))
        return answer

    def _answer(self, number: int, value: Any = None, error: Exception | None = None) -> None:
        """Answers an order, unless it has an answer already."""
        with self._lock:
            answer = self._waiting.pop(number, None)
        if answer is not None and error is not None:
            answer.set_exception(error)
        elif answer is not None:
            answer.set_result(value)

    def kill(self, reason: str = "") -> None:
        """Ends the process at once."""
        self.reason = self.reason or reason
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
            self._takes_orders.set()
            self._read_reports()
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
                self._end, waiting = self.death(), list(self._waiting)
            for number in waiting:
                self._answer(number, error=self._end)
            self._takes_orders.set()
            self._processes.child_ended(self._part, self)

    def _spawn(self) -> subprocess.Popen[bytes]:
        descriptor = self._theirs.fileno()
        path = os.pathsep.join(path for path in sys.path if path)
        variables = thread_variables(self._processes.count) | os.environ | {"PYTHONPATH": path}
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

    def _read_reports(self) -> None:
        """Takes reports, and ends a child that is silent for too long, until the channel closes.

        Silence is counted in polls, because a suspended process does not hang, and from the first report on.
        """
        silent_polls: int | None = None
        while True:
            messages = self._control.receive()
            for message in messages:
                self._take_report(REPORTS.decode(message))
            if messages:
                silent_polls = 0
            elif self.silence_limit_s and silent_polls is not None:
                silent_polls += 1
                self._break_silence(silent_polls)

    def _break_silence(self, silent_polls: int) -> None:
        """Asks a silent child for an answer now and then; kills it at the limit."""
        if silent_polls % PING_POLLS == 1:
            self._control.send(ENCODER.encode(Order(0, "ping")), (), lambda: True)
        elif silent_polls * POLL_S >= self.silence_limit_s:
            self.kill(f"has not answered for {self.silence_limit_s:g} s and was killed")

    def _take_report(self, report: Report) -> None:
        if isinstance(report, OrderResult):
            error = None if report.failure is None else decode_failure(report.failure)
            self._answer(report.number, report.value, error)
        else:
            self._processes.reported(self._part, report)

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
        self.has_died = self._process.returncode != 0
        code = self._process.returncode or 0
        if code < 0:
            name = signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"
            self.reason = self.reason or f"was ended by signal {-code} ({name})"
        else:
            self.reason = self.reason or f"has ended with code {code}"
