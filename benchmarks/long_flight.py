"""A long flight: time per frame and memory as the hours pass.

    STREAMKIT_DATA=... python benchmarks/long_flight.py [FRAMES [WIDTH]]

Frames of 640x360 (or of another width) from a path that wanders over an aerial picture, with the mosaic as it
grows; 2 hours at 25 frames a second are 180 000. Peer: the first tenth of the same flight.
"""

import os
import statistics
import sys
import time
from pathlib import Path

import cv2
from aerial_flights import ground_picture, wandering

from streamkit_stitcher.mosaic.recorder import MosaicRecorder, RecorderSettings
from streamkit_stitcher.plane.settings import PlaneSettings
from streamkit_stitcher.plane.tracker import PlaneTracker

PATH = 400
PARTS = 10


def resident_mb() -> float:
    """Memory of this process, MB."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def main() -> None:
    """Prints one row per tenth of the flight."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 180_000
    width = int(sys.argv[2]) if len(sys.argv) > 2 else 640
    shape = width * 9 // 16, width
    flight = wandering(cv2.cvtColor(ground_picture(), cv2.COLOR_BGR2GRAY), PATH, shape, 301)
    pictures = [flight.picture(index) for index in range(PATH)]
    tracker = PlaneTracker(PlaneSettings())
    recorder = MosaicRecorder(RecorderSettings(None, 16_000_000, final=False))
    print("| frames | ms per frame, median | ms per frame, mean | memory MB | placed |")
    print("|---|---|---|---|---|")
    for part in range(PARTS):
        times, placed = [], 0
        for index in range(part * count // PARTS, (part + 1) * count // PARTS):
            # There and back again, so that the path goes on without a jump.
            place = index % (2 * PATH - 2)
            picture = pictures[place if place < PATH else 2 * PATH - 2 - place]
            began = time.thread_time()
            placement = tracker.place(picture)
            recorder.add(placement, shape, lambda taken=picture: taken)
            times.append(time.thread_time() - began)
            placed += placement.anchored
        print(
            f"| {(part + 1) * count // PARTS} | {statistics.median(times) * 1e3:.1f} "
            f"| {statistics.fmean(times) * 1e3:.1f} | {resident_mb():.0f} | {placed / len(times):.1%} |",
            flush=True,
        )
    tracker.close()


if __name__ == "__main__":
    main()
