"""Renders frames of the simulated world, each with its ground truth."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import scipy
from numpy.typing import NDArray

from streamkit.geometry.homography import normalised, project
from streamkit.settings import setting
from streamkit_video.dronetestsrc import sprites
from streamkit_video.dronetestsrc.camera import CameraPath
from streamkit_video.dronetestsrc.cars import LOOK_AHEAD, Traffic
from streamkit_video.dronetestsrc.truth import TrueRegistration, TrueTargets

FloatArray = NDArray[np.float64]
ByteArray = NDArray[np.uint8]

MIN_GROUND_SIDE = 64
NOISE_OFFSETS = 1 << 21


@dataclass(frozen=True, slots=True)
class WorldSettings:
    """Settings of a simulated world.

    Attributes:
        frame_rate: frames per second, for velocities; motion per frame is the same at any rate.
    """

    cars: int = setting(12, min=0, max=200, doc="Number of cars.")
    seed: int = setting(0, min=0, doc="Seed of the flight and the cars.")
    noise: float = setting(
        2.0, min=0.0, max=40.0, unit="grey levels", doc="Standard deviation of the sensor noise."
    )
    jitter: float = setting(
        0.5, min=0.0, max=20.0, unit="px", doc="Standard deviation of the camera jitter from frame to frame."
    )
    speed: float = setting(
        4.0, min=0.0, max=40.0, unit="px/frame", doc="Maximum camera speed along either ground axis."
    )
    frame_rate: float = 25.0


@dataclass(frozen=True, slots=True, eq=False)
class RenderedFrame:
    """A frame, uint8[h, w] or [h, w, 3] like the ground image, and its ground truth."""

    image: ByteArray
    registration: TrueRegistration
    targets: TrueTargets


class World:
    """A camera that flies over a ground image with moving cars.

    The same ground, size and settings give the same frames, bit for bit.

    Args:
        ground: uint8[h, w] grey or uint8[h, w, 3] BGR.
        frame_size: width, height, px.
        settings: cars, noise and motion.

    Raises:
        ValueError: the ground is smaller than 64x64.
    """

    def __init__(self, ground: ByteArray, frame_size: tuple[int, int], settings: WorldSettings) -> None:
        height, width = ground.shape[:2]
        if min(width, height) < MIN_GROUND_SIDE:
            raise ValueError(
                f"the image of the ground must be at least {MIN_GROUND_SIDE}x{MIN_GROUND_SIDE} px, "
                f"got {width}x{height}: take a larger one"
            )
        self._ground = ground
        self._frame_size = frame_size
        self._settings = settings
        self._path = CameraPath(
            (width, height), frame_size, seed=settings.seed, speed=settings.speed, jitter=settings.jitter
        )
        scale = self._path.ground_scale
        self._traffic = Traffic(
            settings.cars, frame_size, self._path.ground_from_frame(0), scale, settings.seed
        )
        self._sprites = self._paint_cars(1 if ground.ndim == 2 else 3)
        self._noise = SensorNoise(settings.noise, settings.seed)
        self._index = 0
        self._first_from_ground = _inverse(self._path.ground_from_frame(0))
        self._previous_from_ground = self._first_from_ground

    def next_frame(self) -> RenderedFrame:
        """Renders the next frame."""
        ground_from_frame = self._path.ground_from_frame(self._index)
        frame_from_ground = _inverse(ground_from_frame)
        registration = TrueRegistration(
            normalised(self._previous_from_ground @ ground_from_frame),
            normalised(self._first_from_ground @ ground_from_frame),
        )
        frame = RenderedFrame(
            self._render(ground_from_frame, frame_from_ground), registration, self._truth(frame_from_ground)
        )
        self._previous_from_ground = frame_from_ground
        self._index += 1
        self._traffic.step(self._path.ground_from_frame(self._index + LOOK_AHEAD, shaken=False))
        return frame

    def _paint_cars(self, channels: int) -> list[sprites.CarSprite]:
        scale = self._path.ground_scale
        sizes = zip(self._traffic.lengths / scale, self._traffic.widths / scale, strict=True)
        offset = int(np.random.default_rng((self._settings.seed, 3)).integers(len(sprites.COLOURS)))
        return [
            sprites.paint_car(
                float(length),
                float(width),
                sprites.COLOURS[(car + offset) % len(sprites.COLOURS)],
                scale,
                channels,
            )
            for car, (length, width) in enumerate(sizes)
        ]

    def _render(self, ground_from_frame: FloatArray, frame_from_ground: FloatArray) -> ByteArray:
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        warped = cv2.warpPerspective(
            self._ground, ground_from_frame, self._frame_size, flags=flags, borderMode=cv2.BORDER_REPLICATE
        )
        image: ByteArray = np.asarray(warped)
        shadow = np.array(sprites.SHADOW_OFFSET) * self._path.ground_scale
        cars = list(zip(self._sprites, self._traffic.positions, self._traffic.headings, strict=True))
        for sprite, position, heading in cars:
            sprite.draw(sprite.shadow, image, frame_from_ground @ _car_to_ground(position + shadow, heading))
        for sprite, position, heading in cars:
            sprite.draw(sprite.body, image, frame_from_ground @ _car_to_ground(position, heading))
        self._noise.add_to(image)
        return image

    def _truth(self, frame_from_ground: FloatArray) -> TrueTargets:
        traffic, rate = self._traffic, self._settings.frame_rate
        along = np.stack([np.cos(traffic.headings), np.sin(traffic.headings)], axis=1)
        across = np.stack([-along[:, 1], along[:, 0]], axis=1)
        ends, sides = along * traffic.lengths[:, None] / 2.0, across * traffic.widths[:, None] / 2.0
        whole = np.ones(len(traffic), dtype=bool)
        for corner in (ends + sides, ends - sides, -ends + sides, -ends - sides):
            points = project(frame_from_ground, traffic.positions + corner)
            whole &= ((points >= 0.0) & (points <= np.array(self._frame_size) - 1.0)).all(axis=1)
        centres = project(frame_from_ground, traffic.positions)
        jacobians = _jacobians(frame_from_ground, traffic.positions, centres)
        forward = np.einsum("nij,nj->ni", jacobians, along)
        sideways = np.einsum("nij,nj->ni", jacobians, across)
        stretch = np.hypot(forward[:, 0], forward[:, 1])
        return TrueTargets(
            ids=np.flatnonzero(whole),
            centres=centres[whole],
            lengths=(stretch * traffic.lengths)[whole],
            widths=(np.hypot(sideways[:, 0], sideways[:, 1]) * traffic.widths)[whole],
            angles=np.arctan2(forward[:, 1], forward[:, 0])[whole],
            velocities=(forward * traffic.speeds[:, None] * rate)[whole],
        )


class SensorNoise:
    """White noise in whole grey levels, nearly normal: each value is one of 256 quantiles.

    A frame takes its noise from a random offset of one long table, much cheaper than drawing new noise: two
    frames have the same values at different pixels.
    """

    def __init__(self, sigma: float, seed: int) -> None:
        quantiles = scipy.special.ndtri((np.arange(256) + 0.5) / 256.0)
        levels = np.rint(sigma * quantiles / quantiles.std())
        self._sigma = sigma
        self._levels = (128 + levels.clip(-128, 127)).astype(np.uint8)
        self._random = np.random.default_rng((seed, 4))
        self._table: ByteArray = np.empty(0, np.uint8)

    def add_to(self, image: ByteArray) -> None:
        """Adds noise to an image in place, clipped to 0 and 255."""
        if self._sigma <= 0.0:
            return
        if self._table.size < image.size + NOISE_OFFSETS:
            draws = self._random.integers(0, 256, (1, image.size + NOISE_OFFSETS), dtype=np.uint8)
            self._table = np.asarray(cv2.LUT(draws, self._levels), np.uint8)[0]
        offset = int(self._random.integers(NOISE_OFFSETS))
        noise = self._table[offset : offset + image.size].reshape(image.shape)
        cv2.addWeighted(image, 1.0, noise, 1.0, -128.0, dst=image)


def _inverse(homography: FloatArray) -> FloatArray:
    return normalised(np.asarray(np.linalg.inv(homography), np.float64))


def _car_to_ground(position: FloatArray, heading: float) -> FloatArray:
    """float64[3, 3] from a car's own axes to the ground."""
    cos, sin = np.cos(heading), np.sin(heading)
    return np.array([[cos, -sin, position[0]], [sin, cos, position[1]], [0.0, 0.0, 1.0]])


def _jacobians(homography: FloatArray, points: FloatArray, projected: FloatArray) -> FloatArray:
    """Derivatives float64[n, 2, 2] of a homography at points float64[n, 2], given their projections."""
    depth = points @ homography[2, :2] + homography[2, 2]
    outer = projected[:, :, None] * homography[None, 2:, :2]
    return np.asarray((homography[None, :2, :2] - outer) / depth[:, None, None])
