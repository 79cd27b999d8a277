"""Fuzz of telemetry through telemetryparse, posesync, filesrc and doctor: good checksums, hostile values.

One process runs all cases, another watches it. Violations are an exception that is not documented, a case of
more than 5 s, a descriptor that stays open, memory that grows after the first tenth of the cases, a number
that is not finite, and a frame that is lost.

Run it:  python benchmarks/fuzz_telemetry.py [--minutes 10] [--seed 1]
"""

from __future__ import annotations

import argparse
import json
import math
import os
import queue
import random
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import traceback
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

from hostile_telemetry import klv_stream, pieces, subtitles

from streamkit import Caps, ElementFailure, Frame, Pipeline, Pose, StreamkitError, raw_video_caps
from streamkit.testing import Harness
from streamkit_media.doctor.examine import examine

LIMIT_S = 5.0
GROWTH_MB = 8.0
PAGE_MB = os.sysconf("SC_PAGE_SIZE") / 1e6
KLV, TEXT, VIDEO = (
    Caps("meta/x-klv, parsed=(boolean)false"),
    Caps("text/x-raw, format=utf8"),
    raw_video_caps("GRAY8", 4, 2),
)


# What it is fed to.


def telemetry_frames(chance: random.Random) -> list[Frame]:
    """Frames of KLV or of subtitles."""
    if chance.random() < 0.3:
        texts = subtitles(chance).split("\n\n")
        return [Frame(text.encode("utf-8", "replace"), TEXT, pts=n * 10**9) for n, text in enumerate(texts)]
    pts = chance.choice((None, 0, 10**9, 1 << 62))
    return [Frame(data, KLV, pts=pts) for data in pieces(klv_stream(chance), chance)]


def no_constant(name: str) -> NoReturn:
    """JSON has no NaN and no infinity."""
    raise AssertionError(f"{name} in JSON")


def through_telemetryparse(chance: random.Random, _: Path) -> None:
    """Every line is JSON."""
    with Harness("telemetryparse") as harness:
        for frame in telemetry_frames(chance):
            for out in harness.push(frame):
                json.loads(out.data, parse_constant=no_constant)
        harness.drain()


def through_posesync(chance: random.Random, _: Path) -> None:
    """As many frames come out as went in, and their poses are finite."""
    with Harness("posesync") as harness:
        came, sent = [], 0
        for frame in telemetry_frames(chance):
            came += harness.push(frame, "telemetry")
            came += harness.push(Frame(bytes(8), VIDEO, pts=sent * 40_000_000))
            sent += 1
        check_poses(came + harness.drain(), sent)


def check_poses(frames: list[Frame], sent: int) -> None:
    """The rules of `through_posesync`."""
    assert len(frames) == sent, f"{len(frames)} of {sent} frames"
    for frame in frames:
        if (pose := frame.get(Pose)) is not None:
            assert abs(pose.latitude) <= 90, pose
            assert abs(pose.longitude) <= 180, pose
            values = (pose.altitude, pose.heading, pose.pitch, pose.roll, *(pose.sensor_angles or ()))
            assert all(value is None or math.isfinite(value) for value in values), pose


def telemetry_file(chance: random.Random, folder: Path) -> Path:
    """A file of bare packets or of subtitles."""
    path = folder / chance.choice(("t.klv", "t.SRT", "t.ts"))
    path.write_bytes(
        klv_stream(chance) if chance.random() < 0.5 else subtitles(chance).encode("utf-8", "replace")
    )
    return path


def from_file_to_posesync(chance: random.Random, folder: Path) -> None:
    """The file beside the video."""
    with Harness("posesync", location=str(telemetry_file(chance, folder))) as harness:
        times = [chance.randrange(40 * 10**9) for _ in range(50)]
        came = [out for pts in times for out in harness.push(Frame(bytes(8), VIDEO, pts=pts))]
        check_poses(came + harness.drain(), len(times))


def from_file_to_telemetryparse(chance: random.Random, folder: Path) -> None:
    """The file as a source."""
    Pipeline.parse(f"filesrc location={telemetry_file(chance, folder)} ! telemetryparse ! fakesink").run(
        timeout_s=LIMIT_S
    )


def to_doctor(chance: random.Random, folder: Path) -> None:
    """The file under examination; the report has to be JSON."""
    report = examine(str(telemetry_file(chance, folder)), 1.0, LIMIT_S, "tcp")
    json.loads(json.dumps(report.as_json(), default=str), parse_constant=no_constant)


CASES: tuple[Callable[[random.Random, Path], None], ...] = (
    through_telemetryparse,
    through_posesync,
    from_file_to_posesync,
    from_file_to_telemetryparse,
    to_doctor,
)


def is_documented(error: Exception) -> bool:
    """Whether an error is one that users are told of, and not what an element did not foresee."""
    return isinstance(error.cause if isinstance(error, ElementFailure) else error, StreamkitError)


def run_cases(minutes: float, seed: int) -> None:
    """Runs cases in this process; one line of JSON for each."""
    until = time.monotonic() + minutes * 60
    number = 0
    with tempfile.TemporaryDirectory() as folder:
        while time.monotonic() < until:
            case = CASES[number % len(CASES)]
            outcome, fault, began = "read", "", time.monotonic()
            try:
                case(random.Random(f"{seed}/{number}"), Path(folder))
            except Exception as error:
                outcome = "refused" if is_documented(error) else "violation"
                fault = "" if outcome == "refused" else "".join(traceback.format_exception(error))[-2000:]
            elapsed_s = time.monotonic() - began
            pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
            descriptors = len(os.listdir("/proc/self/fd"))
            print(
                json.dumps([number, case.__name__, outcome, elapsed_s, pages * PAGE_MB, descriptors, fault]),
                flush=True,
            )
            number += 1


# Who watches.


def watch(minutes: float, seed: int) -> tuple[list[list[Any]], list[str]]:
    """The rows of all cases, and what went wrong with the process that ran them."""
    command = [sys.executable, __file__, "--run", "--minutes", str(minutes), "--seed", str(seed)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    lines: queue.Queue[str] = queue.Queue()

    def read(stream: Any) -> None:
        for line in stream:
            lines.put(line)
        lines.put("")

    reader = threading.Thread(target=read, args=(process.stdout,))
    reader.start()
    rows: list[list[Any]] = []
    faults: list[str] = []
    try:
        while line := lines.get(timeout=30.0 if not rows else 2 * LIMIT_S):
            rows.append(json.loads(line))
    except queue.Empty:
        faults.append(f"hang behind case {rows[-1][0] if rows else 'none'}")
        process.kill()
    code = process.wait(timeout=30.0)
    reader.join()
    process.stdout.close()
    if code and not faults:
        faults.append(f"exit {code} behind case {rows[-1][0] if rows else 'none'}")
    return rows, faults


def violations(rows: list[list[Any]]) -> list[str]:
    """What the rows show that must not be."""
    found = [f"case {row[0]} {row[1]}: {row[6]}" for row in rows if row[2] == "violation"]
    found += [f"case {row[0]} {row[1]}: took {row[3]:.1f} s" for row in rows if row[3] > LIMIT_S]
    tenth = max(1, len(rows) // 10)
    first, last = rows[tenth : 2 * tenth], rows[-tenth:]
    if len(rows) >= 20:
        grown = statistics.median(row[4] for row in last) - statistics.median(row[4] for row in first)
        if grown > GROWTH_MB:
            found.append(f"memory grew by {grown:.1f} MB after the first tenth")
        more = min(row[5] for row in last) - min(row[5] for row in first)
        if more > 0:
            found.append(f"{more} descriptors more than at first stay open")
    return found


def main() -> int:
    """Runs the cases, prints figures; 1 where a rule was broken."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--run", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.run:
        run_cases(arguments.minutes, arguments.seed)
        return 0
    rows, faults = watch(arguments.minutes, arguments.seed)
    faults += violations(rows)
    kinds = Counter((row[1], row[2]) for row in rows)
    for (name, outcome), count in sorted(kinds.items()):
        print(f"{name:<30} {outcome:<10} {count:>7}")
    if rows:
        memory, descriptors = [round(row[4], 1) for row in rows], [row[5] for row in rows]
        tenth = len(rows) // 10
        print(f"{len(rows)} cases; slowest {max(row[3] for row in rows):.2f} s")
        print(f"memory after a tenth {memory[tenth]} MB, at the end {memory[-1]} MB, peak {max(memory)} MB")
        print(f"descriptors {descriptors[tenth]} after a tenth, {descriptors[-1]} at the end")
    print("\n".join(faults[:20]) or "no violation")
    return bool(faults) or not rows


if __name__ == "__main__":
    sys.exit(main())
