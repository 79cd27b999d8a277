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

FloatArray = NDArray[np.float64]
ByteArray = NDArray[np.uint8]
LevelArray = NDArray[np.float32]

VARIANTS = ("", " backwards", " from its middle", " box shifted")
SHIFT = 0.1  # of the first box's sides
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
        window: float64[5] x y length width angle, or None where only the box is known.
        to_previous: float64[3, 3], how the camera moved; only our tracker is told.
    """

    picture: ByteArray
    box: FloatArray
    window: FloatArray | None
    to_previous: FloatArray


def shared_data() -> Path:
    """The folder of shared data, from STREAMKIT_DATA."""
    folder = Path(os.environ.get("STREAMKIT_DATA", "")) / "data"
    if not folder.is_dir():
        raise SystemExit("STREAMKIT_DATA must name the folder that holds data/")
    return folder


def real(name: str, variant: str = "") -> Iterator[Step]:
    """A real sequence, or one of its `VARIANTS`; its published pixels start at 1."""
    folder = shared_data() / "sot" / name
    boxes = np.genfromtxt(folder / "groundtruth.txt", delimiter=",")[:, :4] - [1, 1, 0, 0]
    pairs = list(zip(sorted((folder / "img").iterdir()), boxes, strict=False))
    if variant == " backwards":
        pairs.reverse()
    if variant == " from its middle":
        pairs = pairs[len(pairs) // 2 :]
    for index, (path, box) in enumerate(pairs):
        shifted = index == 0 and variant == " box shifted"
        start = box + SHIFT * np.array([box[2], -box[3], 0, 0]) if shifted else box
        yield Step(cv2.imread(str(path)), start, None, np.eye(3))


def real_names() -> list[str]:
    """The sequences in the shared data."""
    return sorted(path.name for path in (shared_data() / "sot").iterdir() if path.is_dir())


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
        yield Step(np.clip(np.rint(scene), 0, 255).astype(np.uint8), upright(window), window, shift)


def upright(window: FloatArray) -> FloatArray:
    """float64[4] x0 y0 width height around a turned window."""
    cosine, sine = abs(np.cos(window[4])), abs(np.sin(window[4]))
    width, height = window[2] * cosine + window[3] * sine, window[2] * sine + window[3] * cosine
    return np.array([window[0] - (width - 1) / 2, window[1] - (height - 1) / 2, width, height])


def overlap(first: FloatArray, second: FloatArray) -> float:
    """Intersection over union of two boxes x0 y0 width height."""
    low = np.maximum(first[:2], second[:2])
    high = np.minimum(first[:2] + first[2:], second[:2] + second[2:])
    common = float(np.prod(np.maximum(high - low, 0)))
    return common / (float(np.prod(first[2:]) + np.prod(second[2:])) - common)


@dataclass(frozen=True)
class Scores:
    """One-pass scores of a run.

    Attributes:
        success: area under the success curve over 21 thresholds, as in OTB.
        precision: share of frames with a centre error of at most 20 px.
        centre_error: median, px.
    """

    success: float
    precision: float
    centre_error: float


def score(found: list[FloatArray | None], truth: list[FloatArray]) -> Scores:
    """Scores boxes x0 y0 width height; None where the tracker gave none. Frames without truth do not count.

    Source: Wu, Lim and Yang, Online Object Tracking: A Benchmark, CVPR 2013.
    """
    overlaps, errors = [], []
    for box, true in zip(found, truth, strict=True):
        if not np.isfinite(true).all() or true[2] <= 0:
            continue
        overlaps.append(0.0 if box is None else overlap(box, true))
        errors.append(np.inf if box is None else np.hypot(*(box[:2] + box[2:] / 2 - true[:2] - true[2:] / 2)))
    curve = [np.mean(np.array(overlaps) > threshold) for threshold in np.linspace(0, 1, 21)]
    return Scores(float(np.mean(curve)), float(np.mean(np.array(errors) <= 20)), float(np.median(errors)))


def sequences(seeds: range, variants: bool = False) -> list[tuple[str, Callable[[], Iterator[Step]]]]:
    """Name and maker of every sequence that has a truth to the end.

    Args:
        seeds: of the rendered ones.
        variants: whether the real ones are also run backwards, from their middle and from a wrong box.
    """
    made: list[tuple[str, Callable[[], Iterator[Step]]]] = []
    for variant in VARIANTS if variants else VARIANTS[:1]:
        made += [(name + variant, lambda n=name, v=variant: real(n, v)) for name in real_names()]
    for kind in KINDS[:3]:
        made += [(kind, lambda k=kind, s=seed: rendered(k, s)) for seed in seeds]
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
