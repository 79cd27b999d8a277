"""The camera path: the homography of each frame to the ground image."""

from __future__ import annotations

import numpy as np

from streamkit.geometry.homography import FloatArray, centre, normalised, translation

TURN = np.deg2rad(20.0)  # amplitude of the heading, rad
ZOOM = 0.12  # relative amplitude of the altitude
TILT = 0.03  # largest change of scale from the centre to the edge of a frame due to tilt
MAX_VIEW_SHARE = 0.75  # largest share of the ground image in view, so that the camera can travel
# Periods of heading, altitude, pitch and roll, frames: primes, so that their combination repeats late.
PERIODS = (733.0, 941.0, 577.0, 811.0)
GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0
JITTER_LIMIT = 3.0


class CameraPath:
    """A smooth path of any length whose view stays within the ground image.

    The view centre follows a Lissajous figure whose two rates have the golden ratio, so that it never closes;
    heading, altitude, pitch and roll oscillate; jitter is white from frame to frame. A frame pixel covers one
    ground pixel at mean altitude, less where the ground image is too small for that.

    Args:
        ground_size: width, height of the ground image, px.
        frame_size: width, height of the frames, px.
        seed: of the phases and the jitter.
        speed: maximum speed along either ground axis, frame px per frame.
        jitter: standard deviation of the jitter, frame px.

    Attributes:
        ground_scale: ground px per frame px at mean altitude.
    """

    def __init__(
        self,
        ground_size: tuple[int, int],
        frame_size: tuple[int, int],
        *,
        seed: int,
        speed: float,
        jitter: float,
    ) -> None:
        ground = np.array(ground_size, dtype=np.float64)
        half_view = _half_view(frame_size, jitter)
        self.ground_scale = float(min(1.0, (MAX_VIEW_SHARE * ground / (2.0 * half_view)).min()))
        self._frame_size, self._seed, self._jitter = frame_size, seed, jitter
        self._middle = (ground - 1.0) / 2.0
        self._reach = self._middle - self.ground_scale * half_view
        self._rates = speed * self.ground_scale / float(self._reach.max()) * np.array([1.0, GOLDEN])
        # Of x, y, heading, altitude, pitch and roll.
        self._phases = np.random.default_rng((seed, 0)).uniform(0.0, 2.0 * np.pi, 6)

    def ground_from_frame(self, index: int, *, shaken: bool = True) -> FloatArray:
        """The homography from pixels of frame `index` to ground pixels, float64[3, 3], last element 1.

        `shaken` includes the jitter of this frame.
        """
        width, height = self._frame_size
        swings = np.sin(2.0 * np.pi * index / np.array(PERIODS) + self._phases[2:])
        position = self._middle + self._reach * np.sin(self._rates * index + self._phases[:2])
        angle, scale = TURN * swings[0], self.ground_scale * (1.0 + ZOOM * swings[1])
        if shaken and self._jitter > 0.0:
            random = np.random.default_rng((self._seed, 1, index))
            shake = random.standard_normal(3).clip(-JITTER_LIMIT, JITTER_LIMIT)
            position = position + self._jitter * scale * shake[:2]
            angle += self._jitter / max(width, height) * shake[2]
        cos, sin = scale * np.cos(angle), scale * np.sin(angle)
        pose = np.array([[cos, -sin, position[0]], [sin, cos, position[1]], [0.0, 0.0, 1.0]])
        tilted = np.eye(3)
        tilted[2, :2] = TILT * swings[2:] / (width, height)
        return normalised(pose @ tilted @ translation(-centre((height, width))))


def _half_view(frame_size: tuple[int, int], jitter: float) -> FloatArray:
    """Half of the upright rectangle that contains the view for any pose, frame px."""
    half_width, half_height = frame_size[0] / 2.0, frame_size[1] / 2.0
    angles = np.linspace(0.0, TURN + JITTER_LIMIT * jitter / max(frame_size), 65)
    across = (half_width * np.cos(angles) + half_height * np.sin(angles)).max()
    along = (half_width * np.sin(angles) + half_height * np.cos(angles)).max()
    magnification = (1.0 + ZOOM) / (1.0 - TILT)
    # Two pixels for the interpolation at the border.
    return np.array([across, along]) * magnification + (1.0 + ZOOM) * JITTER_LIMIT * jitter + 2.0
