"""Removal of lens distortion and camera tilt from frames, by the attitude of aircraft and gimbal."""

import math
from dataclasses import dataclass, field
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import FloatArray, corners, normalised, project, translation

MapArray = npt.NDArray[np.float32]

_BORDER_STEPS: Final = 64
_LARGEST_TILT: Final = math.radians(45)
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
    distortion: tuple[float, ...] = field(default=(0.0, 0.0, 0.0, 0.0, 0.0))

    def matrix(self, shape: tuple[int, int]) -> FloatArray:
        """The camera matrix for frames of `shape` (height, width), float64[3, 3]."""
        x, y = self.principal or ((shape[1] - 1) / 2, (shape[0] - 1) / 2)
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
    sensor = rotation(pitch, roll, 0.0) @ rotation(elevation, turn, azimuth)
    forward, right, down = sensor[2]
    along = math.atan2(down, forward)
    return math.atan2(-right, math.hypot(down, forward)), along


def rotation(pitch: float, roll: float, yaw: float) -> FloatArray:
    """float64[3, 3], a body's axes (forward, right, down) to its parent's: roll, then pitch, then yaw."""
    (cp, sp), (cr, sr), (cy, sy) = ((math.cos(angle), math.sin(angle)) for angle in (pitch, roll, yaw))
    about_forward = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_right = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_down = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return np.asarray(about_down @ about_right @ about_forward, dtype=np.float64)


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
    if not math.hypot(roll, pitch) <= _LARGEST_TILT:
        raise ValueError(
            f"a frame can be levelled up to 45 degrees, got roll {math.degrees(roll):.1f} and pitch "
            f"{math.degrees(pitch):.1f} degrees"
        )
    about_x, _ = cv2.Rodrigues(np.array([pitch, 0.0, 0.0]))
    about_y, _ = cv2.Rodrigues(np.array([0.0, roll, 0.0]))
    inner = camera.matrix(shape)
    return normalised(inner @ np.asarray(about_y @ about_x) @ np.linalg.inv(inner))


def rectification_maps(
    camera: CameraIntrinsics,
    shape: tuple[int, int],
    to_level: FloatArray,
    size: tuple[int, int],
    shift: FloatArray,
) -> tuple[MapArray, MapArray]:
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
    """The largest upright rectangle inside a border, about its centre: left, top, width and height.

    `border` is star-shaped about its centre; `aspect` is width over height.
    """
    middle = (border.max(axis=0) + border.min(axis=0)) / 2
    arms = border - middle
    after = np.roll(arms, -1, axis=0)
    half_height = math.inf
    for across, down in ((aspect, 1.0), (aspect, -1.0), (-aspect, 1.0), (-aspect, -1.0)):
        # Intersection of the diagonal towards this corner with the border.
        side = after - arms
        determinant = across * -side[:, 1] + down * side[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = (arms[:, 0] * -side[:, 1] + arms[:, 1] * side[:, 0]) / determinant
            share = (across * arms[:, 1] - down * arms[:, 0]) / determinant
        crossed = (reach > 0) & (share >= -1e-9) & (share <= 1 + 1e-9)
        half_height = min(half_height, float(reach[crossed].min(initial=math.inf)))
    # A side may cross the border while the corners are inside.
    bulging = np.maximum(np.abs(arms[:, 0]) / aspect, np.abs(arms[:, 1]))
    half_height = min(half_height, float(bulging.min()))
    half_width = half_height * aspect
    return middle[0] - half_width, middle[1] - half_height, 2 * half_width, 2 * half_height
