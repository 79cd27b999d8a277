"""Supervisor: runs a command in a child, and again when it fails."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence

from streamkit.handoff.endwithparent import ending_with_parent
from streamkit.restart_delay import FIRST_DELAY_S, RestartDelay
from streamkit.service.signals import handling_signals

RESTARTS_VARIABLE = "STREAMKIT_RESTARTS"  # number of restarts before this one
CLEAN_EXITS = frozenset({0, 2})  # the end; a command that no restart makes right
# The command line, in a process of its own.
STREAMKIT_COMMAND = (sys.executable, "-c", "from streamkit.cli.main import main; main()")


class Supervisor:
    """Restarts a command that fails or dies, with delays that double up to a minute.

    Signals that end a pipeline are passed on to the child, and end the supervision with it.

    Args:
        command: the program and its arguments.
        report: called with a line for people at each restart.
        first_delay_s: before the first restart, s.
    """

    def __init__(
        self, command: Sequence[str], report: Callable[[str], None], first_delay_s: float = FIRST_DELAY_S
    ) -> None:
        self._command = list(command)
        self._report = report
        self._delay = RestartDelay(first_delay_s)
        self._stopping = threading.Event()
        self._child: subprocess.Popen[bytes] | None = None
        self.restarts = 0

    def run(self) -> int:
        """Runs until the command ends cleanly or a signal stops it; returns its exit code."""
        with handling_signals(self._pass_on):
            while True:
                began_s = time.monotonic()
                code = self._run_once()
                if code in CLEAN_EXITS or self._stopping.is_set():
                    return code if code >= 0 else 128 - code
                delay_s = self._delay.after(time.monotonic() - began_s)
                self.restarts += 1
                how = f"ended with code {code}" if code > 0 else f"was ended by signal {-code}"
                self._report(f"warning: the pipeline {how}; restart {self.restarts} in {delay_s:g} s")
                if self._stopping.wait(delay_s):
                    return 0

    def _run_once(self) -> int:
        """Runs the child to its end; its code, negative for a signal."""
        child = subprocess.Popen(
            ending_with_parent(self._command, signal.SIGTERM),
            env={**os.environ, RESTARTS_VARIABLE: str(self.restarts)},
            start_new_session=True,  # Ctrl-C in a terminal reaches it once, from here
        )
        self._child = child
        if self._stopping.is_set():  # the signal came before there was a child
            child.terminate()
        return child.wait()

    def _pass_on(self, number: int, _: object) -> None:
        self._stopping.set()
        if self._child is not None and self._child.poll() is None:
            self._child.send_signal(number)
