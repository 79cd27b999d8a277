"""Reports of crashes, and Ctrl-C during a call that hangs."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

COMMAND = [sys.executable, "-c", "from streamkit.cli.main import main; main()", "launch"]
PLUGIN = '''
import ctypes, os, signal, sys, time
from streamkit import Property, Transform

class Faulty(Transform):
    """Does harm in one of its calls."""

    sink = src = "ANY"
    where: str = Property("transform", doc="In which call.")
    harm: str = Property("hang", doc="What it does.")

    def start(self):
        self.act("start")

    def stop(self):
        self.act("stop")

    def transform(self, frame):
        if frame.seq == 3:
            self.act("transform")
        return frame

    def act(self, where):
        if where != self.where:
            return
        print("inside", flush=True)
        if self.harm == "segfault":
            ctypes.string_at(0)
        elif self.harm == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        end = time.monotonic() + 60  # in native code, which no signal interrupts for good
        while time.monotonic() < end:
            ctypes.CDLL(None).sleep(60)
'''
Launch = Callable[..., subprocess.Popen[str]]


@pytest.fixture
def launch(tmp_path: Path) -> Launch:
    """Starts `streamkit launch` with an element that does harm."""
    info = tmp_path / "faulty-1.dist-info"
    info.mkdir()
    (tmp_path / "faulty.py").write_text(PLUGIN, encoding="utf-8")
    (info / "METADATA").write_text("Name: faulty\nVersion: 1\n", encoding="utf-8")
    (info / "entry_points.txt").write_text("[streamkit.elements]\nfaulty = faulty:Faulty\n", encoding="utf-8")

    def start(*arguments: str, environment: dict[str, str] | None = None) -> subprocess.Popen[str]:
        path = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
        return subprocess.Popen(
            [*COMMAND, *arguments],
            env={**os.environ, "PYTHONPATH": path, **(environment or {})},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    return start


@pytest.mark.parametrize(("harm", "number"), [("segfault", signal.SIGSEGV), ("kill", signal.SIGKILL)])
def test_a_crash_names_the_active_elements(launch: Launch, harm: str, number: int) -> None:
    """After a segmentation fault the stacks of all threads are printed, too."""
    process = launch(f"fakesrc num-buffers=9 ! queue ! identity ! faulty name=lens harm={harm} ! fakesink")
    _, errors = process.communicate(timeout=60)
    assert process.returncode == -number
    last = errors.splitlines()[-1]
    assert last.startswith("error: the process has died; elements at work: ")
    assert "lens (faulty)" in last
    assert "identity" not in last
    assert ("faulty.py" in errors) == (harm == "segfault")


def test_the_report_of_a_json_log_is_an_object(launch: Launch) -> None:
    """As every line of it; a quote in a name ends no string."""
    description = """fakesrc num-buffers=9 ! faulty name="le\\"ns" harm=kill ! fakesink"""
    process = launch("--log-format", "json", description)
    _, errors = process.communicate(timeout=60)
    last = json.loads(errors.splitlines()[-1])
    assert (last["level"], sorted(last)) == ("error", ["level", "message", "time"])
    assert last["message"].startswith("the process has died; elements at work: ")
    assert 'le"ns (faulty)' in last["message"]


def test_a_clean_run_prints_no_crash_report(launch: Launch) -> None:
    """Neither at EOS nor after Ctrl-C."""
    process = launch("fakesrc num-buffers=9 ! fakesink")
    out, error = process.communicate(timeout=60)
    assert (out, error.count("\n"), error[:12]) == ("", 1, "9 frames in ")
    assert process.returncode == 0


@pytest.mark.parametrize(
    ("lens", "when"),
    [
        ("faulty name=lens where=start", "while lens was starting"),
        ("( process=true faulty name=lens where=start )", "before it played"),
    ],
)
def test_one_interrupt_abandons_a_start(launch: Launch, lens: str, when: str) -> None:
    """One that compiles loops returns much later; the line is plain."""
    process = launch(f"fakesrc num-buffers=9 ! {lens} ! fakesink")
    assert process.stdout is not None
    assert process.stdout.readline() == "inside\n"
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert (process.returncode, errors) == (0, f"interrupt: stopped {when}\n")


def test_an_interrupt_while_loops_compile_is_a_clean_stop(launch: Launch, tmp_path: Path) -> None:
    """Without machine code in the cache; each loop takes seconds."""
    process = launch(
        "dronetestsrc ! stitch ! fakesink", environment={"NUMBA_CACHE_DIR": str(tmp_path / "empty")}
    )
    assert process.stderr is not None
    assert "loops are being compiled" in process.stderr.readline()
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=30)  # compiling takes longer
    assert process.returncode == 0
    assert errors in (
        f"interrupt: stopped {when}\n" for when in ("while stitch0 was starting", "before it played")
    )


def test_one_interrupt_abandons_a_hanging_stop(launch: Launch) -> None:
    """The process ends within the grace period."""
    process = launch("--watchdog-s", "1", "fakesrc num-buffers=9 ! faulty name=lens where=stop ! fakesink")
    assert process.stdout is not None
    assert process.stdout.readline() == "inside\n"
    began = time.monotonic()
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 1
    assert time.monotonic() - began < 30
    assert "its stop has not returned" in errors
    assert "lens" in errors


def test_a_hanging_frame_ends_the_run(launch: Launch) -> None:
    """The error names element and frame within `--watchdog-s`, without user action."""
    process = launch("--watchdog-s", "1", "fakesrc num-buffers=9 ! faulty name=lens ! fakesink")
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 1
    assert errors.startswith("error: lens (faulty): the call with a frame has not returned for 1 s")
    assert "[at frame seq=3]" in errors
