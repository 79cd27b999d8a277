"""The finished mosaic against the true ground, beside cv2.Stitcher (SCANS) on the same frames.

    STREAMKIT_DATA=... python benchmarks/mosaic.py

Features of the mosaic are matched to the picture that the flight was rendered from; one homography is fitted,
and what is left over is the error of the mosaic's geometry. Time is that of everything from the frames on.
"""

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from aerial_flights import Flight, PictureArray, ground_picture, rows

from streamkit_stitcher.mosaic.recorder import MosaicRecorder, RecorderSettings
from streamkit_stitcher.mosaic.seams import SeamKind
from streamkit_stitcher.plane.settings import PlaneSettings
from streamkit_stitcher.plane.tracker import PlaneTracker

SHAPE = (720, 1280)


def stitched(frames: list[PictureArray], path: str) -> tuple[PictureArray | None, int]:
    """Ours: placed, adjusted and blended as `stitch` does it; the picture and the number of frames in it."""
    tracker = PlaneTracker(PlaneSettings())
    recorder = MosaicRecorder(RecorderSettings(path, 64_000_000, seam=SeamKind.VORONOI))
    for frame in frames:
        placement = tracker.place(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY))
        recorder.add(placement, SHAPE, lambda taken=frame: taken)
    plane = tracker.take_plane(current=True)
    rmse = plane.finish()
    written = recorder.finish(dict(plane.places), rmse)
    plane.close()
    return cv2.imread(path), 0 if written is None else written.pictures


def scans(frames: list[PictureArray], path: str) -> tuple[PictureArray | None, int]:
    """Peer: cv2.Stitcher in its mode for scans."""
    stitcher = cv2.Stitcher.create(cv2.Stitcher_SCANS)
    status, picture = stitcher.stitch(frames)
    if status != cv2.Stitcher_OK:
        return None, 0
    cv2.imwrite(path, picture)
    return picture, len(stitcher.component())


def residuals(mosaic: PictureArray, ground: PictureArray) -> tuple[float, float]:
    """Median and 90th percentile of what one homography between mosaic and ground leaves over, px."""
    detector = cv2.SIFT.create(6000)
    points, descriptors = [], []
    for picture in (mosaic, ground):
        found, described = detector.detectAndCompute(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), None)
        points.append(cv2.KeyPoint.convert(found))
        descriptors.append(described)
    pairs = cv2.BFMatcher().knnMatch(descriptors[0], descriptors[1], k=2)
    good = [first for first, second in pairs if first.distance < 0.7 * second.distance]
    source = points[0][[match.queryIdx for match in good]]
    target = points[1][[match.trainIdx for match in good]]
    matrix, inliers = cv2.findHomography(source, target, cv2.RANSAC, 40.0, maxIters=5000)
    kept = inliers.ravel() == 1
    matrix, _ = cv2.findHomography(source[kept], target[kept], cv2.LMEDS)
    apart = cv2.perspectiveTransform(source[kept][np.newaxis], matrix)[0] - target[kept]
    lengths = np.hypot(*apart.T)
    return float(np.median(lengths)), float(np.percentile(lengths, 90))


def main() -> None:
    """Prints one row per flight and method."""
    ground = ground_picture()
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
    print("| flight | method | frames placed | seconds | residual median px | p90 px |")
    print("|---|---|---|---|---|---|")
    for name, per_row, count, seed in (
        ("one strip of 8", 8, 8, 201),
        ("3 rows of 4", 4, 12, 202),
        ("3 rows of 4", 4, 12, 203),
    ):
        flight: Flight = rows(ground, per_row, count, SHAPE, seed)
        frames = [flight.picture(index) for index in range(count)]
        methods: tuple[tuple[str, Callable[[list[PictureArray], str], tuple[PictureArray | None, int]]], ...]
        methods = (("stitch", stitched), ("cv2.Stitcher SCANS", scans))
        for method, run in methods:
            began = time.perf_counter()
            picture, placed = run(frames, str(folder / f"{method[:4].strip()}-{seed}.png"))
            took = time.perf_counter() - began
            left = residuals(picture, ground) if picture is not None else (np.nan, np.nan)
            print(
                f"| {name}, seed {seed} | {method} | {placed} of {count} | {took:.2f} "
                f"| {left[0]:.2f} | {left[1]:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
