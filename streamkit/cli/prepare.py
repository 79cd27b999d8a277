"""`streamkit prepare`: runs one-time preparations of plugins, such as compiling, before the first run."""

from __future__ import annotations

import subprocess
import sys
import time

import typer

from streamkit.cli.stderr import print_line
from streamkit.element.entries import PluginEntry, installed_entries

GROUP = "streamkit.preparations"
# One process each: they run in parallel, and failures are isolated.
CALL = "import sys; from importlib.metadata import EntryPoint; EntryPoint('', sys.argv[1], '').load()()"
LIMIT_S = 1800.0
PROGRESS_S = 0.5
CLEAR = "\r\x1b[K"


def prepare() -> None:
    """Runs one-time preparations of plugins, such as compiling, so that the first run does not wait.

    A plugin names a function without arguments in the entry-point group `streamkit.preparations`.
    Completed preparations are not repeated.
    """
    began = time.monotonic()
    running = [(entry, _begin(entry)) for entry in installed_entries("preparation", GROUP)]
    failures = 0
    try:
        for entry, process in running:
            stderr = _result(process, entry, began)
            if process.returncode:
                failures += 1
                reason = stderr.strip().rpartition("\n")[2] or f"it ended with {process.returncode}"
                what = f"{entry.name} ({entry.target})"
                print_line(f"error: {what} cannot be prepared: {reason}; {entry.remedy}")
            else:
                typer.echo(f"{entry.name} is ready after {time.monotonic() - began:.1f} s")
    finally:
        for _, process in running:
            if process.poll() is None:
                process.kill()
                process.wait()
    if failures:
        raise typer.Exit(1)


def _begin(entry: PluginEntry) -> subprocess.Popen[str]:
    return subprocess.Popen([sys.executable, "-c", CALL, entry.target], stderr=subprocess.PIPE, text=True)


def _result(process: subprocess.Popen[str], entry: PluginEntry, began: float) -> str:
    """Waits for a preparation; what it wrote to stderr. On a terminal a line says what is waited for."""
    is_terminal = sys.stderr.isatty()
    while time.monotonic() - began < LIMIT_S:
        try:
            return process.communicate(timeout=PROGRESS_S)[1]
        except subprocess.TimeoutExpired:
            if is_terminal:
                sys.stderr.write(f"{CLEAR}{entry.name} is being prepared, {time.monotonic() - began:.0f} s")
                sys.stderr.flush()
        finally:
            if is_terminal and process.poll() is not None:
                sys.stderr.write(CLEAR)
    process.kill()
    process.communicate()
    return f"it took more than {LIMIT_S:g} s"
