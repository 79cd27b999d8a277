"""Photographs of a survey in one mosaic, and pairs of pictures with known homographies.

    STREAMKIT_DATA=... python benchmarks/photographs.py [--seeds 1 2 3] [--every 2] [--only-surveys]

1. Surveys in the order taken and shuffled: how many photographs are placed, how many ties cross from strip to
   strip, the residual of the tie points, and the root mean square distance to the positions in the pictures'
   Exif data after one similarity: of the middles of the pictures, and of the points below the cameras. Then
   cv2.Stitcher (SCANS) on the same files. With --colmap (pip install pycolmap) the same distance of COLMAP's
   cameras, which has points in space, a focal length and radial distortion of its own, and how far ours are
   from them: where both are far from the positions and near each other, the positions are wrong.
2. The pairs of homography/: median error of the validation points of our fit and of OpenCV's robust
   estimators on the same matches. The scenes are not quite flat and there are eight points a pair, so that
   the best of seven estimators on one draw is luck in part: next to it stands the median over eleven draws of
   85 % of the matches, the same for all.
3. Drawn matches, of which few are right: mean error of the corners against least squares on the right ones,
   which no method knows, as the least that can be reached where all scatter alike; median of 20 draws.
"""

import argparse
import os
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
from survey_peers import colmap_cameras, scans

from streamkit import Pose
from streamkit.geometry.homography import centre, corners, inverse, normalised, project
from streamkit_stitcher.bundle_adjustment.lens import Lens
from streamkit_stitcher.flight_plan.plan import GeodeticPoint
from streamkit_stitcher.ground_view import ground_view
from streamkit_stitcher.mosaic.frame_views import FrameView, Position, focal_length
from streamkit_stitcher.mosaic.georeference import local_metres
from streamkit_stitcher.mosaic.recorder import MosaicRecorder
from streamkit_stitcher.mosaic.settings import RecorderSettings
from streamkit_stitcher.plane.frame_registration import FrameRegistration
from streamkit_stitcher.plane.registrar import FrameRegistrar
from streamkit_stitcher.plane.settings import PlaneSettings, ReferenceChoice
from streamkit_stitcher.registration.motion_models import MotionModel, least_squares
from streamkit_stitcher.registration.wide_baseline import fit_wide_baseline
from streamkit_telemetry_formats.photograph import sample_of_photograph

FloatArray = npt.NDArray[np.float64]
Placed = tuple[FrameRegistration, tuple[int, int], Pose | None]
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


def view_of(path: Path, shape: tuple[int, int]) -> tuple[Pose | None, Position]:
    """The pose in a photograph's Exif and XMP data, and what it shows of the ground by that."""
    sample = sample_of_photograph(path.read_bytes(), 0)
    if sample is None:
        return None, None
    return sample.pose, ground_view(sample.pose, shape, None, 0.0, None)


def photographs(name: str, every: int = 1) -> list[Path]:
    """The files of a survey in the order taken, or every second of them."""
    paths = sorted(path for path in (DATA / "mosaic" / name).iterdir() if path.suffix.lower() == ".jpg")
    return paths[::every]


def survey(name: str, location: Path, seed: int | None = None, colmap: bool = False, every: int = 1) -> None:
    """Prints a row of table 1; with a seed the photographs are shuffled."""
    paths = photographs(name, every)
    if seed is not None:
        np.random.default_rng(seed).shuffle(paths)  # type: ignore[arg-type]
    registrar = FrameRegistrar(PlaneSettings(reference=ReferenceChoice.CENTER))
    recorder = MosaicRecorder(RecorderSettings(str(location)))
    began = time.perf_counter()
    placed, views = [], []
    for path in paths:
        picture = np.asarray(cv2.imread(str(path)), dtype=np.uint8)
        placement = registrar.register(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY))
        shape = (int(picture.shape[0]), int(picture.shape[1]))
        pose, view = view_of(path, shape)
        placed.append((placement, shape, pose))
        views.append(FrameView(placement.key_index, placement.to_key, shape, view or "no position"))
        recorder.add(placement, shape, lambda taken=picture: taken, view)
    plane = registrar.take_plane(current=True)
    focal_px = focal_length(views)
    rmse = plane.finish(focal_px)
    keyframes = [number for number, (placement, *_) in enumerate(placed) if placement.keyframe]
    numbers = {placed[number][0].key_index: number for number in keyframes}
    ties = {(numbers[host], numbers[own]) for own in plane.homographies for host in plane.tied_to(own)}
    written = recorder.finish(plane.planes, rmse)
    largest = max(plane.planes.values(), key=len)
    plane.close()
    seconds = time.perf_counter() - began
    order = f", shuffled ({seed})" if seed is not None else ""
    # Strips of 6: ties between pictures of different strips close them.
    across = sum(host // 6 != own // 6 and own - host > 1 for host, own in ties)
    strips = f"{across} of {len(ties)}" if name == "brighton_beach" and seed is None else f"- of {len(ties)}"
    count = sum(placement.key_index in largest for placement, *_ in placed)
    print(
        f"| {name}{order} | {count} of {len(paths)} | {strips} | {written.rmse_px:.2f} "
        f"| {misfit(placed, largest, focal_px)} | {written.width} x {written.height} | {seconds:.1f} |",
        flush=True,
    )
    if colmap:
        peer = colmap_cameras(paths, focal_px, placed[0][1])
        fixes = np.array([(pose.latitude, pose.longitude) for *_, pose in placed if pose is not None])
        matrices = [normalised(largest[one.key_index] @ one.to_key) for one, *_ in placed]
        ours = feet(matrices, [shape for _, shape, _ in placed], focal_px)
        known = np.isfinite(peer).all(axis=1)
        to_peer, _ = apart(ours[known] * [1, -1], peer[known])
        to_gps, metre = apart(peer[known], local_metres(fixes, GeodeticPoint(*fixes[0]))[known])
        print(
            f"| {name}, COLMAP | {known.sum()} of {len(paths)} | | | | {to_gps:.2f} "
            f"| our cameras are {to_peer * metre:.2f} m from its | |",
            flush=True,
        )


def apart(points: FloatArray, goals: FloatArray) -> tuple[float, float]:
    """Root mean square distance of points from others after one similarity, and its scale."""
    found, true = points @ [1, 1j], goals @ [1, 1j]
    found, true = found - found.mean(), true - true.mean()
    factor = (found.conj() @ true) / (found.conj() @ found).real
    return float(np.sqrt((np.abs(true - factor * found) ** 2).mean())), float(abs(factor))


def misfit(placed: list[Placed], homographies: Mapping[int, FloatArray], focal_px: float) -> str:
    """Root mean square distance, m, between positions and mosaic after one similarity.

    Of the middles of the frames, and of the pixels below the cameras.
    """
    known = [one for one in placed if one[2] is not None and one[0].key_index in homographies]
    fixes = np.array([(pose.latitude, pose.longitude) for *_, pose in known if pose is not None])
    metres = local_metres(fixes, GeodeticPoint(*fixes[0]))
    matrices = [normalised(homographies[one.key_index] @ one.to_key) for one, *_ in known]
    shapes = [shape for _, shape, _ in known]
    middles = [
        project(one, centre(shape)[np.newaxis])[0] for one, shape in zip(matrices, shapes, strict=True)
    ]
    found = [np.array(middles)] + ([feet(matrices, shapes, focal_px)] if focal_px else [])
    errors = [f"{apart(points * [1, -1], metres)[0]:.2f}" for points in found]
    return " | ".join([*errors, "-"][:2])


def feet(matrices: list[FloatArray], shapes: list[tuple[int, int]], focal_px: float) -> FloatArray:
    """The points of the plane below cameras, float64[n, 2], by their homographies to the plane."""
    pairs = zip(matrices, shapes, strict=True)
    return np.array([Lens(focal_px, centre(shape)).foot(inverse(matrix)) for matrix, shape in pairs])


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
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--folder", type=Path, help="for the mosaics; a temporary one otherwise")
    parser.add_argument("--surveys", nargs="*", default=["brighton_beach", "caliterra"])
    parser.add_argument("--seeds", type=int, nargs="*", default=[], help="shuffles, besides the order taken")
    parser.add_argument("--every", type=int, default=1, help="only each second photograph, or third ...")
    parser.add_argument("--only-surveys", action="store_true")
    parser.add_argument("--colmap", action="store_true", help="compare cameras with COLMAP's")
    options = parser.parse_args()
    folder = options.folder or Path(tempfile.mkdtemp())
    print(
        "| survey | placed | across strips | tie rms px | middles to GPS m | cameras to GPS m | mosaic | s |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for name in options.surveys:
        for seed in (None, *options.seeds):
            survey(name, folder / f"{name}-{seed}.png", seed, options.colmap and seed is None, options.every)
        count, seconds = scans(photographs(name, options.every), folder / f"{name}-scans.png")
        print(f"| {name}, cv2.Stitcher SCANS | {count} | | | | | | {seconds:.1f} |", flush=True)
    if options.only_surveys:
        return
    pairs()
    drawn()


if __name__ == "__main__":
    main()
