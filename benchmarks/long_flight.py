"""A long flight that never ends over new ground: time per frame and memory as the hours pass.

    STREAMKIT_DATA=... python benchmarks/long_flight.py [FRAMES [WIDTH]]

Frames of 640x360 (or of another width), strips there and back beside each other over an aerial picture that
is mirrored without end, with the mosaic as it grows: it fills its memory, then its file, then is halved.
2 hours at 25 frames a second are 180 000. Peer: the first tenth of the same flight.
"""

import os
import statistics
import sys
import time
from pathlib import Path

import cv2
import numpy as np
from aerial_flights import Flight, FloatArray, PictureArray, camera, ground_picture

from streamkit_stitcher.mosaic.album import RecorderSettings
from streamkit_stitcher.mosaic.recorder import MosaicRecorder
from streamkit_stitcher.plane.settings import PlaneSettings
from streamkit_stitcher.plane.tracker import PlaneTracker

PARTS = 10
STEP_PX = 12.0
STRIP_FRAMES = 1800
BESIDE = 0.6


def resident_mb() -> float:
    """Memory of this process, MB."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def pose(index: int, shape: tuple[int, int], ground: tuple[int, int]) -> FloatArray:
    """float64[3, 3], pixels of frame `index` to the ground.

    The ground repeats after twice its size, so the place is taken modulo that.
    """
    turn_frames = round(BESIDE * shape[0] / STEP_PX)
    strip, step = divmod(index, STRIP_FRAMES + turn_frames)
    along = min(step, STRIP_FRAMES)
    x = STEP_PX * (along if strip % 2 == 0 else STRIP_FRAMES - along)
    y = STEP_PX * (strip * turn_frames + max(0, step - STRIP_FRAMES))
    place = np.array([x % (2 * ground[1]), y % (2 * ground[0])])
    random = np.random.default_rng((301, index))
    sway = 2 * np.pi * index / 400
    return camera(
        place + random.normal(0, 0.7, 2),
        0.03 * np.sin(2 * sway) + random.normal(0, 0.001),
        1 + 0.02 * np.sin(3 * sway),
        1e-5 * np.array([np.sin(5 * sway), np.cos(4 * sway)]),
        shape,
    )


def frame(ground: PictureArray, index: int, shape: tuple[int, int]) -> PictureArray:
    """Frame `index` of the flight, uint8[h, w]."""
    place = pose(index, shape, (ground.shape[0], ground.shape[1]))
    return Flight(ground, place[np.newaxis], shape, np.zeros((0, 4)), index).picture(0)


def main() -> None:
    """Prints one row per tenth of the flight."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 180_000
    width = int(sys.argv[2]) if len(sys.argv) > 2 else 640
    shape = width * 9 // 16, width
    whole = cv2.cvtColor(ground_picture(), cv2.COLOR_BGR2GRAY)
    # Halved: the small view of a flight that is rendered fast would show hardly a corner otherwise.
    ground = np.asarray(cv2.resize(whole, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    tracker = PlaneTracker(PlaneSettings())
    recorder = MosaicRecorder(RecorderSettings(None, 16_000_000, final=False))
    print(
        "| frames | ms per frame, median | ms per frame, mean | memory MB | placed | mosaic Mpx | its scale |"
    )
    print("|---|---|---|---|---|---|---|")
    for part in range(PARTS):
        times, placed = [], 0
        for index in range(part * count // PARTS, (part + 1) * count // PARTS):
            picture = frame(ground, index, shape)
            began = time.thread_time()
            placement = tracker.place(picture)
            recorder.add(placement, shape, lambda taken=picture: taken)
            times.append(time.thread_time() - began)
            placed += placement.anchored
        left, top, right, bottom = recorder.mosaic.canvas.box
        print(
            f"| {(part + 1) * count // PARTS} | {statistics.median(times) * 1e3:.1f} "
            f"| {statistics.fmean(times) * 1e3:.1f} | {resident_mb():.0f} | {placed / len(times):.1%} "
            f"| {(right - left) * (bottom - top) / 1e6:.1f} | {recorder.mosaic.scale} |",
            flush=True,
        )
    tracker.close()


if __name__ == "__main__":
    main()
