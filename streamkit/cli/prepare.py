"""`streamkit prepare`: what plugins do once on each machine, done before the first run."""

from __future__ import annotations

import importlib.metadata
import subprocess
import sys
import time

import typer

from streamkit.cli.commands import CommandEntry

GROUP = "streamkit.preparations"
# A process of its own for each: they run side by side, and one that fails takes nothing with it.
CALL = "import sys; from importlib.metadata import EntryPoint; EntryPoint('', sys.argv[1], '').load()()"
LIMIT_S = 1800.0


def prepare() -> None:
    """Does beforehand what plugins do once on each machine, such as compiling, so that no first run waits.

    A plugin names a function without arguments in the entry-point group `streamkit.preparations`. What is
    done already is not done again.
    """
    entries = [
        CommandEntry(entry.name, entry.value, entry.dist)
        for entry in sorted(importlib.metadata.entry_points(group=GROUP), key=lambda entry: entry.name)
    ]
    began = time.monotonic()
    running = [(entry, _begin(entry)) for entry in entries]
    failures = 0
    try:
        for entry, process in running:
            said = process.communicate(timeout=LIMIT_S)[1]
            if process.returncode:
                failures += 1
                typer.echo(f"error: {_refusal(entry, process.returncode, said)}", err=True)
            else:
                typer.echo(f"{entry.name} is ready after {time.monotonic() - began:.1f} s")
    finally:
        for _, process in running:
            if process.poll() is None:
                process.kill()
                process.wait()
    if failures:
        raise typer.Exit(1)


def _begin(entry: CommandEntry) -> subprocess.Popen[str]:
    return subprocess.Popen([sys.executable, "-c", CALL, entry.target], stderr=subprocess.PIPE, text=True)


def _refusal(entry: CommandEntry, code: int, said: str) -> str:
    """What failed, why, and what helps."""
    reason = said.strip().rpartition("\n")[2] or f"it ended with {code}"
    return (
        f"{entry.name} ({entry.target}) cannot be prepared: {reason}; "
        f"reinstall or update {entry.package}, or tell its author"
    )
