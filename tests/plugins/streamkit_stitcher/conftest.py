"""Synthetic flights over a known ground, with the exact homography of every frame."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from streamkit_stitcher.plane.registrar import FrameRegistrar
from streamkit_stitcher.plane.settings import PlaneSettings

FloatArray = npt.NDArray[np.float64]
GreyArray = npt.NDArray[np.uint8]


def procedural_ground(height: int = 1500, width: int = 2000, seed: int = 3) -> GreyArray:
    """Fractal soil with fields, roofs and roads, uint8[height, width]."""
    random = np.random.default_rng(seed)
    ground = np.zeros((height, width), dtype=np.float32)
    for octave in range(2, 9):
        cells = random.standard_normal((height // 2**octave + 2, width // 2**octave + 2)).astype(np.float32)
        ground += cv2.resize(cells, (width, height), interpolation=cv2.INTER_CUBIC) * octave
    ground = 110 + 12 * ground / ground.std()
    for _ in range(width * height // 3000):
        place = (random.uniform(0, width), random.uniform(0, height))
        size = tuple(random.uniform(5, 40, 2))
        box = cv2.boxPoints((place, size, random.uniform(0, 90))).astype(np.int32)
        cv2.fillConvexPoly(ground, box, float(random.uniform(40, 220)), cv2.LINE_AA)
    for _ in range(6):
        ends = random.uniform(0, width, (2, 2)).astype(int)
        cv2.line(ground, tuple(ends[0]), tuple(ends[1]), 90.0, 18, cv2.LINE_AA)
    return np.clip(cv2.GaussianBlur(ground, (0, 0), 0.8), 0, 255).astype(np.uint8)


@dataclass(frozen=True, eq=False)
class Flight:
    """A camera path over a ground, and cars that drive on it.

    Attributes:
        ground: uint8[h, w], one px of ground per px of frame at scale 1.
        to_ground: float64[n, 3, 3], pixels of frame i to pixels of the ground.
        shape: (height, width) of the frames.
        cars: float64[m, 6], start x y, velocity x y in ground px per frame, length, width.
        noise: deviation of the sensor noise, grey levels.
    """

    ground: GreyArray
    to_ground: FloatArray
    shape: tuple[int, int]
    cars: FloatArray
    noise: float = 2.0

    def __len__(self) -> int:
        return len(self.to_ground)

    def frame(self, index: int) -> GreyArray:
        """Frame `index`, uint8[h, w]."""
        height, width = self.shape
        inverse = np.linalg.inv(self.to_ground[index])
        view = cv2.warpPerspective(
            self.ground, inverse, (width, height), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT
        )
        for car in self.cars:
            heading = float(np.degrees(np.arctan2(car[3], car[2])))
            box = cv2.boxPoints((tuple(car[:2] + index * car[2:4]), (car[4], car[5]), heading))
            corners = cv2.perspectiveTransform(box[np.newaxis].astype(np.float64), inverse)[0]
            cv2.fillConvexPoly(view, np.rint(corners * 16).astype(np.int32), 235, cv2.LINE_AA, 4)
        random = np.random.default_rng(1000 + index)
        noisy = view + self.noise * random.standard_normal(view.shape, dtype=np.float32)
        return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)

    def frames(self) -> Iterator[GreyArray]:
        """All frames in order."""
        return (self.frame(index) for index in range(len(self)))

    def to_first(self, index: int, first: int = 0) -> FloatArray:
        """True homography from frame `index` to frame `first`."""
        matrix = np.linalg.inv(self.to_ground[first]) @ self.to_ground[index]
        return matrix / matrix[2, 2]

    def error(self, measured: FloatArray, index: int, first: int = 0) -> float:
        """Worst distance in px between measured and true positions of the corners of frame `index`."""
        height, width = self.shape
        corners = np.array([[[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]]], float)
        true = cv2.perspectiveTransform(corners, self.to_first(index, first))
        found = cv2.perspectiveTransform(corners, measured)
        return float(np.linalg.norm(true - found, axis=2).max())


def fly(
    ground: GreyArray,
    count: int,
    shape: tuple[int, int] = (720, 1280),
    *,
    seed: int = 0,
    cars: int = 12,
    noise: float = 2.0,
    tilt: float = 1e-5,
    laps: float = 1.0,
    extent: float = 0.8,
) -> Flight:
    """A lap over the ground with turning, climbing, a little tilt and vibration.

    Args:
        ground: uint8[h, w].
        count: number of frames.
        shape: (height, width) of the frames.
        seed: seed of the vibration and of the cars.
        cars: number of cars.
        noise: deviation of the sensor noise, grey levels.
        tilt: largest perspective term, per px.
        laps: rounds of the path; 1 comes back to the start.
        extent: how much of the free ground the path uses, 0 to 1.
    """
    random = np.random.default_rng(seed)
    height, width = shape
    free = np.array([ground.shape[1] - width, ground.shape[0] - height]) / 2 * extent
    middle = np.array([ground.shape[1], ground.shape[0]]) / 2
    matrices = []
    for index in range(count):
        phase = 2 * np.pi * laps * index / max(count, 2)
        place = middle + free * [np.sin(phase), np.sin(2 * phase)] + random.normal(0, 1.5, 2)
        angle = 0.25 * np.sin(2 * phase) + random.normal(0, 0.002)
        scale = 1 + 0.1 * np.sin(3 * phase) + random.normal(0, 0.001)
        cos, sin = scale * np.cos(angle), scale * np.sin(angle)
        turn = np.array([[cos, -sin, place[0]], [sin, cos, place[1]], [0, 0, 1]])
        lean = np.eye(3)
        lean[2, :2] = tilt * np.array([np.sin(5 * phase), np.cos(4 * phase)])
        centre = np.array([[1, 0, -(width - 1) / 2], [0, 1, -(height - 1) / 2], [0, 0, 1]])
        matrices.append(turn @ lean @ centre)
    start = random.uniform(0.2, 0.8, (cars, 2)) * [ground.shape[1], ground.shape[0]]
    speed = random.uniform(-3, 3, (cars, 2))
    size = np.tile([26.0, 12.0], (cars, 1))
    return Flight(ground, np.array(matrices), shape, np.hstack([start, speed, size]), noise)


@pytest.fixture(scope="session")
def ground() -> GreyArray:
    """A procedural ground, uint8[1500, 2000]."""
    return procedural_ground()


@pytest.fixture(scope="session")
def make_flight() -> Callable[..., Flight]:
    """The maker of flights, `fly`."""
    return fly


@pytest.fixture
def make_registrar() -> Iterator[Callable[..., FrameRegistrar]]:
    """Makes a registrar with some settings; closed after the test."""
    registrars: list[FrameRegistrar] = []

    def make(**settings: Any) -> FrameRegistrar:
        registrars.append(FrameRegistrar(PlaneSettings(**settings)))
        return registrars[-1]

    yield make
    for registrar in registrars:
        registrar.close()


@pytest.fixture(scope="session")
def aerial_ground(streamkit_data: Path) -> GreyArray:
    """A real aerial photograph, uint8[2250, 3000]."""
    frame = cv2.imread(str(streamkit_data / "mosaic" / "aerial_cc0.jpg"), cv2.IMREAD_GRAYSCALE)
    assert frame is not None
    return np.asarray(frame, dtype=np.uint8)
