"""Synthetic sequences with exact truth, for the tests of this room."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
ByteArray = NDArray[np.uint8]


def ground(generator: np.random.Generator, height: int, width: int, contrast: float = 60.0) -> FloatArray:
    """Fractal noise, float64[height, width], grey levels around 110."""
    total = np.zeros((height, width))
    for octave in range(1, 7):
        cells = 2**octave + 2
        noise = generator.standard_normal((cells, cells)).astype(np.float32)
        total += cv2.resize(noise, (width, height), interpolation=cv2.INTER_CUBIC) / 1.6**octave
    return 110 + contrast * (total - total.mean()) / (3 * total.std())


def blob_texture(generator: np.random.Generator, side: int = 64) -> FloatArray:
    """A patch with structure at several scales, float64[side, side], grey levels 20 to 235."""
    coarse = cv2.resize(generator.random((4, 4)), (side, side), interpolation=cv2.INTER_CUBIC)
    fine = cv2.resize(generator.random((12, 12)), (side, side), interpolation=cv2.INTER_CUBIC)
    mixed = 0.65 * coarse + 0.35 * fine
    return 20 + 215 * (mixed - mixed.min()) / (mixed.max() - mixed.min())


def paint(image: FloatArray, texture: FloatArray, window: FloatArray, light: float = 1.0) -> FloatArray:
    """Draws a texture into a rotated window x y length width angle of a copy of the image."""
    x, y, length, width, angle = window
    rows, columns = texture.shape
    cosine, sine = np.cos(angle), np.sin(angle)
    along, across = length / columns, width / rows
    matrix = np.array([[cosine * along, -sine * across, 0.0], [sine * along, cosine * across, 0.0]])
    centre = np.array([(columns - 1) / 2, (rows - 1) / 2])
    matrix[:, 2] = np.array([x, y]) - matrix[:, :2] @ centre
    size = (image.shape[1], image.shape[0])
    drawn = cv2.warpAffine(texture * light, matrix, size, flags=cv2.INTER_LINEAR)
    mask = cv2.warpAffine(np.ones_like(texture), matrix, size, flags=cv2.INTER_LINEAR)
    return image * (1 - mask) + drawn * mask


def grey(image: FloatArray, generator: np.random.Generator, noise: float) -> ByteArray:
    """Adds sensor noise and rounds to uint8."""
    return np.clip(np.rint(image + noise * generator.standard_normal(image.shape)), 0, 255).astype(np.uint8)


@dataclass(frozen=True)
class TurningScene:
    """One textured target that moves, turns, grows and changes its light over a textured ground."""

    frames: int = 60
    seed: int = 0
    size: tuple[int, int] = (270, 360)
    side: float = 48.0
    gone_from: int = 10**6

    def __iter__(self) -> Iterator[tuple[ByteArray, FloatArray]]:
        generator = np.random.default_rng((7, self.seed))
        backdrop = ground(generator, *self.size)
        texture = blob_texture(generator)
        height, width = self.size
        phase = generator.uniform(0, 2 * np.pi, 4)
        for index in range(self.frames):
            time = index / 25
            window = np.array(
                [
                    width / 2 + 0.28 * width * np.sin(0.9 * time + phase[0]),
                    height / 2 + 0.25 * height * np.sin(0.7 * time + phase[1]),
                    self.side * (1 + 0.15 * np.sin(0.8 * time + phase[2])),
                    0.7 * self.side * (1 + 0.15 * np.sin(0.8 * time + phase[2])),
                    0.6 * np.sin(0.7 * time + phase[3]),
                ]
            )
            light = 1 + 0.2 * np.sin(1.1 * time)
            image = backdrop if index >= self.gone_from else paint(backdrop, texture, window, light)
            yield grey(image, generator, 3.0), window


@dataclass(frozen=True)
class Car:
    """A car on the ground: where it starts, how it drives, when it stops or leaves."""

    start: tuple[float, float]
    velocity: tuple[float, float]
    texture: FloatArray
    length: float = 26.0
    width: float = 13.0
    stops_at: int = 10**6
    gone_at: int = 10**6

    def window(self, index: int) -> FloatArray | None:
        """Window on the ground at a frame, or None once the car is gone."""
        if index >= self.gone_at:
            return None
        time = min(index, self.stops_at) / 25
        angle = np.arctan2(self.velocity[1], self.velocity[0])
        x, y = self.start[0] + self.velocity[0] * time, self.start[1] + self.velocity[1] * time
        return np.array([x, y, self.length, self.width, angle])


@dataclass(frozen=True)
class SeenFrame:
    """One frame of a flight with its truth and simulated detections."""

    image: ByteArray
    to_previous: FloatArray
    to_reference: FloatArray
    truth: dict[int, FloatArray]
    centroids: FloatArray
    boxes: FloatArray


@dataclass(frozen=True)
class Flight:
    """Cars under a camera that drifts over the ground, with detections that miss and lie."""

    cars: list[Car]
    frames: int = 100
    seed: int = 0
    size: tuple[int, int] = (360, 480)
    camera: tuple[float, float] = (1.5, 0.8)
    turn: float = 0.0005
    centroid_noise: float = 1.2
    box_noise: float = 2.0
    miss: float = 0.1
    false_alarms: float = 0.5
    ghosts: list[tuple[float, float, int, int]] = field(default_factory=list)
    merged_within: float = 0.0

    def __iter__(self) -> Iterator[SeenFrame]:
        generator = np.random.default_rng((11, self.seed))
        margin = 400
        height, width = self.size
        scene = ground(generator, height + 2 * margin, width + 2 * margin)
        previous = None
        for index in range(self.frames):
            to_ground = self._camera(index)
            truth, covered = {}, []
            for number, car in enumerate(self.cars):
                window = car.window(index)
                if window is not None:
                    shifted = window + np.array([margin, margin, 0, 0, 0])
                    covered.append(_paint_near(scene, car.texture, shifted))
                    truth[number] = _to_frame(window, to_ground)
            offset = np.array([[1.0, 0, margin], [0, 1.0, margin], [0, 0, 1]])
            seen = cv2.warpPerspective(
                scene, offset @ to_ground, (width, height), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
            )
            for near, before in reversed(covered):
                scene[near] = before
            to_previous = np.eye(3) if previous is None else np.linalg.inv(previous) @ to_ground
            previous = to_ground
            inside = {n: w for n, w in truth.items() if 0 <= w[0] <= width - 1 and 0 <= w[1] <= height - 1}
            centroids, boxes = self._detect(index, inside, to_ground, generator)
            yield SeenFrame(
                grey(seen, generator, 3.0),
                to_previous / to_previous[2, 2],
                to_ground,
                inside,
                centroids,
                boxes,
            )

    def _camera(self, index: int) -> FloatArray:
        angle = self.turn * index
        cosine, sine = np.cos(angle), np.sin(angle)
        return np.array(
            [
                [cosine, -sine, self.camera[0] * index],
                [sine, cosine, self.camera[1] * index],
                [0.0, 0.0, 1.0],
            ]
        )

    def _detect(
        self, index: int, truth: dict[int, FloatArray], to_ground: FloatArray, generator: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        found = []
        for number, window in truth.items():
            car = self.cars[number]
            if index > car.stops_at + 10 or generator.random() < self.miss:
                continue
            box = _upright(window)
            noise = generator.standard_normal(4) * self.box_noise
            centre = window[:2] + generator.standard_normal(2) * self.centroid_noise
            found.append((centre, box + noise))
        if self.merged_within and len(found) == 2:
            gap = np.hypot(*(found[0][0] - found[1][0]))
            if gap < self.merged_within:
                boxes = np.array([f[1] for f in found])
                both = np.concatenate([boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)])
                found = [((found[0][0] + found[1][0]) / 2, both)]
        for x, y, first, last in self.ghosts:
            if first <= index < last:
                centre = _to_frame(np.array([x, y, 20, 20, 0.0]), to_ground)[:2]
                centre = centre + generator.standard_normal(2) * self.centroid_noise
                found.append((centre, np.concatenate([centre - 10, centre + 10])))
        for _ in range(generator.poisson(self.false_alarms)):
            centre = generator.uniform([0, 0], [self.size[1], self.size[0]])
            half = generator.uniform(4, 12, 2)
            found.append((centre, np.concatenate([centre - half, centre + half])))
        order = generator.permutation(len(found))
        centroids = np.array([found[i][0] for i in order]).reshape(-1, 2)
        boxes = np.array([found[i][1] for i in order]).reshape(-1, 4)
        return centroids, boxes


def _paint_near(
    scene: FloatArray, texture: FloatArray, window: FloatArray
) -> tuple[tuple[slice, slice], FloatArray]:
    """Paints in place, so that the cost does not grow with the ground; returns what was there, and where."""
    reach = int(window[2]) + 4
    left, top = int(window[0]) - reach, int(window[1]) - reach
    right, bottom = left + 2 * reach, top + 2 * reach
    near = slice(top, bottom), slice(left, right)
    if left < 0 or top < 0 or right > scene.shape[1] or bottom > scene.shape[0]:
        near = slice(0), slice(0)
    before = scene[near].copy()
    if before.size:
        scene[near] = paint(before, texture, window - np.array([left, top, 0, 0, 0]))
    return near, before


def _to_frame(window: FloatArray, to_ground: FloatArray) -> FloatArray:
    inverse = np.linalg.inv(to_ground)
    x, y = (inverse @ np.array([window[0], window[1], 1.0]))[:2]
    turn = np.arctan2(inverse[1, 0], inverse[0, 0])
    return np.array([x, y, window[2], window[3], window[4] + turn])


def _upright(window: FloatArray) -> FloatArray:
    cosine, sine = abs(np.cos(window[4])), abs(np.sin(window[4]))
    half = 0.5 * np.array([window[2] * cosine + window[3] * sine, window[2] * sine + window[3] * cosine])
    return np.concatenate([window[:2] - half, window[:2] + half])


def car_texture(generator: np.random.Generator) -> FloatArray:
    """A car from above: bright or dark body, dark windscreens, highlights."""
    body = generator.choice([35.0, 60.0, 190.0, 225.0])
    texture = np.full((16, 32), body)
    texture[2:14, 8:11] = 30 if body > 100 else 120
    texture[2:14, 22:25] = 40 if body > 100 else 140
    texture += 6 * generator.standard_normal(texture.shape)
    return texture
