"""Photographs of a survey in one mosaic, and pairs of pictures with known homographies.

    STREAMKIT_DATA=... python benchmarks/photographs.py [MOSAIC.png]

1. The 18 drone photographs of brighton_beach, three strips, in the order they were taken: how many are
   placed, how many ties cross from strip to strip, the residual of the tie points and the misfit to the
   positions in the pictures' EXIF data.
2. The pairs of homography/: median error of the validation points of our fit and of OpenCV's robust
   estimators on the same matches.
"""

import os
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from streamkit_stitcher.mosaic.album import RecorderSettings
from streamkit_stitcher.mosaic.georeference import PositionFix
from streamkit_stitcher.mosaic.recorder import MosaicRecorder
from streamkit_stitcher.plane.settings import PlaneSettings
from streamkit_stitcher.plane.tracker import PlaneTracker
from streamkit_stitcher.registration.wide_baseline import fit_wide_baseline

FloatArray = npt.NDArray[np.float64]
DATA = Path(os.environ.get("STREAMKIT_DATA", "/nonexistent")) / "data"
ESTIMATORS = {
    name: getattr(cv2, name)
    for name in (
        "RANSAC",
        "LMEDS",
        "USAC_FAST",
        "USAC_ACCURATE",
        "USAC_PROSAC",
        "USAC_MAGSAC",
        "USAC_DEFAULT",
    )
}
THRESHOLD = 2.0


def position(path: Path) -> PositionFix | None:
    """Latitude and longitude of a photograph's EXIF data."""
    try:
        from PIL import Image
    except ImportError:
        return None
    gps = Image.open(path).getexif().get_ifd(0x8825)
    if not gps:
        return None
    north, east = (
        sum(float(part) / 60**power for power, part in enumerate(gps[tag]))
        * (-1 if gps[tag - 1] in "SW" else 1)
        for tag in (2, 4)
    )
    return PositionFix(north, east)


def survey(location: Path) -> None:
    """Prints table 1."""
    paths = sorted((DATA / "mosaic" / "brighton_beach").glob("*.JPG"))
    tracker = PlaneTracker(PlaneSettings())
    recorder = MosaicRecorder(RecorderSettings(str(location), 64_000_000))
    began = time.perf_counter()
    states = []
    for path in paths:
        picture = np.asarray(cv2.imread(str(path)), dtype=np.uint8)
        placement = tracker.place(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY))
        states.append(placement.status.value)
        recorder.add(placement, picture.shape[:2], lambda taken=picture: taken, position(path))
    plane = tracker.take_plane(current=True)
    rmse = plane.finish()
    ties = {(host, own) for own in plane.places for host in plane.tied_to(own)}
    written = recorder.finish(dict(plane.places), rmse)
    plane.close()
    # Strips of 6: ties between pictures of different strips close them.
    across = sum(host // 6 != own // 6 and own - host > 1 for host, own in ties)
    print("| photographs | placed | ties across strips | tie rms px | misfit to GPS m | mosaic | seconds |")
    print("|---|---|---|---|---|---|---|")
    misfit = "no positions" if written.position_misfit_m is None else f"{written.position_misfit_m:.2f}"
    print(
        f"| {len(paths)} | {written.pictures} ({', '.join(sorted(set(states)))}) "
        f"| {across} of {len(ties)} ties | {written.rmse_px:.2f} | {misfit} "
        f"| {written.width} x {written.height} | {time.perf_counter() - began:.1f} |"
    )


def matches(first: Path, second: Path) -> tuple[FloatArray, FloatArray]:
    """Matched SIFT features, float64[n, 2] each, best first."""
    detector = cv2.SIFT.create(8000)
    points, descriptors = [], []
    for path in (first, second):
        found, described = detector.detectAndCompute(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), None)
        points.append(np.asarray(cv2.KeyPoint.convert(found), dtype=np.float64))
        descriptors.append(described)
    pairs = cv2.BFMatcher().knnMatch(descriptors[0], descriptors[1], k=2)
    good = sorted(
        (one for one, two in pairs if one.distance < 0.85 * two.distance), key=lambda match: match.distance
    )
    return points[0][[one.queryIdx for one in good]], points[1][[one.trainIdx for one in good]]


def error(matrix: FloatArray | None, validation: FloatArray) -> float:
    """Median distance of the mapped validation points, px of the second picture."""
    if matrix is None:
        return float("inf")
    mapped = cv2.perspectiveTransform(validation[np.newaxis, :, :2], np.asarray(matrix, dtype=np.float64))[0]
    return float(np.median(np.hypot(*(mapped - validation[:, 3:5]).T)))


def pairs() -> None:
    """Prints table 2."""
    print(f"\n| pair | matches | ours px | best of OpenCV px | which | {' | '.join(ESTIMATORS)} |")
    print("|---|---|---|---|---|" + "---|" * len(ESTIMATORS))
    for model in sorted((DATA / "homography").glob("*_model.txt")):
        name = model.name.removesuffix("_model.txt")
        first, second = (next(model.parent.glob(f"{name}{side}.*")) for side in "AB")
        validation = np.loadtxt(model.parent / f"{name}_pts.txt")
        validation = validation[validation[:, 6] > 0] if (validation[:, 6] > 0).any() else validation
        source, target = matches(first, second)
        fit = fit_wide_baseline(source, target, THRESHOLD)
        ours = error(None if fit is None else fit.matrix, validation)
        peers = {}
        for kind, method in ESTIMATORS.items():
            matrix, _ = cv2.findHomography(source, target, method, THRESHOLD, maxIters=5000, confidence=0.999)
            peers[kind] = error(matrix, validation)
        best = min(peers, key=lambda kind: peers[kind])
        print(
            f"| {name} | {len(source)} | {ours:.2f} | {peers[best]:.2f} | {best} "
            f"| {' | '.join(f'{peers[kind]:.2f}' for kind in ESTIMATORS)} |",
            flush=True,
        )


def main() -> None:
    """Prints both tables."""
    folder = Path(tempfile.mkdtemp())
    survey(Path(sys.argv[1]) if len(sys.argv) > 1 else folder / "mosaic.png")
    pairs()


if __name__ == "__main__":
    main()
