"""A small world with exact truth: textured ground, a camera that moves over it, cars."""

from dataclasses import dataclass, field
from functools import lru_cache

import cv2
import numpy as np
import pytest


@dataclass(frozen=True)
class Car:
    """A rectangle of two tones that drives straight on."""

    start: tuple[float, float]
    velocity: tuple[float, float]
    length: float
    tone: float

    def corners(self, time: float) -> np.ndarray:
        centre = np.array(self.start) + np.array(self.velocity) * time
        angle = float(np.degrees(np.arctan2(self.velocity[1], self.velocity[0])))
        size = (self.length, 0.5 * self.length)
        return cv2.boxPoints(((float(centre[0]), float(centre[1])), size, angle)).astype(np.float64)


@dataclass
class World:
    """Frames, how they map to the first one, and where the cars are."""

    seed: int
    is_moving: bool = True
    pan: tuple[float, float] = (2.5, 1.0)
    count: int = 56
    size: tuple[int, int] = (480, 320)
    cars: list[Car] = field(default_factory=list)

    def __post_init__(self) -> None:
        random = np.random.default_rng(self.seed)
        width, height = self.size
        self.ground = make_ground(random, 3 * width, 3 * height)
        self.middle = np.array([1.5 * width, 1.5 * height])
        if not self.cars:
            self.cars = [make_car(random, self, lane) for lane in range(4)]
        self.random = random

    def to_ground(self, time: int) -> np.ndarray:
        width, height = self.size
        to_centre = np.array([[1, 0, -width / 2], [0, 1, -height / 2], [0, 0, 1.0]])
        k = (time - self.count / 2) if self.is_moving else 0.0
        angle, zoom = 0.002 * k, np.exp(0.001 * k)
        turn = np.array(
            [
                [zoom * np.cos(angle), -zoom * np.sin(angle), self.middle[0] + self.pan[0] * k],
                [zoom * np.sin(angle), zoom * np.cos(angle), self.middle[1] + self.pan[1] * k],
                [0, 0, 1.0],
            ]
        )
        return turn @ to_centre

    def to_reference(self, time: int) -> np.ndarray:
        return np.linalg.inv(self.to_ground(0)) @ self.to_ground(time)

    def to_previous(self, time: int) -> np.ndarray:
        return np.linalg.inv(self.to_ground(max(time - 1, 0))) @ self.to_ground(time)

    def outlines(self, time: int) -> list[np.ndarray]:
        from_ground = np.linalg.inv(self.to_ground(time))
        return [cv2.perspectiveTransform(car.corners(time)[None], from_ground)[0] for car in self.cars]

    def frame(self, time: int) -> np.ndarray:
        from_ground = np.linalg.inv(self.to_ground(time))
        picture = cv2.warpPerspective(self.ground, from_ground, self.size)
        for car, outline in zip(self.cars, self.outlines(time), strict=True):
            fill(picture, outline, car.tone)
            centre = outline.mean(axis=0)
            fill(picture, centre + 0.35 * (outline - centre), 255 - car.tone)
        noise = self.random.normal(0.0, 2.5, picture.shape).astype(np.float32)
        return np.clip(np.round(picture + noise), 0, 255).astype(np.uint8)

    @property
    def frames(self) -> list[np.ndarray]:
        if not hasattr(self, "_frames"):
            self._frames = [self.frame(time) for time in range(self.count)]
        return self._frames

    def truth(self, time: int) -> list[tuple[np.ndarray, np.ndarray]]:
        """Centre and box of the cars wholly in view."""
        found = []
        for outline in self.outlines(time):
            low, high = outline.min(axis=0), outline.max(axis=0)
            if (low >= 4).all() and (high <= np.array(self.size) - 5).all():
                found.append((outline.mean(axis=0), np.concatenate([low, high])))
        return found


def fill(picture: np.ndarray, outline: np.ndarray, tone: float) -> None:
    """Paints a polygon with smooth edges."""
    points = np.round(outline * 16).astype(np.int32)
    cv2.fillPoly(picture, [points], float(tone), cv2.LINE_AA, 4)


def make_ground(random: np.random.Generator, width: int, height: int) -> np.ndarray:
    """Smooth texture with sharp-edged houses."""
    ground = np.full((height, width), 115.0, np.float32)
    for level in range(2, 7):
        cells = random.standard_normal((height >> level, width >> level)).astype(np.float32)
        ground += cv2.resize(cells, (width, height), interpolation=cv2.INTER_CUBIC) * 1.5 * level
    for _ in range(60):
        x, y, a, b = random.uniform(0, [width, height, 40, 40])
        fill(ground, np.array([[x, y], [x + a, y], [x + a, y + b], [x, y + b]]), random.uniform(60, 180))
    return cv2.GaussianBlur(ground, (3, 3), 0.8)


def make_car(random: np.random.Generator, world: World, lane: int) -> Car:
    """One lane of the image for each car, so that they never touch."""
    width, height = world.size
    y = world.middle[1] + (lane - 1.5) * height / 5
    speed = random.uniform(1.5, 4.0) * (1 if lane % 2 else -1)
    drift = random.uniform(-0.15, 0.15)
    x = world.middle[0] - speed * world.count / 2 + random.uniform(-0.2, 0.2) * width
    tone = random.choice([random.uniform(5, 30), random.uniform(225, 250)])
    start = (float(x), float(y - drift * world.count / 2))
    return Car(start, (speed, drift), random.uniform(16, 34), float(tone))


@lru_cache(maxsize=4)
def cached_world(seed: int, is_moving: bool) -> World:
    """A world whose frames are rendered once for all tests."""
    return World(seed, is_moving)


@pytest.fixture
def world():
    """Makes a world of a seed, with a camera that moves or not."""
    return cached_world
