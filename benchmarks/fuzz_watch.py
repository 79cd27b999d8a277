"""Watches a fuzz run from outside: crashes, hangs, odd exceptions, descriptors and memory.

The cases run one after another in a process of their own, which is begun anew behind one that hangs or
crashes. Its memory and descriptors are compared between the end of the first tenth and the end of the run.
"""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import faulthandler
import gc
import json
import os
import resource
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

HANG_S = 5.0
ADDRESS_SPACE = 12 << 30
GROWTH_MB = 30.0
MIN_S = 20.0  # a process that lived shorter tells nothing of its memory
# Each new thread may take an arena of glibc's allocator, which keeps what it once held: that is no leak.
ONE_ARENA = {"MALLOC_ARENA_MAX": "1"}
PAGE_MB = resource.getpagesize() / 2**20
CASE_FILE = "case.txt"

Case = Callable[[int], tuple[str, Callable[[], str]]]


def footprint() -> tuple[float, list[str]]:
    """Resident memory in MB and what the open descriptors lead to, garbage taken out."""
    gc.collect()
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL("libc.so.6").malloc_trim(0)
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    found = []
    for entry in Path("/proc/self/fd").iterdir():
        with contextlib.suppress(OSError):  # that of the listing itself
            found.append(os.readlink(entry).partition(":[")[0])
    return pages * PAGE_MB, sorted(found)


def run_cases(first: int, seconds: float, case: Case, settled: int) -> None:
    """Runs cases in this process until the time is over; one line of JSON for what is odd, one at the end.

    Args:
        first: number of the first case.
        seconds: how long to go on.
        case: gives a case by its number.
        settled: cases after which every library has been loaded; memory is compared from then on.
    """
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
    began, number, outcomes, slowest_s = time.monotonic(), first, Counter[str](), 0.0
    at_tenth: tuple[float, list[str]] | None = None
    tenths_mb: list[float] = []
    uncaught: list[str] = []
    threading.excepthook = lambda args: uncaught.append(f"thread: {args.exc_type.__name__}: {args.exc_value}")
    sys.unraisablehook = lambda args: uncaught.append(f"unraisable: {args.exc_value!r}")
    while time.monotonic() < began + seconds:
        text, play = case(number)
        Path(CASE_FILE).write_text(f"{number}\n{text}", encoding="utf-8", errors="backslashreplace")
        faulthandler.dump_traceback_later(HANG_S, exit=True)
        started = time.monotonic()
        try:
            outcome = play()
        except Exception as error:
            outcome = f"odd: {type(error).__name__}: {error}"[:300]
        faulthandler.cancel_dump_traceback_later()
        if uncaught:
            outcome = f"odd: {uncaught.pop()}"
        slowest_s = max(slowest_s, time.monotonic() - started)
        outcomes[outcome.partition(":")[0]] += 1
        if outcome.startswith("odd"):
            print(json.dumps({"number": number, "case": text[:300], "outcome": outcome}), flush=True)
        number += 1
        if time.monotonic() > began + (len(tenths_mb) + 1) * seconds / 10:
            now = footprint()
            tenths_mb.append(round(now[0]))
            if number - first < settled and at_tenth is None:
                continue
            at_tenth = at_tenth or now
    print(
        json.dumps({
            "outcomes": outcomes, "next": number, "slowest_s": slowest_s, "seconds": time.monotonic() - began,
            "tenths_mb": tenths_mb, "at_tenth": at_tenth, "at_end": footprint(),
        })
    )  # fmt: skip


def watch(script: str, minutes: float) -> list[str]:
    """Runs the cases of a script for some minutes and prints figures; what was wrong."""
    deadline, first, bad = time.monotonic() + 60 * minutes, 0, list[str]()
    outcomes, slowest_s = Counter[str](), 0.0
    with tempfile.TemporaryDirectory() as folder:
        while (left_s := deadline - time.monotonic()) > 1.0:
            command = [
                sys.executable,
                str(Path(script).resolve()),
                "--first",
                str(first),
                "--seconds",
                str(left_s),
            ]
            done = subprocess.run(
                command,
                capture_output=True,
                text=True,
                cwd=folder,
                timeout=left_s + 120,
                check=False,
                env=os.environ | ONE_ARENA,
            )
            rows = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
            bad += [
                f"case {row['number']}: {row['outcome']!a}: {row['case']!a}" for row in rows if "case" in row
            ]
            last = rows[-1] if rows and "next" in rows[-1] else None
            if last is None:
                number, text = _last_case(Path(folder) / CASE_FILE, done.stderr)
                is_hang = "Timeout" in done.stderr
                outcomes["hang" if is_hang else "crash"] += 1
                end = "\n".join(done.stderr.strip().splitlines()[: 14 if is_hang else 30])
                ending = "hang" if is_hang else f"exit {done.returncode}"
                bad.append(f"case {number}: {ending}: {text[:300]!a}\n{end}")
                first = number + 1
                continue
            first, slowest_s = last["next"], max(slowest_s, last["slowest_s"])
            outcomes.update(last["outcomes"])
            bad += _growth(last)
    print(f"{first} cases: {dict(outcomes)}; slowest {slowest_s:.2f} s")
    return bad


def _last_case(file: Path, said: str) -> tuple[int, str]:
    """Number and text of the case that a process did not survive."""
    if not file.exists():
        raise RuntimeError(f"no case has begun: {said}")
    number, _, text = file.read_text(encoding="utf-8", errors="replace").partition("\n")
    return int(number), text


def _growth(last: dict[str, object]) -> list[str]:
    """What grew between the first tenth and the end of a process."""
    if last["at_tenth"] is None:
        return []
    (tenth_mb, tenth_open), (end_mb, end_open) = last["at_tenth"], last["at_end"]  # type: ignore[misc]
    print(
        f"memory after each tenth {last['tenths_mb']} MB, {end_mb:.0f} MB at the end; "
        f"descriptors {len(tenth_open)}, then {len(end_open)}"
    )
    if last["seconds"] < MIN_S:  # type: ignore[operator]
        return []
    found = []
    leaked = [kind for kind, count in Counter(end_open).items() if count > max(1, tenth_open.count(kind))]
    if leaked:  # a library may open a file of its own once
        found.append(f"descriptors of {leaked} grew from {tenth_open} to {end_open}")
    if end_mb - tenth_mb > GROWTH_MB:
        found.append(f"memory grew from {tenth_mb:.0f} to {end_mb:.0f} MB")
    return found


def main(script: str, case: Callable[[], Case], settled: int = 0) -> None:
    """The command line of a fuzz benchmark: exit 1 where anything was wrong.

    Args:
        script: the file that is run.
        case: makes the function that gives each case by its number: its text, and what plays it.
        settled: cases after which every library has been loaded.
    """
    parser = argparse.ArgumentParser()
    parser.add_argument("--minutes", type=float, default=10.0, help="How long to go on.")
    parser.add_argument("--first", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--seconds", type=float, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.first is not None:
        run_cases(options.first, options.seconds, case(), settled)
        return
    bad = watch(script, options.minutes)
    print("\n".join(bad[:40]) or "nothing wrong")
    sys.exit(1 if bad else 0)
