"""Flights rendered from aerial pictures, with exact truth, for the stitcher's benchmarks."""

import os
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
PictureArray = npt.NDArray[np.uint8]

SHIPPED = Path(__file__).parents[1] / "plugins" / "streamkit_video" / "data"


def ground_picture() -> PictureArray:
    """An aerial photograph, uint8[h, w, 3]: that of the shared data, or the smaller one shipped."""
    shared = Path(os.environ.get("STREAMKIT_DATA", "/nonexistent")) / "data" / "mosaic" / "aerial_cc0.jpg"
    places = [shared, *sorted(SHIPPED.glob("*.jpg"))]
    picture = next(read for place in places if (read := cv2.imread(str(place))) is not None)
    return np.asarray(picture, dtype=np.uint8)


def camera(
    place: FloatArray, angle: float, scale: float, tilt: FloatArray, shape: tuple[int, int]
) -> FloatArray:
    """float64[3, 3], pixels of a picture to the ground: turned, scaled and tilted about its middle."""
    height, width = shape
    cos, sin = scale * np.cos(angle), scale * np.sin(angle)
    turn = np.array([[cos, -sin, place[0]], [sin, cos, place[1]], [0, 0, 1]])
    lean = np.eye(3)
    lean[2, :2] = tilt
    return turn @ lean @ np.array([[1, 0, -(width - 1) / 2], [0, 1, -(height - 1) / 2], [0, 0, 1]])


@dataclass(frozen=True, eq=False)
class Flight:
    """Pictures over a ground.

    Attributes:
        ground: uint8[h, w] or uint8[h, w, 3].
        to_ground: float64[n, 3, 3].
        shape: (height, width) of the pictures.
        cars: float64[m, 4], place and step per picture, ground px.
        seed: of the sensor's noise.
        noise: its deviation, grey levels.
    """

    ground: PictureArray
    to_ground: FloatArray
    shape: tuple[int, int]
    cars: FloatArray
    seed: int
    noise: float = 3.0

    def picture(self, index: int) -> PictureArray:
        """Picture `index`, like the ground."""
        matrix = np.linalg.inv(self.to_ground[index])
        size = self.shape[1], self.shape[0]
        view = cv2.warpPerspective(self.ground, matrix, size, borderMode=cv2.BORDER_REFLECT)
        for x, y, across, down in self.cars:
            place = np.array([x + across * index, y + down * index])
            box = cv2.boxPoints((tuple(place), (26, 12), float(np.degrees(np.arctan2(down, across)))))
            outline = cv2.perspectiveTransform(box[np.newaxis].astype(float), matrix)
            cv2.fillConvexPoly(view, np.rint(outline[0] * 16).astype(np.int32), (235,) * 3, cv2.LINE_AA, 4)
        random = np.random.default_rng((self.seed, index))
        noisy = view + self.noise * random.standard_normal(view.shape, dtype=np.float32)
        return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)

    def corner_error(self, measured: FloatArray, index: int, target: int) -> float:
        """Worst distance of the corners of `index` from their true places in picture `target`, px."""
        height, width = self.shape
        outline = np.array([[[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]]], dtype=float)
        true = np.linalg.inv(self.to_ground[target]) @ self.to_ground[index]
        apart = cv2.perspectiveTransform(outline, true) - cv2.perspectiveTransform(outline, measured)
        return float(np.linalg.norm(apart, axis=2).max())


def wandering(ground: PictureArray, count: int, shape: tuple[int, int], seed: int, cars: int = 6) -> Flight:
    """A smooth path with turning, climbing, tilting and shaking; `cars` drive through the view."""
    random = np.random.default_rng(seed)
    height, width = shape
    size = np.array([ground.shape[1], ground.shape[0]])
    free = np.maximum((size - [width, height]) / 2 * 0.45, 0)
    phase = random.uniform(0, 2 * np.pi, 4)
    matrices = []
    for index in range(count):
        time = 2 * np.pi * index / 400
        place = size / 2 + free * [np.sin(time + phase[0]), np.sin(2 * time + phase[1])]
        tilt = 1e-5 * np.array([np.sin(5 * time + phase[2]), np.cos(4 * time + phase[3])])
        matrices.append(
            camera(
                place + random.normal(0, 1.5, 2),
                0.25 * np.sin(2 * time + phase[2]) + random.normal(0, 0.002),
                1 + 0.1 * np.sin(3 * time + phase[3]) + random.normal(0, 0.001),
                tilt,
                shape,
            )
        )
    middle = (matrices[0] @ [(width - 1) / 2, (height - 1) / 2, 1])[:2]
    starts = middle + random.uniform(-0.4, 0.4, (cars, 2)) * [width, height]
    steps = random.uniform(-3, 3, (cars, 2))
    return Flight(ground, np.array(matrices), shape, np.hstack([starts, steps]), seed)


def rows(ground: PictureArray, per_row: int, count: int, shape: tuple[int, int], seed: int) -> Flight:
    """Strips flown there and back, as a survey flies them, with a little turn, climb and tilt."""
    random = np.random.default_rng(seed)
    height, width = shape
    size = np.array([ground.shape[1], ground.shape[0]])
    lines = -(-count // per_row)
    reach = np.minimum(size - [width, height] - 60, [per_row * width * 0.22, lines * height * 0.3])
    matrices = []
    for index in range(count):
        row, column = divmod(index, per_row)
        column = column if row % 2 == 0 else per_row - 1 - column
        share = np.array([column / max(1, per_row - 1), row / max(1, lines - 1)]) - 0.5
        place = size / 2 + share * reach + random.normal(0, 6, 2)
        matrices.append(
            camera(
                place, random.normal(0, 0.02), 1 + random.normal(0, 0.01), random.normal(0, 1e-5, 2), shape
            )
        )
    return Flight(ground, np.array(matrices), shape, np.zeros((0, 4)), seed)
