"""Supervisor: what is started again, and what is not."""

from __future__ import annotations

import re
import signal
import subprocess
import sys

import pytest

from streamkit.service.supervisor import Supervisor
from tests.slowness import patience

COUNTS = "import os, sys; n = int(os.environ['STREAMKIT_RESTARTS']); {}"


def run(body: str) -> tuple[int, list[str]]:
    """Exit code and reports of a supervised program; `n` is the number of restarts before it."""
    reports: list[str] = []
    supervisor = Supervisor([sys.executable, "-S", "-c", COUNTS.format(body)], reports.append, 0.01)
    return supervisor.run(), reports


def test_a_failure_and_a_crash_are_started_again() -> None:
    """Until the command ends cleanly; each restart is reported, the delays double."""
    code, reports = run("sys.exit(1) if n == 0 else os.abort() if n == 1 else sys.exit(0)")
    assert code == 0
    assert reports == [
        "warning: the pipeline ended with code 1; restart 1 in 0.01 s",
        "warning: the pipeline was ended by signal 6; restart 2 in 0.02 s",
    ]


@pytest.mark.parametrize("code", [0, 2])
def test_the_end_and_a_bad_description_are_final(code: int) -> None:
    """No restart makes a description right."""
    assert run(f"sys.exit({code})") == (code, [])


def test_launch_passes_a_signal_to_its_child() -> None:
    """SIGTERM is a clean stop of both; the child has the same arguments without --supervise."""
    command = ["-e", "--supervise", "--log-format", "json", "fakesrc is-live=true ! identity ! fakesink"]
    process = subprocess.Popen(
        [sys.executable, "-c", "from streamkit.cli.main import main; main()", "launch", "-v", *command],
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    with process, process.stderr:
        for line in process.stderr:
            if "playing" in line:
                break
        process.send_signal(signal.SIGTERM)
        rest = process.stderr.read()
        assert process.wait(patience(20)) == 0, rest
    assert '"message": "ending the stream' in rest


def test_a_timed_log_has_the_time_of_a_restart() -> None:
    """As of each line of the run."""
    description = "fakesrc num-buffers=9 ! identity error-after=1 ! fakesink"
    command = ["--supervise", "--log-format", "timed", description]
    process = subprocess.Popen(
        [sys.executable, "-c", "from streamkit.cli.main import main; main()", "launch", *command],
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    with process, process.stderr:
        line = next(line for line in process.stderr if "restart" in line)
        process.terminate()
    assert re.fullmatch(
        r"\d{4}-\d\d-\d\dT[\d:.]{12}Z warning: the pipeline ended with code 1; restart 1 in 1 s\n", line
    )


def test_a_hang_up_that_nohup_ignores_ends_no_supervision() -> None:
    """What fails after it is started again."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        hang_up = "import signal; os.kill(os.getppid(), signal.SIGHUP); sys.exit(n == 0)"
        code, reports = run(hang_up)
    finally:
        signal.signal(signal.SIGHUP, before)
    assert (code, len(reports)) == (0, 1)
