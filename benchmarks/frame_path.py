"""How many functions a frame passes on its way from a file to zenoh, by element; the path a newcomer follows.

A profiler counts the Python functions of streamkit and its plugins that are entered while a frame is on its
way, in the thread that carries it. The first frames, in which elements learn their formats, are left out.

Run it:  python benchmarks/frame_path.py [--frames 60] [--skip 30]
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
import threading
from collections import Counter
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

from streamkit import Pipeline

ROOT = Path(__file__).parents[1]
FOLDERS = (str(ROOT / "streamkit"), str(ROOT / "plugins"))
FLIGHT = "dronetestsrc num-buffers={frames} seed=1 ! videofilesink location={file}"
PATH = (
    "filesrc location={file} ! decode ! stitch ! framediff ! waveleteigen ! particletrack "
    "! zenohsink key=benchmark/path"
)
Sample = tuple[Counter[CodeType], int]


class FramePath:
    """Counts functions between two frames that leave the source.

    Attributes:
        samples: for each frame, the functions entered with how often, and the deepest nesting.
    """

    def __init__(self) -> None:
        self.samples: list[Sample] = []
        self._counts: Counter[CodeType] = Counter()
        self._depth = self._deepest = 0
        self._thread = 0

    def __call__(self, frame: FrameType, event: str, _: Any) -> None:
        """Takes one event of the profiler."""
        code = frame.f_code
        if code.co_name.startswith("<") or not code.co_filename.startswith(FOLDERS):
            return  # comprehensions and lambdas belong to the function around them
        if event == "call":
            if code.co_name == "_await_next" and "source" in code.co_filename:
                self._begin()
            if threading.get_ident() == self._thread:
                self._counts[code] += 1
                self._depth += 1
                self._deepest = max(self._deepest, self._depth)
        elif event == "return" and threading.get_ident() == self._thread:
            self._depth = max(0, self._depth - 1)

    def _begin(self) -> None:
        """The source is asked for its next frame: what was counted belongs to the one before."""
        self._thread = threading.get_ident()
        if self._counts:
            self.samples.append((self._counts, self._deepest))
        self._counts, self._depth, self._deepest = Counter(), 0, 0


def room_of(code: CodeType) -> str:
    """The package and its first folder or module: "streamkit_tracker"."""
    parts = Path(code.co_filename).relative_to(ROOT).parts
    return parts[1] if parts[0] == "plugins" else f"streamkit.{parts[1]}"


def measure(frames: int) -> list[Sample]:
    """Runs the path over a synthetic flight; a sample for each frame."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "flight.mp4")
        Pipeline.parse(FLIGHT.format(frames=frames, file=file)).run(timeout_s=300)
        path = FramePath()
        threading.setprofile(path)
        try:
            Pipeline.parse(PATH.format(file=file)).run(timeout_s=600)
        finally:
            threading.setprofile(None)
        return path.samples


def main() -> None:
    """Prints the medians over the frames, and a row for each package."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--skip", type=int, default=30, help="first frames to leave out")
    arguments = parser.parse_args()
    samples = measure(arguments.frames)[arguments.skip :]
    if not samples:
        sys.exit("no frame was left to look at: raise --frames")
    distinct = [len(counts) for counts, _ in samples]
    calls = [counts.total() for counts, _ in samples]
    print(f"{len(samples)} frames of a synthetic flight, filesrc to zenohsink, medians:")
    print(f"  functions passed  {statistics.median(distinct):6.0f}")
    print(f"  calls             {statistics.median(calls):6.0f}")
    print(f"  deepest nesting   {statistics.median(depth for _, depth in samples):6.0f}")
    for room in sorted({room_of(code) for counts, _ in samples for code in counts}):
        own = [sum(room_of(code) == room for code in counts) for counts, _ in samples]
        print(f"  {room:<24} {statistics.median(own):6.0f}")


if __name__ == "__main__":
    main()
