"""The path of the camera: where each frame lies on the picture of the ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

TURN = np.deg2rad(20.0)
"""The heading swings this far to either side, rad."""
ZOOM = 0.12
"""The altitude swings by this share to either side."""
TILT = 0.03
"""Largest change of scale from the middle to the edge of a frame that the tilt makes."""
REACH_OF_VIEW = 0.75
"""The view takes at most this share of the picture, so that the camera has room to travel."""
SWING_PERIODS = (733.0, 941.0, 577.0, 811.0)
"""Periods of heading, altitude, pitch and roll, frames: primes, so that they repeat together very late."""
GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0
JITTER_LIMIT = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class CameraPath:
    """A smooth path that never shows anything beyond the picture, for any number of frames.

    The middle of the view follows a Lissajous figure whose two rates have the golden ratio, so that it never
    closes; heading, altitude, pitch and roll swing; jitter is white from frame to frame.

    Attributes:
        frame_size: width, height, px.
        middle: float64[2], middle of the picture, ground px.
        reach: float64[2], how far the middle of the view travels to either side, ground px.
        rates: float64[2], of the figure, rad per frame.
        phases: float64[6], of x, y, heading, altitude, pitch, roll, rad.
        ground_scale: ground px per frame px at mean altitude.
        jitter: standard deviation of the shake, frame px.
        seed: of the jitter.
    """

    frame_size: tuple[int, int]
    middle: FloatArray
    reach: FloatArray
    rates: FloatArray
    phases: FloatArray
    ground_scale: float
    jitter: float
    seed: int

    def ground_from_frame(self, index: int, *, shaken: bool = True) -> FloatArray:
        """The homography from pixels of a frame to pixels of the picture.

        Args:
            index: number of the frame, from 0.
            shaken: with the jitter of this frame.

        Returns:
            float64[3, 3], last element 1.
        """
        width, height = self.frame_size
        swings = np.sin(2.0 * np.pi * index / np.array(SWING_PERIODS) + self.phases[2:])
        place = self.middle + self.reach * np.sin(self.rates * index + self.phases[:2])
        angle, scale = TURN * swings[0], self.ground_scale * (1.0 + ZOOM * swings[1])
        if shaken and self.jitter > 0.0:
            shake = (
                np.random.default_rng((self.seed, 1, index))
                .standard_normal(3)
                .clip(-JITTER_LIMIT, JITTER_LIMIT)
            )
            place = place + self.jitter * scale * shake[:2]
            angle += self.jitter / max(width, height) * shake[2]
        cos, sin = scale * np.cos(angle), scale * np.sin(angle)
        moved = np.array([[cos, -sin, place[0]], [sin, cos, place[1]], [0.0, 0.0, 1.0]])
        tilted = np.eye(3)
        tilted[2, :2] = TILT * swings[2:] / (width, height)
        centred = np.eye(3)
        centred[:2, 2] = -(width - 1) / 2.0, -(height - 1) / 2.0
        homography = moved @ tilted @ centred
        return np.asarray(homography / homography[2, 2])


def plan_path(
    picture_size: tuple[int, int], frame_size: tuple[int, int], *, seed: int, speed: float, jitter: float
) -> CameraPath:
    """A path over a picture for a camera.

    One frame pixel covers one picture pixel at mean altitude, less where the picture is too small for that.

    Args:
        picture_size: width, height of the picture of the ground, px.
        frame_size: width, height of the frames, px.
        seed: of the phases and the jitter.
        speed: top speed along either axis of the picture, frame px per frame.
        jitter: standard deviation of the shake, frame px.
    """
    picture = np.array(picture_size, dtype=np.float64)
    half_view = _half_view(frame_size, jitter)
    ground_scale = float(min(1.0, (REACH_OF_VIEW * picture / (2.0 * half_view)).min()))
    reach = (picture - 1.0) / 2.0 - ground_scale * half_view
    rates = speed * ground_scale / float(reach.max()) * np.array([1.0, GOLDEN])
    phases = np.random.default_rng((seed, 0)).uniform(0.0, 2.0 * np.pi, 6)
    return CameraPath(frame_size, (picture - 1.0) / 2.0, reach, rates, phases, ground_scale, jitter, seed)


def _half_view(frame_size: tuple[int, int], jitter: float) -> FloatArray:
    """Half of the upright rectangle that holds the view whatever the camera does, frame px."""
    half_width, half_height = frame_size[0] / 2.0, frame_size[1] / 2.0
    angles = np.linspace(0.0, TURN + JITTER_LIMIT * jitter / max(frame_size), 65)
    across = (half_width * np.cos(angles) + half_height * np.sin(angles)).max()
    along = (half_width * np.sin(angles) + half_height * np.cos(angles)).max()
    swell = (1.0 + ZOOM) / (1.0 - TILT)
    # Two pixels for the interpolation at the border.
    return np.array([across, along]) * swell + (1.0 + ZOOM) * JITTER_LIMIT * jitter + 2.0
