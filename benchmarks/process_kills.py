"""Kills children of a pipeline at random moments, again and again, and checks that nothing is lost uncounted.

    python benchmarks/process_kills.py [--kills 200] [--seed 1]

Runs alternate between bins that may be started again (the run must reach its end, each frame arrived or
counted) and bins that may not (the run must fail with an error that names the signal). After each run there
must be no child, no descriptor more than before, and nothing in /dev/shm that no other program uses.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import signal
import threading
import time
from collections import Counter
from pathlib import Path

from streamkit import ElementFailure, Pipeline

FRAMES = 400
KILLS_A_RUN = 5
VIDEO = f"videotestsrc num-buffers={FRAMES} pattern=ball ! video/x-raw, format=GRAY8, width=640, height=480"
PACE = "identity sleep-time=10000"  # 4 s a run at least
LIMIT_S = 300.0


def children() -> list[int]:
    """Processes of this one, zombies included."""
    text = "".join(path.read_text() for path in Path("/proc/self/task").glob("*/children"))
    return [int(word) for word in text.split()]


def shared_memory() -> set[str]:
    """Names in /dev/shm, but for those of zenoh in other programs: these pipelines do not use it."""
    return {name for name in os.listdir("/dev/shm") if not name.endswith(".zenoh")}


def is_mapped(name: str) -> bool:
    """Whether a process has this file of /dev/shm in its memory, as other programs have theirs."""
    for path in Path("/proc").glob("[0-9]*/maps"):
        with contextlib.suppress(OSError):  # the process has ended
            if f"/dev/shm/{name}" in path.read_text():
                return True
    return False


def open_descriptors() -> int:
    """How many this process has."""
    return len(os.listdir("/proc/self/fd"))


def kill_at_random(kills: int, dice: random.Random, is_over: threading.Event, done: Counter[str]) -> None:
    """Kills random children until the run is over or there were enough kills."""
    while done["kills"] < kills and not is_over.wait(dice.uniform(0.05, 1.0)):
        if there := children():
            os.kill(dice.choice(there), signal.SIGKILL)
            done["kills"] += 1


def run(kills: int, restarts: int, dice: random.Random) -> tuple[int, str]:
    """One run; returns how many kills it had, and what was wrong with it or ""."""
    bin_ = f"( process=true restart={restarts} restart-window-s=1"
    text = f"{VIDEO} ! {bin_} {PACE} ) ! {bin_} framediff ) ! fakesink name=out enable-last-sample=false"
    before = open_descriptors(), shared_memory()
    done: Counter[str] = Counter()
    is_over = threading.Event()
    failure = ""
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        killer = threading.Thread(target=kill_at_random, args=(kills, dice, is_over, done))
        killer.start()
        try:
            message = pipeline.wait(LIMIT_S)
            failure = str(message.error or "") if message is not None else "it did not end"
        except ElementFailure as error:
            failure = str(error)
        finally:
            is_over.set()
            killer.join()
        rows = {row.element: row for row in pipeline.statistics()}
    arrived = rows["out"].frames_in
    dropped = sum(sum(row.dropped.values()) for row in rows.values())
    return done["kills"], fault(done["kills"], restarts, failure, arrived, dropped) or remains(before)


def fault(kills: int, restarts: int, failure: str, arrived: int, dropped: int) -> str:
    """What a run did that was not declared; "" if nothing."""
    if not restarts:
        expected = "SIGKILL" in failure if kills else not failure
        return "" if expected else f"without restart it ended with {failure!r}"
    if failure:
        return f"with restart it failed: {failure}"
    # A frame at work in a process that dies may have come out, and is counted, too.
    is_accounted = FRAMES <= arrived + dropped <= FRAMES + kills
    return "" if is_accounted else f"{arrived} arrived and {dropped} counted, of {FRAMES}, {kills} kills"


def remains(before: tuple[int, set[str]]) -> str:
    """What is left of a run some seconds later; "" if nothing."""
    deadline = time.monotonic() + 10
    while time.monotonic() < deadline:
        more = open_descriptors() - before[0]
        left = {name for name in shared_memory() - before[1] if not is_mapped(name)}
        if not children() and more <= 0 and not left:
            return ""
        time.sleep(0.1)
    return f"left: children {children()}, {more} descriptors, {sorted(left)} in /dev/shm"


def main() -> None:
    """Prints each fault, and the count."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    dice = random.Random(arguments.seed)
    Pipeline.parse("fakesrc num-buffers=1 ! fakesink").run(LIMIT_S)  # opens what stays open
    kills = runs = faults = 0
    while kills < arguments.kills:
        restarts = 1000 if runs % 3 else 0
        made, text = run(KILLS_A_RUN if restarts else 1, restarts, dice)
        kills, runs = kills + made, runs + 1
        if text:
            faults += 1
            print(f"run {runs}, {made} kills: {text}", flush=True)
    print(f"{kills} kills in {runs} runs: {faults} runs with a fault")


if __name__ == "__main__":
    main()
