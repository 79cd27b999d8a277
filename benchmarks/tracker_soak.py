"""A day of births and deaths in short: time per frame and memory of the tracker must stay flat.

    python benchmarks/tracker_soak.py [--frames 50000]

Cars enter a small scene, are missed one time in ten among false alarms, and leave, as long as asked.
Each row is a tenth of them.
"""

import argparse
import gc
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from streamkit_tracker.observation import Observation
from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.tracker import MultiTargetTracker

HEIGHT, WIDTH = 120, 160
MAX_CARS = 4
ROWS = 10
PAGE_MB = 4096 / 2**20


def scene() -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Frames and boxes of detections, without end."""
    generator = np.random.default_rng(0)
    ground = generator.integers(90, 110, (HEIGHT, WIDTH)).astype(np.uint8)
    bodies = generator.integers(0, 255, (40, 8, 12)).astype(np.uint8)
    cars: list[tuple[float, float, float, int]] = []
    while True:
        if len(cars) < MAX_CARS and generator.random() < 0.15:
            speed, row = generator.uniform(1.5, 3.5), generator.uniform(10, HEIGHT - 10)
            rightwards = generator.random() < 0.5
            cars.append(
                (
                    0.0 if rightwards else WIDTH,
                    row,
                    speed if rightwards else -speed,
                    int(generator.integers(40)),
                )
            )
        cars = [(x + speed, y, speed, body) for x, y, speed, body in cars if -10 < x < WIDTH + 10]
        image, boxes = ground.copy(), []
        for x, y, _, body in cars:
            left, top = int(x) - 6, int(y) - 4
            if 0 <= left < WIDTH - 12:
                image[top : top + 8, left : left + 12] = bodies[body]
                if generator.random() > 0.1:
                    boxes.append([left - 0.5, top - 0.5, left + 11.5, top + 7.5])
        for _ in range(generator.poisson(0.3)):
            left, top = generator.uniform(0, WIDTH - 10), generator.uniform(0, HEIGHT - 10)
            boxes.append([left, top, left + 8, top + 8])
        yield image, np.array(boxes, np.float64).reshape(-1, 4)


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--frames", type=int, default=50_000)
    frames = parser.parse_args().frames
    tracker = MultiTargetTracker(TrackerSettings(coast=1.0))
    costs, last_id = [], 0
    print("| frames | ms of CPU, median | 99th percentile | resident MB | ids given |\n|---|---|---|---|---|")
    for index, (image, boxes) in zip(range(1, frames + 1), scene(), strict=False):
        began = time.process_time()
        centroids = (boxes[:, :2] + boxes[:, 2:]) / 2
        reports = tracker.step(image, Observation(0.04, centroids=centroids, boxes=boxes))
        costs.append((time.process_time() - began) * 1e3)
        last_id = max([last_id, *(report.id for report in reports)])
        if index % max(frames // ROWS, 1) == 0:
            gc.collect()
            resident = int(Path("/proc/self/statm").read_text().split()[1]) * PAGE_MB
            median, late = np.median(costs), np.percentile(costs, 99)
            print(f"| {index} | {median:.2f} | {late:.2f} | {resident:.1f} | {last_id} |", flush=True)
            costs = []


if __name__ == "__main__":
    main()
