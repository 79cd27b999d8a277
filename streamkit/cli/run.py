"""Runs a pipeline on the command line until EOS, error or Ctrl-C, and prints what it says."""

from __future__ import annotations

import contextlib
import gc
import math
import os
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING

from msgspec.structs import replace

from streamkit.cli.crash_report import CrashReport
from streamkit.cli.stderr import prints_json
from streamkit.errors import ElementFailure, HangDetected, StartCancelled, StateError, StreamkitError
from streamkit.flow.messages import LostConnections, Message, MessageKind
from streamkit.service.monitor import Monitor
from streamkit.service.signals import handling_signals

if TYPE_CHECKING:
    from streamkit.cli.display import Display
    from streamkit.flow.statistics import RunStatistics
    from streamkit.graph.pipeline import Pipeline

BEAT_S = 0.2
SAME_INTERRUPT_S = 0.1  # `timeout` signals the process, and then its whole group


class Run:
    """Plays a pipeline to its end.

    Args:
        pipeline: the pipeline.
        display: what is printed on.
        eos_on_shutdown: whether the first interrupt sends EOS and waits for it.
        verbose: whether to print caps, states and every message.
        quiet: whether to print errors only.
        monitor: notified of the beginning and the end, and at each beat.
        beat_s: maximum interval at which the display and the monitor are updated and interrupts are noticed.

    Attributes:
        has_played: whether the pipeline has started.
        interrupts: number of Ctrl-C, SIGTERM, SIGHUP, and calls of `interrupt`.
        statistics: counters at the end; what elements have counted while they stopped is in them.
        printer: prints what the pipeline says.
        abandons_start: whether an interrupted start has not returned, such as one that compiles loops.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        display: Display,
        *,
        eos_on_shutdown: bool,
        verbose: bool,
        quiet: bool,
        monitor: Monitor | None = None,
        beat_s: float = BEAT_S,
    ) -> None:
        self.pipeline = pipeline
        self.display = display
        self._beat_s = beat_s
        self.eos_on_shutdown = eos_on_shutdown
        self.monitor = monitor or Monitor(pipeline)
        self.printer = MessagePrinter(pipeline, display, verbose=verbose, quiet=quiet)
        self.interrupts = 0
        self._signalled_s = -math.inf
        self.has_played = self.abandons_start = False
        self.statistics: RunStatistics | None = None
        self._is_watching = False

    def run(self) -> int:
        """Plays to the end and stops; returns the exit code."""
        code = 0
        for _, text in self.pipeline.graph.warnings:
            self.printer.say("note", text)
        with handling_signals(lambda *_: self.interrupt()):  # starting a process takes some time
            report = CrashReport(self.pipeline.graph.elements, is_json=prints_json())
        try:
            with self._signals(report):
                code = self._play()
                code = self._stop() or code
                while (message := self.pipeline.bus.pop()) is not None:  # posted while it stopped
                    self.printer.print(message)
                if self.statistics is not None:
                    self.display.end(self.statistics)
        finally:
            report.close()
        return code

    def interrupt(self) -> None:
        """Does what Ctrl-C does, from any thread: ends the stream or stops."""
        self.interrupts += 1
        if not self._is_watching:
            self.pipeline.cancel()

    def _play(self) -> int:
        """Plays the pipeline to its end; returns the exit code so far."""
        try:
            with self.display.starting():
                self.pipeline.play()
            self.has_played = True
            self.printer.is_starting = False
            self.display.begin()
            # Garbage collection of imported objects would block a live feed for 60 ms.
            gc.freeze()
            self._is_watching = True
            self.monitor.begin()
            return self._watch()
        except StreamkitError as error:
            if isinstance(error, ElementFailure) and self._report_interrupt(error):
                return 0
            return self._fail(str(error), error)
        finally:
            self._is_watching = False
            self.printer.print_caps()
            self.statistics = self.display.measure()
            gc.unfreeze()

    def _report_interrupt(self, error: ElementFailure) -> bool:
        """Prints that an interrupt made the start fail; False if it did not."""
        self.abandons_start = bool(self.interrupts) and isinstance(error.cause, HangDetected)
        if self.abandons_start:
            self._print_interrupt(f"stopped while {error.element} was starting")
        elif isinstance(error.cause, StartCancelled):
            self._print_interrupt("stopped before it played")
        else:
            return False
        return True

    def _stop(self) -> int:
        """Stops the pipeline; returns 1 if a call of an element was abandoned."""
        self.monitor.end()
        try:
            self.pipeline.stop()
        except StateError as error:
            return self._fail(str(error))
        finally:
            self._count_stop()
        return 0

    def _count_stop(self) -> None:
        """Adds what elements have counted while they stopped, such as a file that is complete only then."""
        if self.statistics is not None:
            ages = {row.element: row.age_ns for row in self.statistics.elements}
            rows = [replace(row, age_ns=ages.get(row.element)) for row in self.pipeline.statistics()]
            self.statistics = replace(self.statistics, elements=rows)

    def _watch(self) -> int:
        """Handles messages and interrupts until the end."""
        deadline: float | None = None
        limit_s, handled = self.pipeline.watchdog_s, 0
        while True:
            message = self.pipeline.bus.pop(self._beat_s)
            if message is not None:
                self.printer.print(message)
            self.printer.print_caps()
            self.display.show()
            self.monitor.beat()
            if message is not None:
                if message.kind is MessageKind.ERROR:
                    return self._fail(message.text, message.error)
                if message.kind is MessageKind.EOS:
                    return 0
            if self.interrupts > handled:
                handled = self.interrupts
                if not self.eos_on_shutdown or handled > 1:
                    self._print_interrupt("stopping; Ctrl-C again ends the process at once")
                    return 0
                self._print_interrupt("ending the stream; Ctrl-C again stops at once")
                self.pipeline.finish()
                deadline = time.monotonic() + (limit_s or math.inf)
            if deadline is not None and time.monotonic() > deadline:
                return self._fail(
                    f"EOS did not arrive within {limit_s:g} s of the interrupt; allow more by --watchdog-s"
                )

    @contextlib.contextmanager
    def _signals(self, report: CrashReport) -> Iterator[None]:
        """Counts Ctrl-C, SIGTERM and SIGHUP; a further one during a clean stop ends the process at once.

        Signals within `SAME_INTERRUPT_S` count once, until the first is answered.
        While the pipeline starts or stops, the first one abandons calls that did not return.
        """
        limit = 2 if self.eos_on_shutdown else 1

        def interrupted(number: int, _: object) -> None:
            earlier_s, self._signalled_s = self._signalled_s, time.monotonic()
            if self._signalled_s - earlier_s < SAME_INTERRUPT_S:
                return
            self.interrupt()
            if self.interrupts > limit:
                self.display.abandon()
                report.close()
                os._exit(128 + number)

        with handling_signals(interrupted):
            yield

    def _print_interrupt(self, text: str) -> None:
        """Answers an interrupt; from now on a further one counts, however soon."""
        self._signalled_s = -math.inf
        self.printer.say("interrupt", text)

    def _fail(self, text: str, error: Exception | None = None) -> int:
        """Prints an error; returns the exit code."""
        self.printer.print_error(text, error)
        return 1


class MessagePrinter:
    """Prints errors, unless `quiet` also notes, warnings and interrupts, and with `verbose` everything.

    Attributes:
        quiet: whether to print errors only.
        is_starting: whether warnings are printed at once; afterwards the loop that reads the bus prints them.
        shortfalls: warnings that something the pipeline is for was not made.
    """

    def __init__(self, pipeline: Pipeline, display: Display, *, verbose: bool, quiet: bool) -> None:
        self._pipeline, self._display = pipeline, display
        self._verbose, self.quiet = verbose, quiet
        self.shortfalls: list[str] = []
        self.is_starting = True
        self._printed: list[Message] = []  # while it started
        self._caps: dict[str, str] = {}  # by path of the src pad
        self._lost = LostConnections()
        pipeline.bus.watch(self._print_of_start)

    def _print_of_start(self, message: Message) -> None:
        """Prints a warning at once: it may announce minutes of compiling loops."""
        if self.is_starting and message.kind is MessageKind.WARNING:
            self.print(message)
            self._printed.append(message)

    def print(self, message: Message) -> None:
        """Prints a message unless it is an error, or was printed while the pipeline started."""
        if any(message is other for other in self._printed):
            return
        source, name = message.source or "pipeline", message.fields.get("name")
        if message.is_shortfall:
            self.shortfalls.append(f"{message.source}: {message.text}")
        if message.kind is MessageKind.WARNING:
            self.say("warning", f"{source}: {message.text}")
        elif name == "note":
            self.say("note", f"{message.source}: {message.fields.get('text')}")
        elif self._verbose and message.kind is not MessageKind.ERROR:
            known = "state" if message.kind is MessageKind.STATE else "name"  # in the text already
            fields = " ".join(f"{key}={value}" for key, value in message.fields.items() if key != known)
            self.say(message.kind, f"{source}: {message.text} {fields}".rstrip())
        elif self._lost.update(message):  # after the warning that it was lost
            self.say("note", f"{message.source}: connected again")

    def say(self, level: str, text: str) -> None:
        """Prints a line "level: text"; with `quiet` only errors."""
        if level == "error" or not self.quiet:
            self._display.print_line(f"{level}: {text}")

    def print_error(self, text: str, error: Exception | None) -> None:
        """Prints an error; of an unexpected exception also the place."""
        if isinstance(error, ElementFailure) and error.place:
            if self._verbose:
                self._display.print_line(error.traceback)
            text += f" ({error.place})"
        self.say("error", text)

    def print_caps(self) -> None:
        """Prints the caps of links that have new ones."""
        if not self._verbose:
            return
        for src, sink in self._pipeline.graph.links():
            caps = str(src.caps) if src.caps is not None and not src.caps.is_any else ""
            if caps and self._caps.get(src.path) != caps:
                self._caps[src.path] = caps
                self.say("caps", f"{src.path} -> {sink.path}: {caps}")
