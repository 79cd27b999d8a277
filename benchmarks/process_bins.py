"""What it costs a grey 1080p frame to cross into another process, with a queue and a plain copy beside it.

    python benchmarks/process_bins.py [--frames 400]

A frame goes into a bin with a process and comes back, one at a time: half of that, less what the same
pipeline takes without the bin, is one crossing, from the push to the receiving element's call. The same way
through two queues is the price of two threads. The copy is `numpy.copyto` of the same array.

Goal on a quiet machine: at most 150 us a crossing, without a copy on the reading side.
"""

from __future__ import annotations

import argparse
import statistics
import time

import numpy as np

from streamkit import Frame, Pipeline
from streamkit.flow.video import raw_video_caps

CAPS = raw_video_caps("GRAY8", 1920, 1080)
WAYS = {
    "nothing between": "identity",
    "two queues": "queue ! identity ! queue",
    "a bin in a process": "( process=true identity )",
}
WARM_UP = 50


def round_trip_us(way: str, frames: int) -> float:
    """Median time from pushing a frame to pulling it, us."""
    data = np.random.default_rng(1).integers(0, 255, (1080, 1920), np.uint8)
    spent = []
    with Pipeline.parse(f"appsrc name=in ! {way} ! appsink name=out") as pipeline:
        pipeline.play()
        for number in range(frames + WARM_UP):
            before = time.perf_counter_ns()
            pipeline["in"].push(Frame(data, CAPS, pts=number))
            pipeline["out"].pull()
            spent.append((time.perf_counter_ns() - before) / 1e3)
            time.sleep(0.001)  # else the threads never sleep, as they do between the frames of a camera
    return statistics.median(spent[WARM_UP:])


def copy_us(frames: int) -> float:
    """Median time to copy the array, us."""
    data = np.zeros((1080, 1920), np.uint8)
    target = np.empty_like(data)
    spent = []
    for _ in range(frames):
        before = time.perf_counter_ns()
        np.copyto(target, data)
        spent.append((time.perf_counter_ns() - before) / 1e3)
        time.sleep(0.001)  # as above: the frames of a camera are not in the cache
    return statistics.median(spent)


def main() -> None:
    """Prints a table: medians of five rounds, each way in turn."""
    arguments = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    arguments.add_argument("--frames", type=int, default=400, help="in each round")
    frames = arguments.parse_args().frames
    rounds = [{name: round_trip_us(way, frames) for name, way in WAYS.items()} for _ in range(5)]
    found = {name: statistics.median(row[name] for row in rounds) for name in WAYS}
    for name, spent_us in found.items():
        print(f"{name:<22} {spent_us:8.0f} us there and back")
    alone = found["nothing between"]
    for name in ("two queues", "a bin in a process"):
        print(f"{'one crossing, ' + name:<34} {(found[name] - alone) / 2:8.0f} us")
    print(f"{'one copy':<34} {copy_us(frames):8.0f} us")


if __name__ == "__main__":
    main()
