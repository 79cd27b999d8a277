"""The rendered world: one frame after another, each with its truth."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from streamkit_video.dronetestsrc.camera import CameraPath, plan_path
from streamkit_video.dronetestsrc.cars import LOOK_AHEAD, Traffic, start_traffic
from streamkit_video.dronetestsrc.sprites import (
    COLOURS,
    SHADOW_OFFSET,
    CarSprite,
    draw_body,
    draw_shadow,
    paint_car,
)
from streamkit_video.dronetestsrc.truth import TrueRegistration, TrueTargets

FloatArray = NDArray[np.float64]
ByteArray = NDArray[np.uint8]

SMALLEST_PICTURE = 64
NOISE_PLACES = 1 << 21


@dataclass(frozen=True, slots=True)
class WorldSettings:
    """What a world is made of.

    Attributes:
        cars: number of cars.
        seed: of everything that is drawn at random.
        noise: standard deviation of the sensor's noise, grey levels.
        jitter: standard deviation of the camera's shake, px.
        speed: top speed of the camera along either axis of the ground, px per frame.
        frame_rate: frames per second, for velocities; motion is the same per frame at any rate.
    """

    cars: int = 12
    seed: int = 0
    noise: float = 2.0
    jitter: float = 0.5
    speed: float = 4.0
    frame_rate: float = 25.0


@dataclass(frozen=True, slots=True, eq=False)
class RenderedFrame:
    """One frame: uint8[h, w] or [h, w, 3] like the ground, and what it is known to show."""

    picture: ByteArray
    registration: TrueRegistration
    targets: TrueTargets


class World:
    """A camera that flies over a picture of the ground, with cars below.

    The same ground, size and settings give the same frames, bit for bit.

    Args:
        ground: uint8[h, w] grey or uint8[h, w, 3] BGR; read only.
        frame_size: width, height, px.
        settings: what the world is made of.

    Raises:
        ValueError: the ground is smaller than 64x64.
    """

    def __init__(self, ground: ByteArray, frame_size: tuple[int, int], settings: WorldSettings) -> None:
        height, width = ground.shape[:2]
        if min(width, height) < SMALLEST_PICTURE:
            raise ValueError(
                f"the picture of the ground must be at least {SMALLEST_PICTURE}x{SMALLEST_PICTURE} px, "
                f"got {width}x{height}: take a larger one"
            )
        self._ground = ground
        self._frame_size = frame_size
        self._settings = settings
        self._path: CameraPath = plan_path(
            (width, height), frame_size, seed=settings.seed, speed=settings.speed, jitter=settings.jitter
        )
        scale = self._path.ground_scale
        self._traffic: Traffic = start_traffic(
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
            _scaled(self._previous_from_ground @ ground_from_frame),
            _scaled(self._first_from_ground @ ground_from_frame),
        )
        frame = RenderedFrame(
            self._render(ground_from_frame, frame_from_ground), registration, self._truth(frame_from_ground)
        )
        self._previous_from_ground = frame_from_ground
        self._index += 1
        self._traffic.step(self._path.ground_from_frame(self._index + LOOK_AHEAD, shaken=False))
        return frame

    def _paint_cars(self, channels: int) -> list[CarSprite]:
        traffic, scale = self._traffic, self._path.ground_scale
        offset = int(np.random.default_rng((self._settings.seed, 3)).integers(len(COLOURS)))
        return [
            paint_car(
                float(traffic.lengths[car]) / scale,
                float(traffic.widths[car]) / scale,
                COLOURS[(car + offset) % len(COLOURS)],
                scale,
                channels,
            )
            for car in range(len(traffic))
        ]

    def _render(self, ground_from_frame: FloatArray, frame_from_ground: FloatArray) -> ByteArray:
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        picture: ByteArray = np.asarray(
            cv2.warpPerspective(
                self._ground,
                ground_from_frame,
                self._frame_size,
                flags=flags,
                borderMode=cv2.BORDER_REPLICATE,
            )
        )
        shadow = np.array(SHADOW_OFFSET) * self._path.ground_scale
        places = list(zip(self._sprites, self._traffic.positions, self._traffic.headings, strict=True))
        for sprite, position, heading in places:
            draw_shadow(picture, sprite, frame_from_ground @ _pose(position + shadow, heading))
        for sprite, position, heading in places:
            draw_body(picture, sprite, frame_from_ground @ _pose(position, heading))
        self._noise.add_to(picture)
        return picture

    def _truth(self, frame_from_ground: FloatArray) -> TrueTargets:
        traffic, scale = self._traffic, self._settings.frame_rate
        along = np.stack([np.cos(traffic.headings), np.sin(traffic.headings)], axis=1)
        across = np.stack([-along[:, 1], along[:, 0]], axis=1)
        ends, sides = along * traffic.lengths[:, None] / 2.0, across * traffic.widths[:, None] / 2.0
        centres, jacobians = _project(frame_from_ground, traffic.positions)
        whole = np.ones(len(traffic), dtype=bool)
        for corner in (ends + sides, ends - sides, -ends + sides, -ends - sides):
            points = _project(frame_from_ground, traffic.positions + corner)[0]
            whole &= ((points >= 0.0) & (points <= np.array(self._frame_size) - 1.0)).all(axis=1)
        forward = np.einsum("nij,nj->ni", jacobians, along)
        sideways = np.einsum("nij,nj->ni", jacobians, across)
        stretch = np.hypot(forward[:, 0], forward[:, 1])
        return TrueTargets(
            ids=np.flatnonzero(whole),
            centres=centres[whole],
            lengths=(stretch * traffic.lengths)[whole],
            widths=(np.hypot(sideways[:, 0], sideways[:, 1]) * traffic.widths)[whole],
            angles=np.arctan2(forward[:, 1], forward[:, 0])[whole],
            velocities=(forward * traffic.speeds[:, None] * scale)[whole],
        )


class SensorNoise:
    """White noise of whole grey levels, near normal: each value is one of 256 quantiles.

    Frames take their noise from random places of one long table, as drawing it anew would cost more than all
    else: two frames have the same values, but at other pixels.
    """

    def __init__(self, sigma: float, seed: int) -> None:
        quantiles = ndtri((np.arange(256) + 0.5) / 256.0)
        levels = np.rint(sigma * quantiles / quantiles.std())
        self._sigma = sigma
        self._levels = (128 + levels.clip(-128, 127)).astype(np.uint8)
        self._random = np.random.default_rng((seed, 4))
        self._table: ByteArray = np.empty(0, np.uint8)

    def add_to(self, picture: ByteArray) -> None:
        """Adds noise to a picture in place, cut at 0 and 255."""
        if self._sigma <= 0.0:
            return
        if self._table.size < picture.size + NOISE_PLACES:
            draws = self._random.integers(0, 256, (1, picture.size + NOISE_PLACES), dtype=np.uint8)
            self._table = np.asarray(cv2.LUT(draws, self._levels), np.uint8)[0]
        place = int(self._random.integers(NOISE_PLACES))
        noise = self._table[place : place + picture.size].reshape(picture.shape)
        cv2.addWeighted(picture, 1.0, noise, 1.0, -128.0, dst=picture)


def _inverse(homography: FloatArray) -> FloatArray:
    return _scaled(np.asarray(np.linalg.inv(homography), np.float64))


def _scaled(homography: FloatArray) -> FloatArray:
    return np.asarray(homography / homography[2, 2])


def _pose(position: FloatArray, heading: float) -> FloatArray:
    """float64[3, 3] from a car's own axes to the ground."""
    cos, sin = np.cos(heading), np.sin(heading)
    return np.array([[cos, -sin, position[0]], [sin, cos, position[1]], [0.0, 0.0, 1.0]])


def _project(homography: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Maps points: float64[n, 2] images, and float64[n, 2, 2] derivatives there."""
    homogeneous = points @ homography[:, :2].T + homography[:, 2]
    depth = homogeneous[:, 2:]
    images = homogeneous[:, :2] / depth
    derivatives = (homography[None, :2, :2] - images[:, :, None] * homography[None, 2:, :2]) / depth[
        :, :, None
    ]
    return images, derivatives
