"""Start-up: `streamkit launch` of a clip of one frame, against the import of its libraries alone.

    python benchmarks/startup.py [--rounds 5] [--python PYTHON]

The smallest pipeline is compared with the import of numpy and typer, the whole tracking pipeline on a file
with that of numpy, av, cv2 and numba. Compiled loops are in the cache, and modules are bytecode as after an
installation. Times include the end of the process.
`--python` takes the interpreter of another environment, for a comparison of versions.
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

LIMIT_S = 600.0
TRACKING = "stitch ! framediff ! waveleteigen ! particletrack"
WHOLE = f"filesrc location={{}} ! decode ! {TRACKING} ! fakesink"
MAIN = "import sys; from streamkit.cli.main import main; main()"
COMMANDS = ("--help", "inspect", "inspect stitch", "graph fakesrc!fakesink")


def cost(command: list[str]) -> tuple[float, float]:
    """Wall and processor time of one run, s."""
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
    began, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True, capture_output=True, timeout=LIMIT_S, env=environment)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.perf_counter() - began, cpu_s


def show(name: str, runs: list[tuple[float, float]]) -> None:
    """Prints the medians of what `cost` gave."""
    wall_s, cpu_s = map(statistics.median, zip(*runs, strict=True))
    print(f"{name:20s} {wall_s:6.2f} s   CPU {cpu_s:6.2f} s")


def compare(name: str, ours: list[str], peer: list[str], rounds: int) -> None:
    """Runs both in turn and prints medians."""
    cost(ours), cost(peer)
    pairs = [(cost(ours), cost(peer)) for _ in range(rounds)]
    show(name, [pair[0] for pair in pairs])
    show("  imports alone", [pair[1] for pair in pairs])
    ratio = statistics.median(mine[1] / theirs[1] for mine, theirs in pairs)
    print(f"{'  ratio of CPU':20s} {ratio:6.2f}")


def main() -> None:
    """Prints both comparisons, and the times of other commands."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--python", default=sys.executable)
    arguments = parser.parse_args()
    python = [arguments.python, "-c"]
    launch = [*python, MAIN, "launch", "-q"]
    with tempfile.TemporaryDirectory() as folder:
        os.environ["PYTHONPYCACHEPREFIX"] = f"{folder}/bytecode"
        flight = Path(folder) / "flight.mp4"
        cost([*launch, f"dronetestsrc num-buffers=1 ! videofilesink location={flight}"])
        smallest = [*launch, "fakesrc num-buffers=1 ! fakesink"]
        compare("smallest pipeline", smallest, [*python, "import numpy, typer"], arguments.rounds)
        whole = [*launch, WHOLE.format(flight)]
        compare("whole pipeline", whole, [*python, "import numpy, av, cv2, numba"], arguments.rounds)
        for words in COMMANDS:
            command = [*python, MAIN, *words.split()]
            cost(command)
            show(words, [cost(command) for _ in range(arguments.rounds)])


if __name__ == "__main__":
    main()
