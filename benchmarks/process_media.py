"""Odd and damaged media through one pipeline whose decoder is a process that may be started again.

    STREAMKIT_DATA=... python benchmarks/process_media.py [--mutants 5000] [--seed 1]

The main process sends every file of data/odd_media, then variants of the small ones, into a bin with
`process=true restart=N`, which reads and decodes each and sends the frames back. The run has to reach its
end: every file is answered, or counted as lost with a process that died. Prints how the files ended, the
restarts, and the memory of the main process over the run.
"""

from __future__ import annotations

import argparse
import importlib
import os
import random
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from fuzz_media import MAX_SOURCE, SUFFIXES, mutated

from streamkit import Caps, ElementFailure, Frame, Pipeline, StreamkitError, Transform
from streamkit.graph.statistics import resident_bytes

FILE_S = 15.0  # longest time for a file
WATCHDOG_S = 30.0
MAX_WAIT_S = 10 * WATCHDOG_S
END_S = 60.0
OUTCOME = Caps("application/x-outcome")
BIN = f"( process=true restart=100000 watchdog-s={WATCHDOG_S:g} decodemedia )"
TEXT = f"appsrc name=in max-buffers=4 caps=application/x-media ! {BIN} ! appsink name=out max-buffers=4"


class DecodeMedia(Transform):
    """Decodes the file that a frame holds, its suffix first; returns its frames, then how it ended."""

    sink = src = "ANY"

    def transform(self, frame: Frame) -> Iterator[Frame]:
        """Runs a pipeline for the file."""
        suffix, _, content = frame.data.partition(b"\0")
        with tempfile.NamedTemporaryFile(suffix=suffix.decode()) as file:
            file.write(content)
            file.flush()
            count, ending = 0, "end"
            began_s = time.monotonic()
            try:
                with Pipeline.parse(f"filesrc location={file.name} ! decode ! appsink name=out") as pipeline:
                    pipeline.play()
                    for decoded in pipeline["out"]:
                        count += 1
                        yield frame.replace(data=decoded.data, caps=decoded.caps)
                        if time.monotonic() - began_s > FILE_S:
                            ending = "too long"
                            break
            except StreamkitError as error:
                is_documented = not isinstance(error, ElementFailure) or isinstance(
                    error.cause, StreamkitError
                )
                ending = "error" if is_documented else f"odd: {error}"
        yield frame.replace(data=f"{'frames' if count else 'no frame'}, {ending}".encode(), caps=OUTCOME)


def install(folder: Path) -> None:
    """Makes the element known to this process and its children."""
    info = folder / "process_media-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: process_media\nVersion: 1\n")
    (info / "entry_points.txt").write_text("[streamkit.elements]\ndecodemedia = process_media:DecodeMedia\n")
    sys.path.append(str(folder))
    importlib.invalidate_caches()


def files(mutants: int, dice: random.Random) -> Iterator[bytes]:
    """Each file of the data, then variants of the small ones."""
    whole = [path for path in sorted(odd_media().rglob("*")) if path.is_file()]
    small = [path for path in whole if path.suffix in SUFFIXES and path.stat().st_size <= MAX_SOURCE]
    for path in whole:
        yield path.suffix.encode() + b"\0" + path.read_bytes()
    for number in range(mutants):
        path = small[number % len(small)]
        yield path.suffix.encode() + b"\0" + (mutated(path.read_bytes(), dice) or b"\0")


def odd_media() -> Path:
    """The folder of the files."""
    return Path(os.environ["STREAMKIT_DATA"]) / "data" / "odd_media"


def feed(pipeline: Pipeline, mutants: int, dice: random.Random, sent: Counter[str]) -> None:
    """Sends all files, then EOS; ends early if the pipeline fails."""
    source = pipeline["in"]
    for content in files(mutants, dice):
        try:
            source.push(content, timeout_s=MAX_WAIT_S)
        except StreamkitError:
            return  # the main thread prints why
        sent["files"] += 1
    source.end()


def run(mutants: int, seed: int) -> str:
    """One run; prints figures; what was wrong, or ""."""
    sent, endings = Counter[str](), Counter[str]()
    memory_mib: list[int] = []
    with Pipeline.parse(TEXT) as pipeline:
        restarts: list[str] = []
        pipeline.bus.watch(
            lambda message: (
                restarts.append(message.text) if message.fields.get("code") == "process-restart" else None
            )
        )
        pipeline.play()
        feeder = threading.Thread(target=feed, args=(pipeline, mutants, random.Random(seed), sent))
        feeder.start()
        began_s = time.monotonic()
        for frame in pipeline["out"]:
            if frame.caps.name != OUTCOME.name:
                endings["frames of video"] += 1
                continue
            endings[bytes(frame.data).decode()] += 1
            endings["files"] += 1
            if endings["files"] % 500 == 0:
                memory_mib.append(resident_bytes() >> 20)
                print(f"{endings['files']} files, {time.monotonic() - began_s:.0f} s", flush=True)
        message = pipeline.wait(END_S)
        feeder.join()
        lost = sum(sum(row.dropped.values()) for row in pipeline.statistics())
    for ending, count in sorted(endings.items()):
        print(f"{count:7d} {ending}")
    print(f"{len(restarts)} restarts, {lost} frames lost with a process, main process {memory_mib} MiB")
    for text in restarts[:10]:
        print(f"  {text}")
    if message is None or message.error is not None:
        return f"the pipeline has not reached its end: {message and message.error}"
    if any(ending.partition(", ")[2].startswith("odd") for ending in endings):
        return "an element raised what is not documented"
    is_accounted = sent["files"] <= endings["files"] + lost
    return "" if is_accounted else f"{sent['files']} sent, {endings['files']} answered, {lost} lost"


def main() -> None:
    """Prints the figures; exit code 1 if the main process has failed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--mutants", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        install(Path(folder))
        fault = run(arguments.mutants, arguments.seed)
    print(fault or "the main process has reached the end")
    sys.exit(bool(fault))


if __name__ == "__main__":
    main()
