"""Mutation fuzz of files through filesrc and decode: every variant must end in frames or one clear error.

Each batch runs in a process of its own, so that a crash is counted and the next batch goes on.

Run it:  STREAMKIT_DATA=... python benchmarks/fuzz_media.py [VARIANTS]
"""

from __future__ import annotations

import json
import os
import random
import resource
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

FILES = ("mp4parse/h264_white_frame_sar_16_9.mp4", "corpus/mkv/matroska.mkv", "corpus/avi/mjpeg.avi")
BATCH = 250
VARIANTS = 5000
LIMIT_S = 10.0
MEMORY_LIMIT_KB = 1 << 20
EXTREMES = (b"\xff\xff\xff\xff", b"\0\0\0\0", b"\x7f\xff\xff\xff", b"\x80\0\0\0")


def mutated(data: bytes, chance: random.Random) -> bytes:
    """A variant: bytes changed, runs copied, removed or zeroed, or the end cut off."""
    found = bytearray(data)
    for _ in range(chance.choice((1, 1, 2, 4, 16, 64))):
        at = chance.randrange(len(found))
        run = chance.randrange(1, 64)
        kind = chance.randrange(6)
        if kind <= 1:
            found[at] = chance.randrange(256)
        elif kind == 2:
            found[at : at + 4] = chance.choice(EXTREMES)
        elif kind == 3:
            found[at:at] = found[at : at + run]
        elif kind == 4 and len(found) > 2 * run:
            del found[at : at + run]
        elif kind == 5 and len(found) > 200 and chance.random() < 0.1:
            del found[at:]
        if not found:
            found = bytearray(data[:1])
    return bytes(found)


def run_batch(first: int, count: int, source: Path) -> None:
    """Plays variants in this process; one line of JSON for each."""
    from streamkit import ElementFailure, Pipeline, StreamkitError

    data = source.read_bytes()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"variant{source.suffix}"
        for number in range(first, first + count):
            path.write_bytes(mutated(data, random.Random(number)) or b"\0")
            began, outcome = time.monotonic(), "frames"
            pipeline = Pipeline.parse(f"filesrc location={path} ! decode ! fakesink name=out")
            try:
                pipeline.run(timeout_s=LIMIT_S)
                outcome = "frames" if pipeline["out"].count else "nothing"
            except ElementFailure as error:
                outcome = "error" if str(error).startswith(("filesrc", "decode")) else f"odd error {error}"
            except StreamkitError:
                outcome = "hang"
            print(json.dumps([number, outcome, time.monotonic() - began]), flush=True)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(json.dumps([-1, "memory" if peak > MEMORY_LIMIT_KB else "fits", peak]), flush=True)


def main() -> None:
    """Runs all batches and prints how the variants ended."""
    folder = Path(os.environ["STREAMKIT_DATA"]) / "data" / "odd_media"
    variants = int(sys.argv[1]) if len(sys.argv) > 1 else VARIANTS
    outcomes, slowest, peak = Counter[str](), 0.0, 0
    bad: list[str] = []
    for first in range(0, variants, BATCH):
        source = folder / FILES[first // BATCH % len(FILES)]
        command = [
            sys.executable,
            __file__,
            "--batch",
            str(first),
            str(min(BATCH, variants - first)),
            str(source),
        ]
        done = subprocess.run(command, capture_output=True, text=True, timeout=BATCH * LIMIT_S, check=False)
        rows = [json.loads(line) for line in done.stdout.splitlines()]
        if done.returncode:
            outcomes["crash"] += 1
            bad.append(
                f"{source.name}: exit {done.returncode} behind variant {rows[-1][0] if rows else first}"
            )
        for number, outcome, figure in rows:
            if number < 0:
                peak = max(peak, figure)
                continue
            outcomes[outcome] += 1
            slowest = max(slowest, figure)
            if outcome not in ("frames", "error"):
                bad.append(f"{source.name}: variant {number}: {outcome}")
    print(f"{variants} variants: {dict(outcomes)}; slowest {slowest:.2f} s; peak {peak / 1024:.0f} MB")
    print("\n".join(bad[:20]))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--batch"]:
        run_batch(int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4]))
    else:
        main()
