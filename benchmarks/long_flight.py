"""A long flight that never ends over new ground: time per frame and memory as the hours pass.

    STREAMKIT_DATA=... python benchmarks/long_flight.py [FRAMES [WIDTH [STEP]]]

Frames of 640x360 (or of another WIDTH), parallel strips there and back over an aerial picture that
is mirrored without end, with the mosaic as it grows: it fills its memory, then its file, then is halved. From
one frame to the next the ground goes by STEP px, 48 by default: at a frame a second that is a drone at
10 m/s with 180 m of ground in view, and 7200 frames are two hours. At 25 frames a second the same flight is
180 000 frames with a STEP of 1.92. `step` is how far the worst corner of a frame lies from its true place
relative to the frame before. Peer: the first 500 frames of the same flight.
"""

import os
import statistics
import sys
import time
from pathlib import Path

import cv2
import numpy as np
from aerial_flights import Flight, FloatArray, PictureArray, camera, ground_picture

from streamkit_stitcher.mosaic.recorder import MosaicRecorder
from streamkit_stitcher.mosaic.settings import RecorderSettings
from streamkit_stitcher.plane.frame_registration import depth_ratio
from streamkit_stitcher.plane.registrar import FrameRegistrar
from streamkit_stitcher.plane.settings import PlaneSettings, ReferenceChoice

FRAMES_PER_ROW = 500
STRIP_PX = 21_600
BESIDE = 0.6


def resident_mb() -> float:
    """Memory of this process, MB."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def place(index: int, shape: tuple[int, int], step_px: float) -> FloatArray:
    """float64[2], the point that frame `index` looks at, px of the ground without end."""
    strip_frames, turn_frames = round(STRIP_PX / step_px), round(BESIDE * shape[0] / step_px)
    strip, step = divmod(index, strip_frames + turn_frames)
    along = min(step, strip_frames)
    x = step_px * (along if strip % 2 == 0 else strip_frames - along)
    y = step_px * (strip * turn_frames + max(0, step - strip_frames))
    return np.array([x, y])


def pose(index: int, shape: tuple[int, int], step_px: float, where: FloatArray) -> FloatArray:
    """float64[3, 3], pixels of frame `index` to the ground, looking at `where`."""
    random = np.random.default_rng((301, index))
    sway = 2 * np.pi * index * step_px / 4800
    return camera(
        where + random.normal(0, 0.7, 2),
        0.03 * np.sin(2 * sway) + random.normal(0, 0.001),
        1 + 0.02 * np.sin(3 * sway),
        1e-5 * np.array([np.sin(5 * sway), np.cos(4 * sway)]),
        shape,
    )


def frame(ground: PictureArray, index: int, shape: tuple[int, int], step_px: float) -> PictureArray:
    """Frame `index` of the flight, uint8[h, w]: the ground repeats after twice its size."""
    where = place(index, shape, step_px) % (2 * ground.shape[1], 2 * ground.shape[0])
    there = pose(index, shape, step_px, where)
    return Flight(ground, there[np.newaxis], shape, np.zeros((0, 4)), index).picture(0)


def step_error(to_previous: FloatArray, index: int, shape: tuple[int, int], step_px: float) -> float:
    """How far the worst corner of a frame lies from its true place in the frame before, px."""
    both = [pose(number, shape, step_px, place(number, shape, step_px)) for number in (index - 1, index)]
    flight = Flight(np.zeros((1, 1), dtype=np.uint8), np.array(both), shape, np.zeros((0, 4)), 0)
    return flight.corner_error(to_previous, 1, 0)


def main() -> None:
    """Prints one row per 500 frames."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 7200
    width = int(sys.argv[2]) if len(sys.argv) > 2 else 640
    step_px = float(sys.argv[3]) if len(sys.argv) > 3 else 48.0
    cv2.setNumThreads(1)
    shape = width * 9 // 16, width
    whole = cv2.cvtColor(ground_picture(), cv2.COLOR_BGR2GRAY)
    # Halved: the small view of a flight that is rendered fast would show hardly a corner otherwise.
    ground = np.asarray(cv2.resize(whole, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    registrar = FrameRegistrar(PlaneSettings(reference=ReferenceChoice.FIRST))
    recorder = MosaicRecorder(RecorderSettings(None, max_canvas_mpx=16, final=False))
    print(
        "| frames | ms per frame, median | mean | all threads | memory MB | placed | step px, median "
        "| worst | plane | drawn out by | refused | mosaic Mpx | its scale |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|---|---|")
    for first in range(0, count, FRAMES_PER_ROW):
        times, steps, placed, tilt, processor = [], [0.0], 0, 1.0, 0.0
        for index in range(first, min(count, first + FRAMES_PER_ROW)):
            picture = frame(ground, index, shape, step_px)
            began, spent = time.thread_time(), time.process_time()
            placement = registrar.register(picture)
            recorder.add(placement, shape, lambda taken=picture: taken)
            times.append(time.thread_time() - began)
            processor += time.process_time() - spent
            placed += placement.measured
            tilt = max(tilt, depth_ratio(placement.to_reference, shape))
            if index:
                steps.append(step_error(placement.to_previous, index, shape, step_px))
        left, top, right, bottom = recorder.frames.mosaic.box
        print(
            f"| {first + len(times)} | {statistics.median(times) * 1e3:.1f} "
            f"| {statistics.fmean(times) * 1e3:.1f} | {processor / len(times) * 1e3:.1f} "
            f"| {resident_mb():.0f} | {placed / len(times):.1%} "
            f"| {statistics.median(steps):.2f} | {max(steps):.1f} "
            f"| {placement.reference} | {tilt:.2f} | {recorder.refused} "
            f"| {(right - left) * (bottom - top) / 1e6:.1f} | {recorder.frames.mosaic.scale} |",
            flush=True,
        )
    registrar.close()


if __name__ == "__main__":
    main()
