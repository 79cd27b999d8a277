"""Mutation fuzz of media: every variant ends in frames, in a file, or in one documented error.

Variants of real files and of small clips made here go through `filesrc ! decode ! fakesink`, or are remuxed
by packetsink. A child process handles variants one after the other as long as it lives; where one hangs or
crashes, the next child goes on behind it. Checked are: no undocumented exception, no hang, no crash, no
descriptor left open, and memory flat after the first tenth of what a child handled.

    STREAMKIT_DATA=... python benchmarks/fuzz_media.py [--minutes 10] [--seed 0] [--only hevc]

Exit code 1 where a check fails.
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import queue
import random
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

HANG_S = 5.0
START_S = 60.0  # a child imports its libraries first
LARGEST_SOURCE = 1 << 21
PAGE_MB = os.sysconf("SC_PAGE_SIZE") / 2**20
FLAT_MB, FLAT_SHARE = 40.0, 0.2  # memory may differ by either
ENOUGH_VARIANTS = 100  # of one child, to tell of its memory
EXTREMES = (b"\xff\xff\xff\xff", b"\0\0\0\0", b"\x7f\xff\xff\xff", b"\x80\0\0\0")
SUFFIXES = frozenset(
    {".ts", ".mp4", ".mkv", ".avi", ".264", ".h264", ".webm", ".flv", ".3gp", ".ogv", ".mpeg"}
)
JOBS = ("decode", ".mkv", ".ts", ".mp4")
ENCODERS = {
    "h264": ("libx264", {"g": "12", "bf": "2"}),
    "hevc": ("libx265", {"x265-params": "log-level=error:keyint=12"}),
    "mpeg4": ("mpeg4", {"g": "12"}),
    "mjpeg": ("mjpeg", {}),
}


def make_clips(folder: Path) -> None:
    """Writes 24 frames of each codec into each container that takes it."""
    import av
    import numpy as np

    rows, columns = np.mgrid[:96, :128]
    for name, (encoder, options) in ENCODERS.items():
        for suffix in ("ts", "mp4", "mkv"):
            if name == "mjpeg" and suffix == "ts":
                continue
            with av.open(str(folder / f"{name}.{suffix}"), "w") as container:
                stream = container.add_stream(encoder, rate=25, options=options)
                stream.width, stream.height = 128, 96
                stream.pix_fmt = "yuvj420p" if name == "mjpeg" else "yuv420p"
                for index in range(24):
                    pixels = np.full((144, 128), 128, np.uint8)
                    pixels[:96] = 40 + (rows * columns // 8 + 5 * index) % 160
                    frame = av.VideoFrame.from_ndarray(pixels, "yuv420p").reformat(format=stream.pix_fmt)
                    frame.pts, frame.time_base = index, Fraction(1, 25)
                    container.mux(stream.encode(frame))
                container.mux(stream.encode(None))


def sources(clips: Path, only: str) -> list[Path]:
    """The clips made and the small media of the data, in a fixed order."""
    data = Path(os.environ["STREAMKIT_DATA"]) / "data"
    found = [
        path
        for folder in (clips, data / "telemetry" / "klv_ts", data / "odd_media")
        for path in sorted(folder.rglob("*"))
        if path.suffix in SUFFIXES and path.stat().st_size <= LARGEST_SOURCE and only in path.name
    ]
    if not found:
        raise SystemExit(f"--only {only}: no file has this in its name")
    return found


def mutated(data: bytes, chance: random.Random) -> bytes:
    """A variant: bytes changed, runs copied, removed or zeroed, the end cut off; half of them at the head."""
    found = bytearray(data)
    reach = 4096 if chance.random() < 0.5 else len(found)
    for _ in range(chance.choice((1, 1, 2, 4, 16, 64))):
        at = chance.randrange(min(reach, len(found)))
        run = chance.randrange(1, 64)
        kind = chance.randrange(7)
        if kind <= 1:
            found[at] = chance.randrange(256)
        elif kind == 2:
            found[at : at + 4] = chance.choice(EXTREMES)
        elif kind == 3:
            found[at:at] = found[at : at + run]
        elif kind == 4 and len(found) > 2 * run:
            del found[at : at + run]
        elif kind == 5:
            found[at : at + run] = bytes(run)
        elif kind == 6 and len(found) > 200 and chance.random() < 0.1:
            del found[at:]
        if not found:
            found = bytearray(data[:1])
    return bytes(found)


# The child.


def handle_variants(first: int, seed: int, clips: Path, only: str) -> None:
    """Handles variants from `first` on without end; a line of JSON before and after each."""
    faults: list[str] = []
    threading.excepthook = lambda args: faults.append(f"thread: {args.exc_type.__name__}: {args.exc_value}")
    sys.unraisablehook = lambda args: faults.append(f"unraisable: {args.exc_value!r}")
    chosen = sources(clips, only)
    with tempfile.TemporaryDirectory() as folder:
        run_variant(chosen[0], chosen[0].read_bytes(), "decode", Path(folder))  # imports, caches
        number = first
        while True:
            source = chosen[number % len(chosen)]
            job = JOBS[number // len(chosen) % len(JOBS)]
            print(json.dumps([number, source.name, job]), flush=True)
            before, began = descriptors(), time.monotonic()
            data = mutated(source.read_bytes(), random.Random(seed << 32 | number)) or b"\0"
            outcome = run_variant(source, data, job, Path(folder))
            elapsed_s = time.monotonic() - began
            gc.collect()
            if faults:
                outcome = f"odd: {faults.pop()}"
            elif descriptors() > before:
                outcome = f"leak: {descriptors() - before} descriptors"
            print(json.dumps([outcome, elapsed_s, resident_mb()]), flush=True)
            number += 1


def run_variant(source: Path, data: bytes, job: str, folder: Path) -> str:
    """How one variant ended: frames, file, nothing, error, or "odd: ..."."""
    from streamkit import ElementFailure, Pipeline, StreamkitError
    from streamkit.errors import StateError

    path, copy = folder / f"variant{source.suffix}", folder / f"copy{job}"
    path.write_bytes(data)
    tail = "decode ! fakesink name=out" if job == "decode" else f"packetsink location={copy}"
    try:
        pipeline = Pipeline.parse(f"filesrc location={path} ! {tail}")
        pipeline.run(timeout_s=HANG_S)
        if job != "decode":
            return "file" if copy.is_file() and copy.stat().st_size else "nothing"
        return "frames" if pipeline["out"].count else "nothing"
    except ElementFailure as error:
        # What an element raises by its contract is one of the engine's own errors; all else is a fault of it.
        documented = isinstance(error.cause, StreamkitError)
        if job != "decode" and "packetsink" in str(error):
            return "recording ended" if documented else f"odd: {error}"
        return "error" if documented else f"odd: {error}"
    except StateError as error:
        return f"hang: {error}"
    except Exception as error:
        return f"odd: {type(error).__name__}: {error}"
    finally:
        copy.unlink(missing_ok=True)


def descriptors() -> int:
    """How many files, sockets and pipes this process has open."""
    return len(os.listdir("/proc/self/fd"))


def resident_mb() -> float:
    """The memory of this process, MB."""
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * PAGE_MB


# The parent.


@dataclass
class Findings:
    """What the children reported."""

    outcomes: Counter[str] = field(default_factory=Counter)
    violations: list[str] = field(default_factory=list)
    slowest_s: float = 0.0
    memory_mb: list[list[float]] = field(default_factory=list)

    def take(self, job: str, what: str, outcome: str, elapsed_s: float, resident: float) -> None:
        """Takes the end of one variant."""
        kind = outcome.partition(":")[0]
        self.outcomes[f"{'decode' if job == 'decode' else 'remux'} {kind}"] += 1
        self.slowest_s = max(self.slowest_s, elapsed_s)
        self.memory_mb[-1].append(resident)
        if kind in ("odd", "hang", "leak"):
            self.violations.append(f"{what}: {outcome}")

    def judge_memory(self) -> Iterator[str]:
        """A line for each child that lived long enough; a violation where its memory grew."""
        for levels in self.memory_mb:
            if len(levels) < ENOUGH_VARIANTS:
                continue
            tenth = len(levels) // 10
            rows = [statistics.median(levels[at * tenth : (at + 1) * tenth]) for at in range(10)]
            if rows[-1] - rows[1] > max(FLAT_MB, FLAT_SHARE * rows[1]):
                self.violations.append(f"memory grew from {rows[1]:.0f} to {rows[-1]:.0f} MB")
            yield f"{len(levels)} variants, by tenths {' '.join(f'{row:.0f}' for row in rows)} MB"


def run_child(findings: Findings, first: int, deadline: float, arguments: list[str]) -> int:
    """Runs one child until it hangs, crashes or the time is over; the number of the next variant."""
    command = [sys.executable, __file__, "--child", str(first), *arguments]
    lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
    with tempfile.TemporaryFile("w+") as errors:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True)
        assert process.stdout is not None
        reader = threading.Thread(target=_pass_on, args=(process.stdout, lines))
        reader.start()
        number, what, job = first - 1, "", ""
        findings.memory_mb.append([])
        limit_s = START_S
        try:
            while time.monotonic() < deadline:
                line = lines.get(timeout=limit_s)
                limit_s = 2 * HANG_S  # the engine has HANG_S, and its stop as much again
                if line is None and not what:
                    errors.seek(0)
                    raise SystemExit(f"the child did not start: {errors.read()}")
                if line is None:
                    findings.violations.append(f"{what}: crash, exit {process.wait()}")
                    break
                row = json.loads(line)
                if isinstance(row[0], int):
                    number, what, job = row[0], f"variant {row[0]}, {row[1]} to {row[2]}", row[2]
                else:
                    findings.take(job, what, *row)
        except queue.Empty:
            findings.violations.append(f"{what}: hang of the whole process")
        finally:
            process.kill()
            process.wait()
            reader.join()
            process.stdout.close()
        errors.seek(0)
        if "Traceback" in (said := errors.read()):
            findings.violations.append(f"{what}: traceback: {said.strip().splitlines()[-1]}")
    return number + 1


def _pass_on(stream: object, lines: queue.SimpleQueue[str | None]) -> None:
    for line in stream:  # type: ignore[attr-defined]
        lines.put(line)
    lines.put(None)


def main() -> int:
    """Runs children until the time is over and prints the figures; 1 where a check failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="part of a source's file name")
    parser.add_argument("--first", type=int, default=0, help="number of the first variant")
    chosen = parser.parse_args()
    findings, number = Findings(), chosen.first
    deadline = time.monotonic() + 60 * chosen.minutes
    with tempfile.TemporaryDirectory() as folder:
        make_clips(Path(folder))
        while time.monotonic() < deadline:
            number = run_child(findings, number, deadline, [str(chosen.seed), folder, chosen.only])
    levels = "; ".join(findings.judge_memory()) or "too few variants of one process to tell"
    total = findings.outcomes.total()
    print(f"{total} variants in {chosen.minutes:g} min: {dict(sorted(findings.outcomes.items()))}")
    print(f"slowest {findings.slowest_s:.2f} s; memory of one process: {levels}")
    print(f"{len(findings.violations)} violations")
    print("\n".join(findings.violations[:40]))
    return 1 if findings.violations or not total else 0


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        handle_variants(int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4]), sys.argv[5])
    else:
        sys.exit(main())
