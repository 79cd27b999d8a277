"""What finding movers costs: `stitch` and `framediff` per frame, against MOG2 on the same grey frames.

Flights over an aerial picture with 6 cars in view. Wall and processor time in ms per frame, the median over
the frames of a run and then over five runs; as many threads as OpenCV takes by itself. "One after the other"
is `stitch ! framediff`: how long a frame takes. "With a queue between" is `stitch ! queue ! framediff`, each
in a thread of its own: how often a frame comes out, the mean over the frames of a run. Then the memory of a
long flight: what the process holds after 300 frames and after 3000.

    STREAMKIT_DATA=... python benchmarks/differencer_cost.py [--memory]
"""

import queue
import resource
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from aerial_flights import PictureArray, ground_picture, wandering

from streamkit import Frame, Registration, raw_video_caps
from streamkit.testing import Harness

SHAPES = ((720, 1280), (1080, 1920))
FRAMES, WARM_UP, RUNS, SEED = 60, 20, 5, 301
FLIGHT_FRAMES = (300, 3000)
STEP_PX = 4
QUEUED = 4
PATIENCE_S = 60.0


def times(step: Callable[[PictureArray, int], object], frames: list[PictureArray]) -> np.ndarray:
    """Median wall and processor time per frame, ms, float64[2]."""
    spent = []
    for number, picture in enumerate(frames):
        wall, processor = time.perf_counter(), time.process_time()
        step(picture, number)
        spent.append([time.perf_counter() - wall, time.process_time() - processor])
    return 1e3 * np.median(spent[WARM_UP:], axis=0)


class Chain:
    """stitch and framediff one after the other."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self._caps = raw_video_caps("GRAY8", shape[1], shape[0])
        self.stitch, self.framediff = Harness("stitch"), Harness("framediff", working_scale=2)
        # Without its pad the mosaic is not painted.
        self.stitch.element.stop()
        self.stitch.element.release_pad(self.stitch.element.pads["mosaic"])
        self.stitch.element.start()
        self.placed: list[Frame] = []

    def register(self, picture: PictureArray, number: int) -> None:
        """The stitcher's half."""
        frame = Frame(picture, self._caps, seq=number, pts=number * 40_000_000)
        self.placed = [passed for passed in self.stitch.push(frame) if passed.data is picture]

    def find(self, _: PictureArray, __: int) -> None:
        """The differencer's half, of the frame that was registered last."""
        for frame in self.placed:
            self.framediff.push(frame)

    def both(self, picture: PictureArray, number: int) -> None:
        """Registration, model and objects."""
        self.register(picture, number)
        self.find(picture, number)

    def piped(self, frames: list[PictureArray]) -> np.ndarray:
        """Mean wall and processor time per frame, ms, with a queue and a thread between the two."""
        between: queue.Queue[Frame | None] = queue.Queue(QUEUED)

        def consume() -> None:
            while (frame := between.get(timeout=PATIENCE_S)) is not None:
                self.framediff.push(frame)

        worker = threading.Thread(target=consume)
        worker.start()
        for number, picture in enumerate(frames):
            if number == WARM_UP:
                wall, processor = time.perf_counter(), time.process_time()
            self.register(picture, number)
            for frame in self.placed:
                between.put(frame, timeout=PATIENCE_S)
        between.put(None, timeout=PATIENCE_S)
        worker.join()
        spent = time.perf_counter() - wall, time.process_time() - processor
        return 1e3 * np.array(spent) / (len(frames) - WARM_UP)

    def close(self) -> None:
        """Stops both."""
        self.stitch.close()
        self.framediff.close()


def cost(shape: tuple[int, int]) -> None:
    """Prints a row per method."""
    grey = cv2.cvtColor(ground_picture(), cv2.COLOR_BGR2GRAY)
    flight = wandering(grey, FRAMES, shape, SEED)
    frames = [flight.picture(index) for index in range(FRAMES)]
    rows: dict[str, list[np.ndarray]] = {}
    for _ in range(RUNS):
        chain, halves, threads = Chain(shape), Chain(shape), Chain(shape)
        rows.setdefault("stitch + framediff, one after the other", []).append(times(chain.both, frames))
        spent = []
        for number, picture in enumerate(frames):
            halves.register(picture, number)
            wall, processor = time.perf_counter(), time.process_time()
            halves.find(picture, number)
            spent.append([time.perf_counter() - wall, time.process_time() - processor])
        rows.setdefault("of that, framediff", []).append(1e3 * np.median(spent[WARM_UP:], axis=0))
        rows.setdefault("stitch + framediff, with a queue between", []).append(threads.piped(frames))
        for either in (chain, halves, threads):
            either.close()
        subtractor = cv2.createBackgroundSubtractorMOG2(detectShadows=False)
        rows.setdefault("MOG2", []).append(times(lambda picture, _: subtractor.apply(picture), frames))  # noqa: B023
    for name, values in rows.items():
        wall, processor = np.median(values, axis=0)
        print(f"| {shape[1]}x{shape[0]} | {name} | {wall:.1f} | {processor:.1f} |", flush=True)


def held_mb() -> float:
    """Resident memory, MB."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 1e6


def memory() -> None:
    """Prints what a process with framediff holds along a straight flight that always comes to new ground."""
    height, width = SHAPES[0]
    grey = cv2.cvtColor(ground_picture(), cv2.COLOR_BGR2GRAY)[:height]
    # The ground repeats itself, the plane that frames are placed on does not.
    endless = np.hstack([grey, grey[:, :width]])
    caps = raw_video_caps("GRAY8", width, height)
    print("| frames | resident MB |\n|---|---|")
    with Harness("framediff", working_scale=2) as framediff:
        for number in range(max(FLIGHT_FRAMES)):
            left = STEP_PX * number
            view = np.ascontiguousarray(endless[:, left % grey.shape[1] :][:, :width])
            to_previous, to_reference = np.eye(3), np.eye(3)
            to_previous[0, 2], to_reference[0, 2] = STEP_PX if number else 0, left
            placed = Registration(to_previous=to_previous, to_reference=to_reference)
            framediff.push(Frame(view, caps, seq=number).attach(placed))
            if number + 1 in FLIGHT_FRAMES:
                print(f"| {number + 1} | {held_mb():.0f} |", flush=True)


if __name__ == "__main__":
    if "--memory" in sys.argv:
        memory()
    else:
        print("| size | method | wall ms | processor ms |\n|---|---|---|---|")
        for size in SHAPES:
            cost(size)
