"""Photographs of a survey in one mosaic, and pairs of pictures with known homographies.

    STREAMKIT_DATA=... python benchmarks/photographs.py [MOSAIC.png]

1. The 18 drone photographs of brighton_beach, three strips, in the order they were taken: how many are
   placed, how many ties cross from strip to strip, the residual of the tie points and the misfit to the
   positions in the pictures' EXIF data.
2. The pairs of homography/: median error of the validation points of our fit and of OpenCV's robust
   estimators on the same matches. The scenes are not quite flat and there are eight points a pair, so that
   the best of seven estimators on one draw is luck in part: next to it stands the median over eleven draws of
   85 % of the matches, the same for all.
3. Drawn matches, of which few are right: mean error of the corners against least squares on the right ones,
   which no method knows, as the least that can be reached where all scatter alike; median of 20 draws.
"""

import os
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import corners, project
from streamkit_stitcher.flight_plan.plan import GeodeticPoint
from streamkit_stitcher.mosaic.mosaic_frames import RecorderSettings
from streamkit_stitcher.mosaic.recorder import MosaicRecorder
from streamkit_stitcher.plane.settings import PlaneSettings, ReferenceChoice
from streamkit_stitcher.plane.tracker import PlaneTracker
from streamkit_stitcher.registration.motion_models import MotionModel, least_squares
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
DRAWS = 11
KEPT = 0.85
SIDES = (1200.0, 900.0)


def position(path: Path) -> GeodeticPoint | None:
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
    return GeodeticPoint(north, east)


def survey(location: Path) -> None:
    """Prints table 1."""
    paths = sorted((DATA / "mosaic" / "brighton_beach").glob("*.JPG"))
    tracker = PlaneTracker(PlaneSettings(reference=ReferenceChoice.CENTER))
    recorder = MosaicRecorder(RecorderSettings(str(location)))
    began = time.perf_counter()
    states = []
    for path in paths:
        picture = np.asarray(cv2.imread(str(path)), dtype=np.uint8)
        placement = tracker.track(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY))
        states.append(placement.status.value)
        recorder.add(placement, picture.shape[:2], lambda taken=picture: taken, position(path))
    plane = tracker.take_plane(current=True)
    rmse = plane.finish()
    ties = {(host, own) for own in plane.homographies for host in plane.tied_to(own)}
    written = recorder.finish_planes(plane.planes, rmse)
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


def fitted(source: FloatArray, target: FloatArray) -> dict[str, FloatArray | None]:
    """Our homography and OpenCV's of the same matches."""
    fit = fit_wide_baseline(source, target, THRESHOLD)
    found: dict[str, FloatArray | None] = {"ours": None if fit is None else fit.matrix}
    for kind, method in ESTIMATORS.items():
        found[kind], _ = cv2.findHomography(
            source, target, method, THRESHOLD, maxIters=5000, confidence=0.999
        )
    return found


def pairs() -> None:
    """Prints table 2."""
    print(f"\n| pair | matches | drawn | ours px | best of OpenCV px | which | {' | '.join(ESTIMATORS)} |")
    print("|---|---|---|---|---|---|" + "---|" * len(ESTIMATORS))
    for model in sorted((DATA / "homography").glob("*_model.txt")):
        name = model.name.removesuffix("_model.txt")
        first, second = (next(model.parent.glob(f"{name}{side}.*")) for side in "AB")
        validation = np.loadtxt(model.parent / f"{name}_pts.txt")
        validation = validation[validation[:, 6] > 0] if (validation[:, 6] > 0).any() else validation
        source, target = matches(first, second)
        random = np.random.default_rng(1)
        draws = [np.sort(random.permutation(len(source))[: int(KEPT * len(source))]) for _ in range(DRAWS)]
        for drawn, chosen in (("all", [np.arange(len(source))]), (f"{DRAWS} times {KEPT:.0%}", draws)):
            fits = [fitted(source[kept], target[kept]) for kept in chosen]
            errors = {
                kind: float(np.median([error(fit[kind], validation) for fit in fits])) for kind in fits[0]
            }
            ours = errors.pop("ours")
            best = min(errors, key=lambda kind, errors=errors: errors[kind])
            print(
                f"| {name} | {len(source)} | {drawn} | {ours:.2f} | {errors[best]:.2f} | {best} "
                f"| {' | '.join(f'{value:.2f}' for value in errors.values())} |",
                flush=True,
            )


def drawn_matches(
    seed: int, count: int, share: float, deviation: float, unequal: bool
) -> tuple[FloatArray, FloatArray, FloatArray, npt.NDArray[np.bool_]]:
    """A homography, matches, and which are right; a third of the others lie near their place."""
    random = np.random.default_rng(seed)
    angle, scale = random.normal(0, 0.3), np.exp(random.normal(0, 0.2))
    cos, sin = scale * np.cos(angle), scale * np.sin(angle)
    (x, y), lean = random.normal(0, 150, 2), random.normal(0, 1e-4, 2)
    true = np.array([[cos, -sin, x], [sin, cos, y], [*lean, 1]])
    source = random.uniform((0, 0), SIDES, (count, 2))
    scatter = deviation * (np.exp(random.normal(0, 0.5, count)) if unequal else np.ones(count))
    target = project(true, source) + random.normal(0, 1, (count, 2)) * scatter[:, np.newaxis]
    right = random.random(count) < share
    near = ~right & (random.random(count) < 0.3)
    anywhere = random.uniform(target.min(axis=0), target.max(axis=0), (count, 2))
    target[~right] = anywhere[~right]
    target[near] = project(true, source[near]) + random.normal(0, 20, (int(near.sum()), 2))
    return true, source, target, right


def drawn() -> None:
    """Prints table 3."""
    print(f"\n| matches | right | deviation px | known to be right | ours | {' | '.join(ESTIMATORS)} |")
    print("|---|---|---|---|---|" + "---|" * len(ESTIMATORS))
    outline = corners((int(SIDES[1]), int(SIDES[0])))
    for count, share, deviation, unequal in (
        (400, 0.6, 0.5, False),
        (400, 0.35, 0.5, False),
        (400, 0.35, 1.2, True),
        (150, 0.3, 1.0, True),
        (1000, 0.2, 0.8, False),
    ):
        errors: dict[str, list[float]] = {}
        for seed in range(20):
            true, source, target, right = drawn_matches(seed, count, share, deviation, unequal)
            known = least_squares(MotionModel.HOMOGRAPHY, source[right], target[right])
            for kind, matrix in {"known": known, **fitted(source, target)}.items():
                apart = np.full((4, 2), np.inf)
                if matrix is not None:
                    apart = project(np.asarray(matrix, dtype=np.float64), outline) - project(true, outline)
                errors.setdefault(kind, []).append(float(np.hypot(*apart.T).mean()))
        print(
            f"| {count} | {share:.0%} | {deviation}{', unequal' if unequal else ''} "
            f"| {' | '.join(f'{np.median(values):.2f}' for values in errors.values())} |",
            flush=True,
        )


def main() -> None:
    """Prints the tables."""
    folder = Path(tempfile.mkdtemp())
    survey(Path(sys.argv[1]) if len(sys.argv) > 1 else folder / "mosaic.png")
    pairs()
    drawn()


if __name__ == "__main__":
    main()
