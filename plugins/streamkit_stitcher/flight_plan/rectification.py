"""Frames of a camera undistorted, levelled by the attitude of aircraft and gimbal, and cropped alike."""

import math
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from streamkit.geometry.camera import rotation_matrix
from streamkit.geometry.homography import FloatArray, centre, corners, normalised, project, translation

Maps = tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]
PixelArray = npt.NDArray[np.uint8]

# Points on each side of a frame's border: about one per px.
_BORDER_STEPS: Final = 2048
_MAX_TILT: Final = math.radians(45)
# Directions of the largest tilt at which the crop is measured.
_DIRECTIONS: Final = 8
STRAIGHT_DOWN = (0.0, -math.pi / 2, 0.0)
"""Azimuth, elevation and roll of a sensor that looks straight down."""


@dataclass(frozen=True)
class CameraIntrinsics:
    """Intrinsic parameters of a camera.

    Attributes:
        focal_px: focal length, px.
        principal: x y of the principal point, px; None for the centre of the frame.
        distortion: k1, k2, p1, p2, k3 of Brown's model, in OpenCV's order.
    """

    focal_px: float
    principal: tuple[float, float] | None = None
    distortion: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)

    def matrix(self, shape: tuple[int, int]) -> FloatArray:
        """The camera matrix for frames of `shape` (height, width), float64[3, 3]."""
        x, y = self.principal or centre(shape)
        return np.array([[self.focal_px, 0, x], [0, self.focal_px, y], [0, 0, 1.0]])


def camera_tilt(pitch: float, roll: float, sensor_angles: tuple[float, float, float]) -> tuple[float, float]:
    """The tilt of a camera about its image axes, as `levelling` removes it.

    Args:
        pitch: of the platform, nose up positive, rad.
        roll: of the platform, right wing down positive, rad.
        sensor_angles: azimuth, elevation and roll of the sensor relative to the platform, rad.

    Returns:
        Roll and pitch of the camera, rad: zero for one that looks straight down, at any heading.

    Source: MISB ST 0601, tags 6, 7 and 18 to 20, for the signs of the angles.
    """
    azimuth, elevation, turn = sensor_angles
    # The axes of both bodies are forward, right, down; the camera's forward is its optical axis.
    sensor = rotation_matrix(0.0, pitch, roll) @ rotation_matrix(azimuth, elevation, turn)
    forward, right, down = sensor[2]
    along = math.atan2(down, forward)
    return math.atan2(-right, math.hypot(down, forward)), along


def levelling(camera: CameraIntrinsics, shape: tuple[int, int], roll: float, pitch: float) -> FloatArray:
    """The homography from an undistorted frame to one of the same camera looking straight down.

    Args:
        camera: the intrinsic parameters.
        shape: of the frame.
        roll: about the image's y axis, right side down positive, rad.
        pitch: about the image's x axis, top of the frame up positive, rad.

    Raises:
        ValueError: the tilt exceeds 45 degrees, where the horizon may be in view.
    """
    if not math.hypot(roll, pitch) <= _MAX_TILT:
        raise ValueError(
            f"a frame can be levelled up to 45 degrees, got roll {math.degrees(roll):.1f} and pitch "
            f"{math.degrees(pitch):.1f} degrees"
        )
    about_x, _ = cv2.Rodrigues(np.array([pitch, 0.0, 0.0]))
    about_y, _ = cv2.Rodrigues(np.array([0.0, roll, 0.0]))
    inner = camera.matrix(shape)
    return normalised(inner @ np.asarray(about_y @ about_x) @ np.linalg.inv(inner))


class Rectifier:
    """Rectifies frames up to a maximal tilt; all have the same size.

    Args:
        camera: intrinsic parameters of the camera.
        shape: (height, width) of its frames, px.
        aspect: width over height of the crop.
        max_tilt: tilt up to which the crop is filled, rad.

    Attributes:
        size: width and height of the rectified frames, px, both even.

    Raises:
        ValueError: nothing can be cropped, or the tilt exceeds 45 degrees.
    """

    def __init__(
        self, camera: CameraIntrinsics, shape: tuple[int, int], aspect: float, max_tilt: float
    ) -> None:
        self._camera, self._shape, self._aspect, self._max_tilt = camera, shape, aspect, max_tilt
        turns = np.arange(_DIRECTIONS) * (2 * math.pi / _DIRECTIONS)
        tilts = [(0.0, 0.0), *((max_tilt * math.cos(turn), max_tilt * math.sin(turn)) for turn in turns)]
        width = min(self._crop(levelling(camera, shape, *tilt))[2] for tilt in tilts)
        sides = (width, width / aspect) if math.isfinite(width) else (0.0, 0.0)
        self.size: tuple[int, int] = 2 * int(sides[0] / 2), 2 * int(sides[1] / 2)
        if min(self.size) < 2:
            raise ValueError(
                f"nothing can be cut out of {shape[1]} x {shape[0]} px at a tilt of "
                f"{math.degrees(max_tilt):.1f} degrees: check the camera's focal length and distortion"
            )
        self._tilt: tuple[float, float] | None = None

    def can_level(self, roll: float, pitch: float) -> bool:
        """Whether a tilt, rad, is within the maximum."""
        return math.hypot(roll, pitch) <= self._max_tilt + 1e-9

    def maps(self, roll: float, pitch: float) -> Maps:
        """Source position of each pixel of the rectified frame, float32[h, w] columns and rows.

        Roll and pitch are as in `levelling`, rad, limited to the maximal tilt.
        """
        share = min(1.0, self._max_tilt / max(1e-12, math.hypot(roll, pitch)))
        tilt = (share * roll, share * pitch)
        if tilt != self._tilt:
            to_level = levelling(self._camera, self._shape, *tilt)
            left, top, width, height = self._crop(to_level)
            shift = np.array([left + (width - self.size[0]) / 2, top + (height - self.size[1]) / 2])
            self._maps = rectification_maps(self._camera, self._shape, to_level, self.size, shift)
            self._tilt = tilt
        return self._maps

    def _crop(self, to_level: FloatArray) -> tuple[float, float, float, float]:
        return inscribed_rectangle(rectified_border(self._camera, self._shape, to_level), self._aspect)


def rectification_maps(
    camera: CameraIntrinsics,
    shape: tuple[int, int],
    to_level: FloatArray,
    size: tuple[int, int],
    shift: FloatArray,
) -> Maps:
    """Source position of each pixel of the rectified frame, float32[h, w] columns and rows for `cv2.remap`.

    Args:
        camera: the intrinsic parameters.
        shape: of the source frame.
        to_level: the undistorted frame to the levelled one.
        size: (width, height) of the rectified frame.
        shift: float64[2], x y of its first pixel in the levelled frame.
    """
    inner = camera.matrix(shape)
    whole = translation(-shift) @ to_level @ inner
    columns, rows = cv2.initUndistortRectifyMap(
        inner, np.array(camera.distortion), np.eye(3), whole, size, cv2.CV_32FC1
    )
    return np.asarray(columns, dtype=np.float32), np.asarray(rows, dtype=np.float32)


def rectified_border(camera: CameraIntrinsics, shape: tuple[int, int], to_level: FloatArray) -> FloatArray:
    """The border of the source frame in the levelled one, float64[n, 2], clockwise."""
    outline = corners(shape)
    steps = np.arange(_BORDER_STEPS)[:, np.newaxis] / _BORDER_STEPS
    border = np.concatenate(
        [outline[side] + steps * (outline[(side + 1) % 4] - outline[side]) for side in range(4)]
    )
    inner = camera.matrix(shape)
    straight = cv2.undistortPoints(border[np.newaxis], inner, np.array(camera.distortion), P=inner)
    return project(to_level, np.asarray(straight, dtype=np.float64).reshape(-1, 2))


def inscribed_rectangle(border: FloatArray, aspect: float) -> tuple[float, float, float, float]:
    """The largest upright rectangle that no point of a dense border lies in: left, top, width and height.

    It has the border's centre; `aspect` is width over height.
    """
    middle = (border.max(axis=0) + border.min(axis=0)) / 2
    half = np.array([aspect, 1.0]) * (np.abs(border - middle) / [aspect, 1.0]).max(axis=1).min()
    (left, top), (width, height) = (middle - half).tolist(), (2 * half).tolist()
    return left, top, width, height


def resampled(plane: PixelArray, maps: Maps) -> PixelArray:
    """Resamples uint8[h, w] or uint8[h, w, 3] by `Rectifier.maps`."""
    warped = cv2.remap(plane, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(warped, dtype=np.uint8)


def halved_maps(maps: Maps) -> Maps:
    """The maps for planes of half the width and height, as the chroma of I420."""
    height, width = maps[0].shape
    columns, rows = (
        (cv2.resize(one, (width // 2, height // 2), interpolation=cv2.INTER_AREA) - 0.5) / 2 for one in maps
    )
    return np.asarray(columns, dtype=np.float32), np.asarray(rows, dtype=np.float32)
