"""Sequences with one target and its truth: real ones from the shared data, and rendered ones with known turn.

Needs numpy and OpenCV only, so that peers can read it from an environment of their own.
"""

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from streamkit.geometry.boxes import upright_sides

FloatArray = NDArray[np.float64]
ByteArray = NDArray[np.uint8]
LevelArray = NDArray[np.float32]

KINDS = ("turn, size, light", "view change", "occluder", "removed")
FRAMES = 150
GONE_FROM = 100
HEIGHT, WIDTH = 540, 960
OCCLUDED = range(60, 85)


@dataclass(frozen=True)
class Step:
    """One frame.

    Attributes:
        picture: uint8[h, w, 3], BGR.
        box: float64[4] x0 y0 width height in pixels from 0, NaN where there is no truth.
        window: float64[5] x y length width angle, or None where only the box is known; the first one is that
            from which the target is followed.
        to_previous: float64[3, 3], how the camera moved; only our tracker gets it.
        hidden: whether the target is covered or out of view.
        step_s: time since the last frame.
    """

    picture: ByteArray
    box: FloatArray
    window: FloatArray | None
    to_previous: FloatArray
    hidden: bool = False
    step_s: float = 0.04


def shared_data() -> Path:
    """The folder of shared data, from STREAMKIT_DATA."""
    folder = Path(os.environ.get("STREAMKIT_DATA", "")) / "data"
    if not folder.is_dir():
        raise SystemExit("STREAMKIT_DATA must name the folder that holds data/")
    return folder


def real(name: str) -> Iterator[Step]:
    """A real sequence; its published pixels start at 1. Pictures have an even width and height."""
    boxes = np.genfromtxt(_folder(name) / "groundtruth.txt", delimiter=",")[:, :4] - [1, 1, 0, 0]
    for picture, box in zip(_pictures(_folder(name)), boxes, strict=False):
        rows, columns = picture.shape[0] // 2 * 2, picture.shape[1] // 2 * 2
        hidden = not np.isfinite(box).all()
        yield Step(np.ascontiguousarray(picture[:rows, :columns]), box, None, np.eye(3), hidden)


def real_names() -> list[str]:
    """The sequences in the shared data, as folders of pictures and as video."""
    folders = [*(shared_data() / "sot").iterdir(), *(shared_data() / "sot_video").iterdir()]
    return sorted(path.name for path in folders if path.is_dir())


def _folder(name: str) -> Path:
    return next(shared_data().glob(f"sot*/{name}"))


def _pictures(folder: Path) -> Iterator[ByteArray]:
    """uint8[h, w, 3] of every frame of a sequence, from its pictures or its video."""
    video = folder / "video.mp4"
    if not video.exists():
        yield from (cv2.imread(str(path)) for path in sorted((folder / "img").iterdir()))
        return
    capture = cv2.VideoCapture(str(video))
    while (read := capture.read())[0]:
        yield read[1]


def planes(picture: ByteArray) -> tuple[ByteArray, tuple[ByteArray, ByteArray]]:
    """Grey levels uint8[h, w] and chroma, two planes uint8[h / 2, w / 2], of a picture of even size."""
    rows, columns = picture.shape[:2]
    both = cv2.cvtColor(picture, cv2.COLOR_BGR2YUV_I420)
    chroma = both[rows:].reshape(2, rows // 2, columns // 2)
    return both[:rows], (chroma[0], chroma[1])


def rendered(kind: str, seed: int) -> Iterator[Step]:
    """A COIL-20 object over an aerial picture, under a camera that drifts by at most 2 px a frame."""
    generator = np.random.default_rng((KINDS.index(kind), seed))
    aerial = cv2.imread(str(shared_data() / "mosaic" / "aerial_cc0.jpg"))
    left, top = generator.uniform(300, aerial.shape[1] - WIDTH - 300), generator.uniform(300, 1200)
    views = _views(int(generator.integers(1, 21)))
    path, phase = generator.uniform(0.6, 1.0, 8), generator.uniform(0, 2 * np.pi, 8)
    side = generator.uniform(48, 72)
    before = np.zeros(2)
    for index in range(FRAMES):
        time = index / 25
        camera = np.array([40 * np.sin(0.8 * path[0] * time), 30 * np.sin(0.9 * path[1] * time)])
        scene = _crop(aerial, left + camera[0], top + camera[1])
        grown = 1 + 0.2 * np.sin(0.8 * path[2] * time + phase[2])
        window = np.array(
            [
                WIDTH / 2 + 260 * np.sin(0.7 * path[3] * time + phase[3]) - camera[0],
                HEIGHT / 2 + 130 * np.sin(0.8 * path[4] * time + phase[4]) - camera[1],
                side * grown,
                0.8 * side * grown,
                0.7 * np.sin(0.6 * path[5] * time + phase[5]),
            ]
        )
        light = 1 + 0.25 * np.sin(1.1 * path[6] * time + phase[6])
        turn = 12 * index / FRAMES if kind == "view change" else 0.0
        if not (kind == "removed" and index >= GONE_FROM):
            _paste(scene, _view(views, turn), window, light)
        if kind == "occluder" and index in OCCLUDED:
            _paste(scene, aerial[100:190, 100:190].astype(np.float32), window * [1, 1, 1.6, 1.6, 1], 1.0)
        scene += 3.0 * generator.standard_normal(scene.shape, np.float32)
        shift = np.eye(3)
        shift[:2, 2], before = camera - before, camera
        hidden = kind == "occluder" and index in OCCLUDED
        yield Step(np.clip(np.rint(scene), 0, 255).astype(np.uint8), upright(window), window, shift, hidden)


def upright(window: FloatArray) -> FloatArray:
    """float64[4] x0 y0 width height around a turned window."""
    width, height = upright_sides(*window[2:])
    return np.array([window[0] - (width - 1) / 2, window[1] - (height - 1) / 2, width, height])


def overlaps(found: FloatArray, truth: FloatArray) -> FloatArray:
    """Intersection over union of boxes float64[n, 4], x0 y0 width height: float64[n]; 0 for a box of NaN."""
    low = np.maximum(found[:, :2], truth[:, :2])
    high = np.minimum(found[:, :2] + found[:, 2:], truth[:, :2] + truth[:, 2:])
    common = np.prod(np.maximum(high - low, 0), axis=1)
    return np.nan_to_num(common / (np.prod(found[:, 2:], axis=1) + np.prod(truth[:, 2:], axis=1) - common))


@dataclass(frozen=True)
class Scores:
    """One-pass scores of a run.

    Attributes:
        success: area under the success curve over 21 thresholds, as in OTB.
        precision: share of frames with a centre error of at most 20 px.
        centre_error: median, px.
        elsewhere: share of the frames claimed to be confirmed that do not overlap the truth.
        confirmed: share of the frames that overlap the truth which are claimed to be confirmed.
    """

    success: float
    precision: float
    centre_error: float
    elsewhere: float
    confirmed: float


def score(found: FloatArray, truth: FloatArray, claimed: NDArray[np.bool_] | None = None) -> Scores:
    """Scores boxes float64[n, 4], NaN where the tracker gave none. Frames without truth do not count.

    Args:
        found: of the tracker.
        truth: float64[n, 4].
        claimed: bool[n], frames in which the tracker claims to see the target; None is all with a box.

    Source: Wu, Lim and Yang, Online Object Tracking: A Benchmark, CVPR 2013.
    """
    there = np.isfinite(truth).all(axis=1) & (truth[:, 2] > 0)
    claimed = np.isfinite(found[:, 0]) if claimed is None else claimed
    found, truth, claimed = found[there], truth[there], claimed[there]
    overlap = overlaps(found, truth)
    apart = found[:, :2] + found[:, 2:] / 2 - truth[:, :2] - truth[:, 2:] / 2
    errors = np.nan_to_num(np.hypot(apart[:, 0], apart[:, 1]), nan=np.inf)
    success = float(np.mean(overlap[None] > np.linspace(0, 1, 21)[:, None]))
    elsewhere = float(np.sum(claimed & (overlap <= 0)) / max(np.sum(claimed), 1))
    confirmed = float(np.sum(claimed & (overlap > 0)) / max(np.sum(overlap > 0), 1))
    return Scores(success, float(np.mean(errors <= 20)), float(np.median(errors)), elsewhere, confirmed)


def returns(
    found: FloatArray, truth: FloatArray, claimed: NDArray[np.bool_], hidden: NDArray[np.bool_]
) -> list[float]:
    """For each time the target was hidden, the frames from its return until it is confirmed where it is.

    Args:
        found: float64[n, 4], boxes of the tracker.
        truth: float64[n, 4].
        claimed: bool[n], frames in which the tracker claims to see the target.
        hidden: bool[n], frames in which it cannot be seen.

    Returns:
        Frames, infinite where it is not found before it is hidden again or the sequence ends.
    """
    right = claimed & (overlaps(found, truth) > 0)
    edges = np.flatnonzero(np.diff(hidden.astype(int)) != 0) + 1
    visible = [part for part in np.split(np.arange(len(hidden)), edges) if not hidden[part[0]]]
    waits = [np.flatnonzero(right[part]) for part in visible if part[0] > 0]
    return [float(wait[0]) if len(wait) else np.inf for wait in waits]


def sequences(seeds: range) -> list[tuple[str, Callable[[], Iterator[Step]]]]:
    """Name and maker of every sequence that has a truth to the end; `seeds` are of the rendered ones."""
    made: list[tuple[str, Callable[[], Iterator[Step]]]] = []
    made += [(name, lambda n=name: real(n)) for name in real_names()]
    for kind in KINDS[:3]:
        made += [(f"{kind} {seed}", lambda k=kind, s=seed: rendered(k, s)) for seed in seeds]
    return made


def _views(number: int) -> list[LevelArray]:
    """The 24 views of a COIL-20 object, 15 degrees apart."""
    folder = shared_data() / "coil20"
    paths = [folder / f"obj{number}__{view}.png" for view in range(0, 72, 3)]
    return [cv2.imread(str(path)).astype(np.float32) for path in paths]


def _view(views: list[LevelArray], turn: float) -> LevelArray:
    """Blend of the two views nearest to a turn counted in views."""
    first, share = int(turn), turn - int(turn)
    near, next_one = views[first % len(views)], views[(first + 1) % len(views)]
    return near + np.float32(share) * (next_one - near)


def _crop(picture: ByteArray, left: float, top: float) -> LevelArray:
    matrix = np.array([[1.0, 0, left], [0, 1.0, top]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return cv2.warpAffine(picture, matrix, (WIDTH, HEIGHT), flags=flags).astype(np.float32)


def _paste(scene: LevelArray, texture: LevelArray, window: FloatArray, light: float) -> None:
    """Draws a texture into a turned window of the scene."""
    reach = int(np.hypot(window[2], window[3]) / 2) + 3
    left, top = max(int(window[0]) - reach, 0), max(int(window[1]) - reach, 0)
    part = scene[top : int(window[1]) + reach, left : int(window[0]) + reach]
    rows, columns = texture.shape[:2]
    cosine, sine = np.cos(window[4]), np.sin(window[4])
    along, across = window[2] / columns, window[3] / rows
    matrix = np.array([[cosine * along, -sine * across, 0.0], [sine * along, cosine * across, 0.0]])
    centre = matrix[:, :2] @ np.array([(columns - 1) / 2, (rows - 1) / 2])
    matrix[:, 2] = window[:2] - [left, top] - centre
    size = (part.shape[1], part.shape[0])
    drawn = cv2.warpAffine(texture * np.float32(light), matrix, size, flags=cv2.INTER_AREA)
    mask = cv2.warpAffine(np.ones((rows, columns), np.float32), matrix, size)[..., None]
    part += mask * (drawn - part)
