"""Frame-to-frame registration: corner error against exact truth and time, against cv2's corners and features.

    STREAMKIT_DATA=... python benchmarks/registration.py

Flights over an aerial picture with 6 cars in view, 3 grey levels of noise; the error is that of the worst of
the four corners of the picture, at full size, from one picture to the next. One thread.
"""

import time
from collections.abc import Callable, Generator

import cv2
import numpy as np
from aerial_flights import Flight, FloatArray, PictureArray, ground_picture, wandering

from streamkit_stitcher.plane.registrar import FrameRegistrar
from streamkit_stitcher.plane.settings import PlaneSettings, ReferenceChoice

SEEDS = (101, 102, 103, 104, 105)
FRAMES = 50


def registrar() -> Generator[FloatArray, PictureArray, None]:
    """Ours, as `stitch` runs it."""
    plane = FrameRegistrar(PlaneSettings(reference=ReferenceChoice.CENTER))
    picture = yield np.eye(3)
    try:
        while True:
            picture = yield plane.register(picture).to_previous
    finally:
        plane.close()


def followed_corners() -> Generator[FloatArray, PictureArray, None]:
    """Peer: good corners, Lucas-Kanade and RANSAC of OpenCV at full size, from picture to picture."""
    before: PictureArray | None = None
    picture = yield np.eye(3)
    while True:
        matrix = np.eye(3)
        if before is not None:
            old = cv2.goodFeaturesToTrack(before, 220, 0.01, 20)
            new, found, _ = cv2.calcOpticalFlowPyrLK(before, picture, old, None)
            kept = found.ravel() == 1
            fitted, _ = cv2.findHomography(new[kept], old[kept], cv2.RANSAC, 1.0)
            matrix = fitted if fitted is not None else matrix
        before = picture
        picture = yield matrix


def matched_features() -> Generator[FloatArray, PictureArray, None]:
    """Peer: ORB features, cross-checked, with USAC_ACCURATE, at half size."""
    detector, matcher = cv2.ORB.create(1200), cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True)
    before = None
    halve = np.array([[0.5, 0, -0.25], [0, 0.5, -0.25], [0, 0, 1]])
    picture = yield np.eye(3)
    while True:
        small = cv2.resize(picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        now = detector.detectAndCompute(small, None)
        matrix = np.eye(3)
        if before is not None:
            matches = matcher.match(now[1], before[1])
            new = np.array([now[0][match.queryIdx].pt for match in matches])
            old = np.array([before[0][match.trainIdx].pt for match in matches])
            fitted, _ = cv2.findHomography(new, old, cv2.USAC_ACCURATE, 1.5)
            matrix = np.linalg.inv(halve) @ fitted @ halve if fitted is not None else matrix
        before = now
        picture = yield matrix


def measure(
    make: Callable[[], Generator[FloatArray, PictureArray, None]], flight: Flight, frames: list[PictureArray]
) -> FloatArray:
    """Milliseconds and corner error of each picture but the first, float64[n, 2]."""
    method = make()
    next(method)
    method.send(frames[0])
    rows = []
    for index, frame in enumerate(frames[1:], 1):
        began = time.thread_time()
        matrix = method.send(frame)
        rows.append(((time.thread_time() - began) * 1e3, flight.corner_error(matrix, index, index - 1)))
    return np.array(rows)


def main() -> None:
    """Prints one row per size and method."""
    cv2.setNumThreads(1)
    ground = cv2.cvtColor(ground_picture(), cv2.COLOR_BGR2GRAY)
    print("| size | method | ms median | ms p95 | error median px | p90 px | max px |")
    print("|---|---|---|---|---|---|---|")
    for shape in ((720, 1280), (1080, 1920)):
        flights = [wandering(ground, FRAMES, shape, seed) for seed in SEEDS]
        pictures = [[flight.picture(index) for index in range(FRAMES)] for flight in flights]
        for name, make in (
            ("stitch", registrar),
            ("GFTT + LK + RANSAC", followed_corners),
            ("ORB + USAC_ACCURATE", matched_features),
        ):
            found = np.concatenate([measure(make, *pair) for pair in zip(flights, pictures, strict=True)])
            cost, error = found.T
            print(
                f"| {shape[1]}x{shape[0]} | {name} | {np.median(cost):.1f} | {np.percentile(cost, 95):.1f} "
                f"| {np.median(error):.3f} | {np.percentile(error, 90):.3f} | {error.max():.3f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
