"""The engine's own cost against GStreamer's: hops, queues, tee, an element written in Python, start-up.

Both engines stream empty frames from fakesrc to fakesink, in turn, five times; the table has the medians of
each and of the ratios. streamkit counts and times every frame, as it always does. Where GStreamer with its
Python bindings is not installed, only streamkit is measured.

Run it:  python benchmarks/engine.py [--quick]      (about two minutes)
"""

from __future__ import annotations

import argparse
import json
import shutil
import statistics
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

RUNS = Path(__file__).with_name("engine_runs.py")
SYSTEM_PYTHON = "/usr/bin/python3"
ONE_FRAME = "from streamkit import Pipeline; Pipeline.parse('fakesrc num-buffers=1 ! fakesink').run(10)"
ONE_BUFFER = (
    "import gi; gi.require_version('Gst', '1.0'); from gi.repository import Gst; Gst.init(None); "
    "p = Gst.parse_launch('fakesrc num-buffers=1 ! fakesink'); p.set_state(Gst.State.PLAYING); "
    "p.get_bus().timed_pop_filtered(10 * Gst.SECOND, Gst.MessageType.EOS); p.set_state(Gst.State.NULL)"
)


def chain(element: str, count: int) -> str:
    """A description with so many elements of a type in a row."""
    return " ! ".join(["fakesrc num-buffers=FRAMES", *[element] * count, "fakesink sync=false"])


@dataclass(frozen=True)
class Case:
    """What one more element costs each frame: (long - short) / elements, in us.

    Attributes:
        name: for the table.
        ours, peers: the short and the long description of either engine; no short one costs nothing.
        elements: by how many elements they differ, for either engine.
        target: the ratio to reach, or None where none is set.
    """

    name: str
    ours: tuple[str, str]
    peers: tuple[str, str]
    elements: tuple[int, int] = (1, 1)
    target: float | None = None


IDENTITY = "identity silent=true"
LARGE = "fakesrc num-buffers=FRAMES ! tee name=t " + 8 * (
    "t. " + "! queue ! identity ! identity ! identity ! identity " * 5 + "! fakesink async=false "
)
BRANCHES = "fakesrc num-buffers=FRAMES ! tee name=t " + "t. ! queue ! fakesink sync=false " * 4
IDENTITY_HOPS = (chain(IDENTITY, 1), chain(IDENTITY, 21))
QUEUES = (chain("queue", 0), chain("queue", 5))
PYTHON_ELEMENT = (chain("pynoop", 1), chain("pynoop", 5))
CASES = (
    Case("identity hop", IDENTITY_HOPS, IDENTITY_HOPS, (20, 20)),
    Case("hop through a transform that runs", (chain("pynoop", 1), chain("pynoop", 21)),
         IDENTITY_HOPS, (20, 20)),
    Case("queue crossing", QUEUES, QUEUES, (5, 5)),
    Case("tee with four queued branches", *[("", BRANCHES)] * 2, target=1.5),
    Case("element written in Python", (chain("pynoop", 1), chain("pynoop", 21)),
         PYTHON_ELEMENT, (20, 4), 0.05),
    Case("queue crossing, of a Python element", QUEUES, PYTHON_ELEMENT, (5, 4), 0.3),
    Case("frame, fakesrc to fakesink", *[("", chain(IDENTITY, 0))] * 2),
)  # fmt: skip


class Worker:
    """A process that runs descriptions in one engine."""

    def __init__(self, python: str, engine: str, seconds: float) -> None:
        self.seconds = seconds
        self._frames: dict[str, int] = {}
        self._process = subprocess.Popen(
            [python, str(RUNS), engine],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL if engine == "gstreamer" else None,
            text=True,
        )
        self.is_ready = "ready" in self._answer()

    def _answer(self) -> dict[str, float]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        found: dict[str, float] = json.loads(line) if line else {}
        return found

    def us_per_frame(self, text: str) -> float:
        """Wall time for each frame, us; the number of frames is chosen by a short run first."""
        if not text:
            return 0.0
        if text not in self._frames:
            self._ask(text, 500)
            trial = 4000
            self._frames[text] = max(500, round(trial * self.seconds / self._ask(text, trial)))
        frames = self._frames[text]
        return self._ask(text, frames) / frames * 1e6

    def whole_ms(self, text: str) -> float:
        """Time to build a graph, stream one frame through it and stop it, ms."""
        return sum(self._answers(text, 1)) * 1e3

    def _ask(self, text: str, frames: int) -> float:
        return self._answers(text, frames)[0]

    def _answers(self, text: str, frames: int) -> tuple[float, float]:
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps({"text": text, "frames": frames}) + "\n")
        self._process.stdin.flush()
        answer = self._answer()
        if not answer:
            raise SystemExit(f"the worker failed at: {text}")
        return answer["wall_s"], answer["rest_s"]

    def close(self) -> None:
        """Ends the process."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        try:
            self._process.wait(30)
        except subprocess.TimeoutExpired:
            self._process.kill()


def wall_ms(command: list[str]) -> float:
    """Wall time of a command, ms."""
    began = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True, timeout=60)
    return (time.perf_counter() - began) * 1e3


def measure_case(case: Case, ours: Worker, peer: Worker | None) -> tuple[float, float | None]:
    """Cost of the case's element in both engines, us, measured in turn."""
    short, long = (ours.us_per_frame(text) for text in case.ours)
    mine = (long - short) / case.elements[0]
    if peer is None:
        return mine, None
    short, long = (peer.us_per_frame(text) for text in case.peers)
    return mine, (long - short) / case.elements[1]


def print_row(name: str, unit: str, pairs: list[tuple[float, float | None]], target: float | None) -> None:
    """A line of the table: both medians, the median of the ratios, the target."""
    mine = statistics.median(pair[0] for pair in pairs)
    known = [(ours, theirs) for ours, theirs in pairs if theirs is not None]
    row = f"{name:<36} {mine:9.3f} {unit}"
    if known:
        theirs = statistics.median(pair[1] for pair in known)
        ratio = statistics.median(ours / peer for ours, peer in known)
        row += f" {theirs:9.3f} {unit} {ratio:8.3f}"
        if target is not None:
            row += f"   <= {target:g} {'yes' if ratio <= target else 'NO'}"
    print(row, flush=True)


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--quick", action="store_true", help="one short round: shows that it runs, measures nothing"
    )
    quick = parser.parse_args().quick
    rounds, seconds = (1, 0.02) if quick else (5, 0.8)
    ours = Worker(sys.executable, "streamkit", seconds)
    if not ours.is_ready:
        raise SystemExit("streamkit cannot be imported")
    peer = Worker(SYSTEM_PYTHON, "gstreamer", seconds) if Path(SYSTEM_PYTHON).exists() else None
    if peer is None or not peer.is_ready:
        print("GStreamer with Python bindings is not installed: only streamkit is measured")
        peer = None
    print(f"{'medians of ' + str(rounds):<36} {'streamkit':>12} {'GStreamer':>12} {'ratio':>8}   target")
    results: dict[str, list[tuple[float, float | None]]] = {case.name: [] for case in CASES}
    for _ in range(rounds):
        for case in CASES:
            results[case.name].append(measure_case(case, ours, peer))
    for case in CASES:
        print_row(case.name, "us", results[case.name], case.target)
    pairs = [(ours.whole_ms(LARGE), peer.whole_ms(LARGE) if peer else None) for _ in range(rounds)]
    print_row("graph of 210 elements, 40 queues", "ms", pairs, None)
    for worker in (ours, peer):
        if worker is not None:
            worker.close()
    starts(rounds, has_bindings=peer is not None)


def starts(rounds: int, *, has_bindings: bool) -> None:
    """Whole processes that stream one frame: the command line, and a program."""
    command = [
        str(Path(sys.executable).with_name("streamkit")),
        "launch",
        "-q",
        "fakesrc num-buffers=1 ! fakesink",
    ]
    gst_launch = shutil.which("gst-launch-1.0")
    gst_command = [gst_launch, "-q", "fakesrc", "num-buffers=1", "!", "fakesink"] if gst_launch else None
    program = [SYSTEM_PYTHON, "-c", ONE_BUFFER] if has_bindings else None
    for name, mine, theirs in (
        ("start-up of the command", command, gst_command),
        ("start-up of a Python program", [sys.executable, "-c", ONE_FRAME], program),
    ):
        for each in filter(None, (mine, theirs)):
            wall_ms(each)
        pairs = [(wall_ms(mine), wall_ms(theirs) if theirs else None) for _ in range(rounds)]
        print_row(name, "ms", pairs, None)


if __name__ == "__main__":
    main()
