"""The finished mosaic against the true ground, compared with cv2.Stitcher (SCANS) on the same frames.

    STREAMKIT_DATA=... python benchmarks/mosaic.py [--folder FOLDER] [--repeats 5] [--seeds 201 202 ...]

1. `features`: features of the mosaic are matched to the picture that the flight was rendered from, one
   homography is fitted, and the median and 90th percentile of the residuals are reported. Features are not
   exact: the row `exact places` shows what is left of the same frames joined at their true places, the least
   that this measure can tell.
2. `refined`: ground and mosaic are aligned in a window of 31 px about each corner of the ground, beginning at
   that homography, and another is fitted: the same quantity with less than half the noise, and wherever there
   are corners, not only where features found a partner.
3. `bent`: of those shifts the median of each block of 128 px is taken, as a misplaced picture shifts whole
   blocks. Again the median and the 90th percentile of those.

Time is that of everything from the frames to the written file: the median of the runs, on the
clock and in CPU time of all threads.
"""

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
from aerial_flights import Flight, FloatArray, PictureArray, ground_picture, rows

from streamkit.geometry.homography import inverse, normalised, project
from streamkit_stitcher.mosaic.composition import PlacedFrame, compose
from streamkit_stitcher.mosaic.recorder import MosaicRecorder
from streamkit_stitcher.mosaic.seams import SeamKind
from streamkit_stitcher.mosaic.settings import RecorderSettings
from streamkit_stitcher.plane.registrar import FrameRegistrar
from streamkit_stitcher.plane.settings import PlaneSettings, ReferenceChoice

SHAPE = (720, 1280)
BLOCK = 128
MIN_IN_BLOCK = 6
MEMORY_PX = 64_000_000
# Of seed n the one of number n % 4: names, frames of a row, frames.
KINDS = (("one strip of 6", 6, 6), ("one strip of 8", 8, 8), ("3 rows of 4", 4, 12), ("3 rows of 4", 4, 12))
Method = Callable[[Sequence[PictureArray], str], int]


def stitched(frames: Sequence[PictureArray], path: str) -> int:
    """Ours: placed, adjusted, blended and written as `stitch` does it; the number of frames in it."""
    registrar = FrameRegistrar(PlaneSettings(reference=ReferenceChoice.CENTER))
    recorder = MosaicRecorder(RecorderSettings(path, seam=SeamKind.GRAPHCUT))
    for frame in frames:
        placement = registrar.register(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY))
        recorder.add(placement, SHAPE, lambda taken=frame: taken)
    plane = registrar.take_plane(current=True)
    rmse = plane.finish()
    written = recorder.finish(plane.planes, rmse)
    plane.close()
    return 0 if written is None else written.pictures


def scans(frames: Sequence[PictureArray], path: str) -> int:
    """Peer: cv2.Stitcher in its mode for scans."""
    stitcher = cv2.Stitcher.create(cv2.Stitcher_SCANS)
    status, picture = stitcher.stitch(frames)
    if status != cv2.Stitcher_OK:
        return 0
    cv2.imwrite(path, picture)
    return len(stitcher.component())


def exact(flight: Flight, frames: Sequence[PictureArray], path: str) -> int:
    """The frames joined at their true places: nothing is measured."""
    to_first = inverse(flight.to_ground[0])
    placed = [
        PlacedFrame(number, SHAPE, normalised(to_first @ matrix))
        for number, matrix in enumerate(flight.to_ground)
    ]
    whole = compose(placed, lambda number: frames[number], SeamKind.GRAPHCUT, MEMORY_PX)
    cv2.imwrite(path, whole.image)
    return len(placed)


def matched(mosaic: PictureArray, ground: PictureArray) -> tuple[FloatArray, FloatArray]:
    """The homography from mosaic to ground, and what it leaves over of each match of features, px."""
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
    return np.asarray(matrix, dtype=np.float64), np.hypot(*apart.T)


def shifted(
    mosaic: PictureArray, ground: PictureArray, to_ground: FloatArray
) -> tuple[FloatArray, npt.NDArray[np.floating]]:
    """How far the mosaic lies from the ground, px, once one homography has taken what it can.

    Returns:
        The distance of each corner, float64[n], and that of each block, float64[m].
    """
    size = mosaic.shape[1], mosaic.shape[0]
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    truth = cv2.cvtColor(cv2.warpPerspective(ground, to_ground, size, flags=flags), cv2.COLOR_BGR2GRAY)
    shown = cv2.cvtColor(mosaic, cv2.COLOR_BGR2GRAY)
    covered = cv2.morphologyEx((shown > 0).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((9, 9), np.uint8))
    # Both black beyond the mosaic's outline, which the coarse windows see.
    truth[covered == 0] = 0
    inside = cv2.erode(covered, np.ones((41, 41), np.uint8))
    corners = cv2.goodFeaturesToTrack(truth, 6000, 0.005, 12, mask=inside)
    found, followed, _ = cv2.calcOpticalFlowPyrLK(
        truth,
        shown,
        corners,
        corners.copy(),
        winSize=(31, 31),
        maxLevel=3,
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 0.002),
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    kept = followed.ravel() == 1
    source, target = corners[kept, 0].astype(np.float64), found[kept, 0].astype(np.float64)
    matrix, _ = cv2.findHomography(source, target, cv2.LMEDS)
    shifts = target - project(matrix, source)
    cells = (source // BLOCK).astype(np.int64) @ [1, 1000]
    medians = [
        np.median(shifts[cells == cell], axis=0)
        for cell in np.unique(cells)
        if np.count_nonzero(cells == cell) >= MIN_IN_BLOCK
    ]
    return np.hypot(*shifts.T), np.hypot(*np.array(medians).T)


def measured(path: str, ground: PictureArray) -> list[float]:
    """Median and 90th percentile of each of the three residuals, px."""
    mosaic = cv2.imread(path)
    to_ground, left = matched(mosaic, ground)
    residuals = left, *shifted(mosaic, ground, to_ground)
    return [float(value) for own in residuals for value in (np.median(own), np.percentile(own, 90))]


def cells(values: Sequence[float]) -> str:
    """Numbers as cells of a table."""
    return " | ".join(f"{value:.2f}" for value in values)


def timed(method: Method, frames: Sequence[PictureArray], path: str, repeats: int) -> tuple[int, list[float]]:
    """Frames placed; clock and CPU seconds."""
    clock, processor, placed = [], [], 0
    for _ in range(repeats):
        began, spent = time.perf_counter(), time.process_time()
        placed = method(frames, path)
        clock.append(time.perf_counter() - began)
        processor.append(time.process_time() - spent)
    return placed, [statistics.median(clock), statistics.median(processor)]


def compared(ground: PictureArray, flight: Flight, title: str, folder: Path, repeats: int) -> list[float]:
    """Prints the rows of one flight; SCANS through ours: seconds, CPU seconds and the three medians."""
    count = len(flight.to_ground)
    frames = [flight.picture(index) for index in range(count)]
    path = str(folder / f"exact-{flight.seed}.png")
    exact(flight, frames, path)
    print(f"{title} exact places | {count} of {count} | | | {cells(measured(path, ground))} |", flush=True)
    found = []
    for method, run in (("stitch", stitched), ("cv2.Stitcher SCANS", scans)):
        path = str(folder / f"{method[:4].strip()}-{flight.seed}.png")
        placed, seconds = timed(run, frames, path, repeats)
        left = measured(path, ground) if placed else [float("nan")] * 6
        found.append([*seconds, *left[::2]])
        print(f"{title} {method} | {placed} of {count} | {cells([*seconds, *left])} |", flush=True)
    return (np.array(found[1]) / found[0]).tolist()


def main() -> None:
    """Prints one row per flight and method, then the ratios."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--folder", type=Path, help="for the mosaics; a temporary one otherwise")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--seeds", type=int, nargs="+", default=range(201, 209))
    options = parser.parse_args()
    ground = ground_picture()
    folder = options.folder or Path(tempfile.mkdtemp())
    print("| flight | method | placed | s | CPU s | features px | p90 | refined px | p90 | bent px | p90 |")
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    ratios = []
    for seed in options.seeds:
        name, per_row, count = KINDS[seed % len(KINDS)]
        flight = rows(ground, per_row, count, SHAPE, seed)
        ratios.append(compared(ground, flight, f"| {name}, seed {seed} |", folder, options.repeats))
    for name, value in (("median", np.nanmedian), ("least", np.nanmin)):
        clock, processor, *left = value(np.array(ratios), axis=0).tolist()
        between = " | | ".join(f"{ratio:.1f}" for ratio in left)
        print(f"| SCANS through ours | {name} | | {clock:.1f} | {processor:.1f} | {between} | |")


if __name__ == "__main__":
    main()
