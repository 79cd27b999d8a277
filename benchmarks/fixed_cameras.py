"""Whether registration knows when it is wrong: fixed cameras, whose exact homography is the identity.

    STREAMKIT_DATA=... python benchmarks/fixed_cameras.py [NAME...] [--backwards] [--change KIND...]

Every sequence runs as it is, then cropped and warped by known motions: shake, pan, zoom, turn about the axis,
and aim, a turn to the sides, which alone changes the perspective. The error of a frame is that of its worst
corner, of `to_previous` or `to_reference`, whichever is larger; after a lost frame, which has no known place,
that of `to_reference` alone. `called` is the share of frames with status ok or still, `wrong` the share of
these off by more than 2 px, `worst` the largest error of a frame so called, `spread` the root mean square of
the error of `to_reference` divided by `corner_std`, which predicts it (1 for an honest prediction; at rest
the error is mostly exactly 0). `--backwards` plays the sequences from their ends, with other motions: on
foliage so one rule was chosen, that of the frame after a plane starts at an unknown place, and nothing else.
`--change` shows each sequence as another camera would, too: its lower right corner, mirrored, at 320 px of
width, at twice the size, with gamma 0.7 (bright) and 1.4 (dark), noise, JPEG, H.264, and half of the frames.
Two cameras that do move have no truth and are not in the table. fixed_camera_cars drifts: its marks on the
road move by 3 px within the first 20 frames and by 8 px within 150, all alike. sbi_highwayi shakes: six of
seven windows of the median of its frames are found 0.7 to 2.7 px lower in frame 0, and all six that are found
in frame 325 lie 0.6 to 2.3 px higher (normalised correlation, mostly above 0.9).
Two move once, and are shown without that (phase correlation with medians of the frames): sbi_highwayii by 0.3
to 0.5 px after its first frame, MOT16-09 by 0.8 px downwards in its last fifteen, all 30 to 36 windows alike.
sbi_highwayii also jumps by 0.45 px up or down from frame to frame, one or two of three lying at each place:
an error of 0.4 to 0.5 px there, and a spread above 1, are the truth's.
"""

import os
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections.abc import Callable, Collection, Iterator, Sequence
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
from camera_changes import as_h264, as_jpeg, mirrored, with_gamma, with_noise

from streamkit.geometry.homography import FloatArray, corners, project
from streamkit_stitcher.plane.registrar import FrameRegistrar
from streamkit_stitcher.plane.settings import PlaneSettings

GreyArray = npt.NDArray[np.uint8]
DATA = Path(os.environ.get("STREAMKIT_DATA", "/nonexistent")) / "data"
VIDEOS = {
    "pets09": "video/pets09_s2l1.avi",
    "TUD-Stadtmitte": "mot/TUD-Stadtmitte/video.mp4",
    "KITTI-17": "mot/KITTI-17/video.mp4",
    "MOT16-09": "mot/MOT16-09/video.mp4",
}
# The frames in which a camera that moves once is at rest.
STEADY = {"sbi_highwayii": slice(1, None), "MOT16-09": slice(0, 490)}
MAX_ROWS = 800  # of a video; larger frames are halved
# Cameras that move: no truth.
MOVING = {"sbi_highwayi", "ucsd_jump", "ucsd_skiing", "ucsd_surf"}
MARGIN = 0.12
LIMIT_PX = 2.0
NOISE = 1.0
# Grey levels of a noisy camera, quality of its JPEGs, and rate factor of its video.
CAMERA_NOISE = 6.0
JPEG_QUALITY = 25
H264 = {"crf": "34"}
MOTIONS = ("shake", "pan", "zoom", "turn", "aim")
# Of the camera that is aimed, by the width of a frame: it sees 53 degrees.
FOCAL = 1.0


def sequences(names: Collection[str]) -> Iterator[tuple[str, list[GreyArray]]]:
    """The frames of each fixed camera named, of all where there is no name, uint8[h, w]."""
    folders = [path.name for path in sorted((DATA / "change").iterdir()) if path.name not in MOVING]
    for name in (*folders, *VIDEOS):
        if names and name not in names:
            continue
        if name in VIDEOS:
            frames = [_halved(frame) for frame in _decoded(DATA / VIDEOS[name])]
        else:
            paths = sorted((DATA / "change" / name / "input").glob("*.jpg"))
            frames = [np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), np.uint8) for path in paths]
        yield name, frames[STEADY.get(name, slice(None))]


def _decoded(path: Path) -> Iterator[GreyArray]:
    video = cv2.VideoCapture(str(path))
    while True:
        read, frame = video.read()
        if not read:
            return
        yield np.asarray(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY), dtype=np.uint8)


def _halved(frame: GreyArray) -> GreyArray:
    """A frame, of half the size where it has many rows."""
    if len(frame) <= MAX_ROWS:
        return frame
    return np.asarray(cv2.resize(frame, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _cropped(frame: GreyArray) -> GreyArray:
    """The lower right corner, of 60 % of the width and of the height."""
    height, width = frame.shape
    return np.ascontiguousarray(frame[height * 2 // 5 :, width * 2 // 5 :])


def _doubled(frame: GreyArray) -> GreyArray:
    size = 2 * frame.shape[1], 2 * frame.shape[0]
    return np.asarray(cv2.resize(frame, size, interpolation=cv2.INTER_CUBIC), dtype=np.uint8)


def _narrowed(frame: GreyArray) -> GreyArray:
    """A frame at a width of 320 px."""
    size = 320, round(320 * frame.shape[0] / frame.shape[1])
    return np.asarray(cv2.resize(frame, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _noisy(frame: GreyArray) -> GreyArray:
    # Frames of one sum are the same frame, so that the noise of each is its own, and the same in every run.
    random = np.random.default_rng(int(frame.sum()))
    return with_noise(frame, CAMERA_NOISE * random.standard_normal(frame.shape, dtype=np.float32))


# What another camera would show of the same scene, before it moves, and what it would make of each view.
SCENES: dict[str, Callable[[GreyArray], GreyArray]] = {
    "crop": _cropped,
    "mirror": mirrored,
    "narrow": _narrowed,
    "double": _doubled,
}
CAMERAS: dict[str, Callable[[Iterator[GreyArray]], Iterator[GreyArray]]] = {
    "bright": partial(map, partial(with_gamma, gamma=0.7)),
    "dark": partial(map, partial(with_gamma, gamma=1.4)),
    "noise": partial(map, _noisy),
    "jpeg": partial(map, partial(as_jpeg, quality=JPEG_QUALITY)),
    "h264": partial(as_h264, options=H264),
}
CHANGES = (*SCENES, *CAMERAS, "half-rate")


def views(kind: str, count: int, shape: tuple[int, int], seed: int = 1) -> FloatArray:
    """Known motions, float64[count, 3, 3]: pixels of a view to pixels of the frame it is cut from."""
    random = np.random.default_rng(seed)
    height, width = shape
    inner = np.array([width, height]) * (1 - 2 * MARGIN)
    free = np.array([width, height]) * MARGIN
    time = np.arange(count)
    shift, angle, scale = np.zeros((count, 2)), np.zeros(count), np.ones(count)
    if kind == "shake":
        shift = random.normal(0, 0.004 * width, (count, 2))
        angle = random.normal(0, 0.003, count)
    elif kind == "pan":
        shift[:, 0] = 0.9 * free[0] * np.sin(2 * np.pi * time / 200)
        shift[:, 1] = 0.5 * free[1] * np.sin(2 * np.pi * time / 330)
    elif kind == "zoom":
        scale = 1 + 0.1 * np.sin(2 * np.pi * time / 150)
    elif kind == "turn":
        angle = 0.1 * np.sin(2 * np.pi * time / 180)
    elif kind == "aim":
        return _aimed(inner, (np.array([width, height]) - 1) / 2, free, time, FOCAL * width)
    middle = (inner - 1) / 2
    cos, sin = scale * np.cos(angle), scale * np.sin(angle)
    matrices = np.zeros((count, 3, 3))
    matrices[:, 0, 0] = matrices[:, 1, 1] = cos
    matrices[:, 0, 1], matrices[:, 1, 0], matrices[:, 2, 2] = -sin, sin, 1
    centre = (np.array([width, height]) - 1) / 2 + shift
    matrices[:, :2, 2] = centre - np.einsum("nij,j->ni", matrices[:, :2, :2], middle)
    return matrices


def _aimed(
    inner: FloatArray, centre: FloatArray, free: FloatArray, time: FloatArray, focal: float
) -> FloatArray:
    """Views of a camera that turns to the sides, up and down, float64[count, 3, 3]."""
    half = 0.7 * np.arctan(free / focal)
    across, down = half[0] * np.sin(2 * np.pi * time / 200), half[1] * np.sin(2 * np.pi * time / 330)
    none, one = np.zeros(len(time)), np.ones(len(time))
    yaw = [[np.cos(across), none, np.sin(across)], [none, one, none], [-np.sin(across), none, np.cos(across)]]
    pitch = [[one, none, none], [none, np.cos(down), -np.sin(down)], [none, np.sin(down), np.cos(down)]]
    x, y = (inner - 1) / 2
    to_ray = np.array([[1 / focal, 0, -x / focal], [0, 1 / focal, -y / focal], [0, 0, 1]])
    to_frame = np.array([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1]])
    turned = np.einsum("ijn,jkn->nik", np.array(yaw), np.array(pitch))
    return np.asarray(to_frame @ turned @ to_ray)


def warped(frames: list[GreyArray], to_frame: FloatArray) -> Iterator[GreyArray]:
    """Frames seen through moving views, smaller than the frames, with a grey level of noise."""
    height, width = frames[0].shape
    size = round(width * (1 - 2 * MARGIN)), round(height * (1 - 2 * MARGIN))
    flags = cv2.INTER_LANCZOS4 | cv2.WARP_INVERSE_MAP
    for index, (frame, matrix) in enumerate(zip(frames, to_frame, strict=True)):
        view = cv2.warpPerspective(frame, matrix, size, flags=flags, borderMode=cv2.BORDER_REFLECT)
        noise = NOISE * np.random.default_rng(index).standard_normal(view.shape, dtype=np.float32)
        yield np.clip(np.rint(view + noise), 0, 255).astype(np.uint8)


def measure(frames: Iterator[GreyArray], to_world: FloatArray) -> npt.NDArray[np.object_]:
    """Status, error, that of `to_reference` and its prediction, px, of all frames but one, object[n, 4]."""
    registrar = FrameRegistrar(PlaneSettings())
    # The frame that each plane began with: after a cut, an earlier plane may go on.
    rows, starts = [], dict[int, int]()
    try:
        for index, frame in enumerate(frames):
            found = registrar.register(frame)
            start = starts.setdefault(found.reference, index)
            if not index:
                continue
            # A new plane has no step; that after a lost frame undoes the guess which took its place.
            is_step = found.status.value != "cut" and (not rows or rows[-1][0] != "lost")
            outline = corners((int(frame.shape[0]), int(frame.shape[1])))
            errors = [
                float(np.hypot(*(project(measured, outline) - project(true, outline)).T).max())
                for measured, true in (
                    (found.to_reference, np.linalg.inv(to_world[start]) @ to_world[index]),
                    (found.to_previous, np.linalg.inv(to_world[index - 1]) @ to_world[index]),
                )
                if is_step or measured is found.to_reference
            ]
            rows.append((found.status.value, max(errors), errors[0], found.corner_std))
    finally:
        registrar.close()
    return np.array(rows, dtype=object)


def row(name: str, found: npt.NDArray[np.object_]) -> str:
    """One row of the table."""
    states, (errors, on_plane, deviations) = found[:, 0], found[:, 1:].T.astype(float)
    called = np.isin(states, ("ok", "still"))
    wrong = called & (errors > LIMIT_PX)
    counts = {str(state): int((states == state).sum()) for state in np.unique(states)}
    known = called & (deviations > 0)
    spread = (
        float(np.sqrt(np.mean((on_plane[known] / deviations[known]) ** 2))) if known.any() else float("nan")
    )
    return (
        f"| {name} | {len(found)} | {called.mean():.1%} | {wrong.sum() / max(1, called.sum()):.1%} "
        f"| {errors[called].max(initial=0):.2f} | {np.median(errors):.3f} | {spread:.2f} "
        f"| {', '.join(f'{count} {state}' for state, count in counts.items())} |"
    )


def _rows(name: str, frames: list[GreyArray], motions: Sequence[str], seed: int, change: str = "") -> None:
    """Prints one row per motion: `still` is none."""
    every = slice(None, None, 2 if change == "half-rate" else 1)
    shown = [SCENES[change](frame) for frame in frames] if change in SCENES else frames
    camera, shape = CAMERAS.get(change, iter), (int(shown[0].shape[0]), int(shown[0].shape[1]))
    title = f"{name}, {change}" if change else name
    for kind in motions:
        if kind == "still":
            truth = np.tile(np.eye(3), (len(shown[every]), 1, 1))
            print(row(title, measure(camera(iter(shown[every])), truth)), flush=True)
            continue
        matrices = views(kind, len(shown), shape, seed)[every]
        found = measure(camera(warped(shown[every], matrices)), matrices)
        print(row(f"{title}, {kind}", found), flush=True)


def main() -> None:
    """Prints one row per sequence, change and motion."""
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("name", nargs="*", help="sequences; all if there is none")
    parser.add_argument("--backwards", action="store_true", help="play the sequences from their ends")
    parser.add_argument("--change", nargs="+", choices=CHANGES, default=[], help="show changed frames, too")
    parser.add_argument("--motion", nargs="+", choices=("still", *MOTIONS), default=("still", *MOTIONS))
    options = parser.parse_args()
    cv2.setNumThreads(1)
    print("| sequence | frames | called | wrong | worst px | median px | spread | states |")
    print("|---|---|---|---|---|---|---|---|")
    for name, frames in sequences(options.name):
        shown, seed = (frames[::-1], 2) if options.backwards else (frames, 1)
        for change in ("", *options.change):
            _rows(name, shown, options.motion, seed, change)


if __name__ == "__main__":
    main()
