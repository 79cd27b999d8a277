"""Start-up: the smallest pipeline on the command line against the import of numpy and typer alone.

Run it:  python benchmarks/startup.py
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from pathlib import Path

ROUNDS = 5
OURS = [str(Path(sys.executable).with_name("streamkit")), "launch", "fakesrc num-buffers=1 ! fakesink"]
PEER = [sys.executable, "-c", "import numpy, typer"]


def wall_s(command: list[str]) -> float:
    """Wall time of one run, s."""
    began = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True, timeout=60)
    return time.perf_counter() - began


def main() -> None:
    """Runs both in turn and prints medians and the median ratio of the pairs."""
    wall_s(OURS), wall_s(PEER)
    pairs = [(wall_s(OURS), wall_s(PEER)) for _ in range(ROUNDS)]
    ours, peer = (statistics.median(times) for times in zip(*pairs, strict=True))
    ratio = statistics.median(mine / theirs for mine, theirs in pairs)
    print(f"streamkit launch {ours:.3f} s   import numpy, typer {peer:.3f} s   ratio {ratio:.2f}")


if __name__ == "__main__":
    main()
