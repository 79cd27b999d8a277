"""Planes of a video that a cut has separated: which are joined, and whether frames are then right on them.

    STREAMKIT_DATA=... python benchmarks/planes_that_meet.py [--seeds 0 20]

Each flight shows one place, another scene for twelve frames, and the place again, mostly at another tilt:
along the first strip with an overlap of 10 to 90 % of the height, across it, or aslant. At the end each frame
called ok or still is compared with earlier ones of its plane that it overlaps: `wrong` are off by more than
2 px at a point that both show. A frame of the other scene on the plane of the first is infinitely far off.
"""

import argparse

import cv2
import numpy as np
from aerial_flights import Flight, FloatArray, PictureArray, camera, ground_picture

from streamkit.geometry.homography import overlap, project
from streamkit_stitcher.plane.registrar import FrameRegistrar
from streamkit_stitcher.plane.settings import PlaneSettings, ReferenceChoice

SHAPE = (432, 768)
FIRST, OTHER, AGAIN = 55, 12, 100
# Depth of the frame's lower side less that of its middle, by the latter.
LEANS = (0.0, 0.1, -0.1, 0.22, -0.22)
OVERLAPS = (0.1, 0.2, 0.3, 0.45, 0.65, 0.9)
WAYS = ("across", "along", "aslant", "nearer")
LIMIT_PX = 2.0
LEAST_OVERLAP = 0.1
GRID = np.stack(np.meshgrid(np.linspace(0, SHAPE[1] - 1, 7), np.linspace(0, SHAPE[0] - 1, 7)), -1).reshape(
    -1, 2
)


def places(way: str, part: float, start: FloatArray, random: np.random.Generator) -> FloatArray:
    """Where the camera is when it sees the place again, float64[n, 2]; at first outside of the strip."""
    time, side, height = np.arange(AGAIN), random.choice([-1, 1]), SHAPE[0]
    (x, y), end = start, start[0] + 15 * FIRST
    if way == "across":
        return np.stack(
            [np.full(AGAIN, random.uniform(x + 100, end - 100)), y + side * (620 - 9 * time)], axis=1
        )
    if way == "along":
        return np.stack([end + 700 - 12.0 * time, np.full(AGAIN, y + side * height * (1 - part))], axis=1)
    if way == "aslant":
        return np.stack([end + 600 - 9.0 * time, y + side * (400 - 5.5 * time)], axis=1)
    away = np.maximum(height * (1 - part), height * 1.2 - 6 * time)
    return np.stack([x - 500 + 12.0 * time, y + side * away], axis=1)


def flight(ground: PictureArray, seed: int) -> tuple[Flight, str]:
    """A flight, and what it is."""
    random = np.random.default_rng(1000 + seed)
    way, part = WAYS[seed % len(WAYS)], OVERLAPS[seed // len(WAYS) % len(OVERLAPS)]
    leans, turn = random.choice(LEANS, 2, replace=False), random.uniform(-0.5, 0.5)
    start = np.array([900.0, ground.shape[0] / 2])
    first = start + np.arange(FIRST)[:, np.newaxis] * [15.0, 0.0]
    again = places(way, part, start, random)

    def seen(place: FloatArray, lean: float, angle: float) -> FloatArray:
        tilt = np.array([0.0, lean / (SHAPE[0] / 2)])
        scale = 1 + random.normal(0, 0.001)
        return camera(place + random.normal(0, 0.7, 2), angle + random.normal(0, 0.002), scale, tilt, SHAPE)

    there = [seen(place, leans[0], 0.0) for place in first]
    back = [seen(place, leans[1], turn) for place in again]
    matrices = np.array([*there, *there[:OTHER], *back])
    name = f"{seed}: {way}, {part:.0%}, {leans[0]:+.2f} {leans[1]:+.2f}"
    return Flight(ground, matrices, SHAPE, np.zeros((0, 4)), seed), name


def measure(shown: Flight) -> tuple[int, FloatArray]:
    """Number of planes at the end, and error of each frame called ok or still, float64[n] px."""
    mirrored = Flight(
        np.ascontiguousarray(shown.ground[:, ::-1]), shown.to_ground, SHAPE, shown.cars, shown.seed
    )
    registrar, called = FrameRegistrar(PlaneSettings(reference=ReferenceChoice.FIRST)), []
    for index in range(len(shown.to_ground)):
        is_other = FIRST <= index < FIRST + OTHER
        found = registrar.register((mirrored if is_other else shown).picture(index))
        if found.status.value in ("ok", "still"):
            called.append((index, is_other, found.key_index, found.to_key))
    keyframes = registrar.take_plane(current=True)
    registrar.close()
    assert keyframes is not None
    keyframes.close()
    plane_of = {key: plane for plane, own in keyframes.planes.items() for key in own}
    rows = [
        (index, (plane_of[key], is_other), keyframes.homographies[key] @ to_key)
        for index, is_other, key, to_key in called
    ]
    errors = [
        max((apart(shown, row, earlier) for earlier in rows[:number:3]), default=0.0)
        for number, row in enumerate(rows)
    ]
    return len(keyframes.planes), np.array(errors)


Row = tuple[int, tuple[int, bool], FloatArray]


def apart(shown: Flight, row: Row, earlier: Row) -> float:
    """Largest distance of a frame's points from their true places in an earlier one that shows them, px."""
    (index, (plane, is_other), to_plane), (first, (its_plane, was_other), its_matrix) = row, earlier
    if plane != its_plane:
        return 0.0
    if is_other != was_other:
        return float("inf")
    true = np.linalg.inv(shown.to_ground[first]) @ shown.to_ground[index]
    if overlap(true, SHAPE) < LEAST_OVERLAP:
        return 0.0
    expected = project(true, GRID)
    inside = ((expected >= 0) & (expected < SHAPE[::-1])).all(axis=1)
    shifts = project(np.linalg.inv(its_matrix) @ to_plane, GRID[inside]) - expected[inside]
    return float(np.hypot(*shifts.T).max(initial=0.0))


def main() -> None:
    """Prints one row per flight, and their sum."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, nargs=2, default=(0, 20), help="first, and one past the last")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    ground = cv2.cvtColor(ground_picture(), cv2.COLOR_BGR2GRAY)
    print("| flight | planes | called | wrong | worst px |\n|---|---|---|---|---|")
    total = np.zeros(3, dtype=np.int64)
    for seed in range(*options.seeds):
        shown, name = flight(np.asarray(ground, dtype=np.uint8), seed)
        planes, errors = measure(shown)
        wrong = int((errors > LIMIT_PX).sum())
        total += planes, len(errors), wrong
        print(f"| {name} | {planes} | {len(errors)} | {wrong} | {errors.max():.2f} |", flush=True)
    print(f"| all | {total[0]} | {total[1]} | {total[2]} | |")


if __name__ == "__main__":
    main()
