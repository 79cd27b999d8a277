"""The benchmark of the engine runs, with GStreamer beside where that is installed."""

import re
import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "engine.py"
ROW = re.compile(r"^(\S.*?) +(-?\d+\.\d+) (us|ms)( +-?\d+\.\d+ (us|ms) +-?\d+\.\d+.*)?$")


def test_a_short_round_fills_the_table() -> None:
    """Every case has a figure in one run; the figures of so short a run mean nothing."""
    done = subprocess.run(
        [sys.executable, str(SCRIPT), "--quick"], capture_output=True, text=True, timeout=80, check=False
    )
    assert done.returncode == 0, done.stderr
    names = {found[1] for line in done.stdout.splitlines() if (found := ROW.match(line))}
    assert names >= {
        "identity hop",
        "hop through a transform that runs",
        "queue crossing",
        "tee with four queued branches",
        "element written in Python",
        "start-up of the command",
        "start-up of a Python program",
    }
