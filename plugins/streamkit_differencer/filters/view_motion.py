"""How a camera moves over the ground, from the homography of the ground between two of its frames.

The homography of a plane between two views determines the rotation, the translation over the height above the
plane, and the plane's normal, up to two solutions. The normal that a camera sees changes little from frame to
frame: the solution is taken whose normal is nearest to those before.

Source: Malis and Vargas, "Deeper understanding of the homography decomposition for vision-based control",
    INRIA 2007; for points off the plane, Hartley and Zisserman, Multiple View Geometry, section 13.3.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numba import types

from streamkit.geometry.homography import centre, inverse, project
from streamkit_differencer.arrays import FloatArray
from streamkit_differencer.warping import mapped_point
from streamkit_kernels import FLOAT64, FLOAT64_1D, kernel

# Focal length in widths of the frame, of a lens of 24 mm as most drones have. Of 0.4 to 2.0, the ground's
# normal is the steadiest with 0.7 or 0.8 in each of seven clips of such drones.
FOCAL_LENGTH = 0.7
# First normal, to which x points to the right, y downwards and z ahead: 40 degrees from straight down. Both a
# camera that looks there and one that sees the horizon are nearer to it than their other solutions.
FIRST_NORMAL = np.array([0.0, 0.65, 0.76])
# Smaller translations, over the height, are noise. Weight of a frame in the normal, per translation, and the
# largest one.
MIN_TRANSLATION = 0.01
NORMAL_RATE, MAX_NORMAL_RATE = 2.0, 0.1
# Weight of a frame in the translation: cameras shake, but do not change their speed at once.
TRANSLATION_RATE = 0.1
# Smaller motions of the view are noise, px of the canvas.
MIN_STEP_PX = 2.0
# Longer ways are not searched, px of the canvas.
MAX_SHIFT_PX = 40.0


@dataclass(frozen=True, slots=True, eq=False)
class CameraTranslation:
    """The translation of a camera between two frames.

    Attributes:
        epipole: float64[3], in homogeneous pixels of the later frame, over the height above the ground.
        nearness: float64[3]; its product with x, y, 1 of a pixel is the height over the depth of the ground.
    """

    epipole: FloatArray
    nearness: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class ViewMotion:
    """How the view has moved over the ground in the last tau frames.

    Attributes:
        translation: of the camera; None where it is too small, or nothing is tall.
        step: float64[2], the motion of the view's middle, px of the canvas.
        is_flight: whether the view comes to new ground.
        working_to_canvas: float64[3, 3], the frame's pixels to the canvas.
        height: the largest h / (H - h) of tall objects.
    """

    translation: CameraTranslation | None
    step: FloatArray
    is_flight: bool
    working_to_canvas: FloatArray
    height: float

    def shifts(self, points: FloatArray) -> list[FloatArray]:
        """Vectors from points of the canvas to where what shows there may have been tau frames before.

        By parallax, and along the motion of the view: it blurs along it, and is misplaced along it more than
        across.

        Args:
            points: float64[n, 2], px of the canvas.

        Returns:
            float64[n, 2] each, px of the canvas.
        """
        found = []
        if self.translation is not None:
            to_canvas, camera = self.working_to_canvas, self.translation
            view = to_canvas, inverse(to_canvas), camera.epipole, camera.nearness
            found.append(parallax(points, *view, self.height))
        if self.is_flight:
            found.append(np.full_like(points, self.height * self.step))
        return found


@kernel(FLOAT64, FLOAT64, FLOAT64, FLOAT64_1D, FLOAT64_1D, types.float64)
def parallax(
    points: FloatArray,
    to_canvas: FloatArray,
    to_frame: FloatArray,
    epipole: FloatArray,
    nearness: FloatArray,
    height: float,
) -> FloatArray:
    """Vectors from points of the canvas to where tops of tall objects that show there were, float64[n, 2] px.

    Args:
        points: float64[n, 2], px of the canvas.
        to_canvas: float64[3, 3], the later frame's pixels to the canvas.
        to_frame: float64[3, 3], its inverse.
        epipole: float64[3], see `CameraTranslation`, as `nearness`.
        nearness: float64[3].
        height: h / (H - h) of objects of height h under a camera at height H.
    """
    shifts = np.empty_like(points)
    for index in range(len(points)):
        x, y = mapped_point(to_frame, points[index, 0], points[index, 1])
        near = height * max(nearness[0] * x + nearness[1] * y + nearness[2], 0.0)
        x, y = x + near * (epipole[2] * x - epipole[0]), y + near * (epipole[2] * y - epipole[1])
        x, y = mapped_point(to_canvas, x, y)
        x, y = x - points[index, 0], y - points[index, 1]
        share = MAX_SHIFT_PX / max(np.hypot(x, y), MAX_SHIFT_PX)
        shifts[index, 0], shifts[index, 1] = x * share, y * share
    return shifts


@dataclass(slots=True)
class ViewMotionEstimator:
    """Estimates how the view moves, from where the frames of a stream lie on the canvas."""

    _normal: FloatArray = field(default_factory=FIRST_NORMAL.copy)
    # The mean translation, in heights; None before the first.
    _mean: FloatArray | None = None
    # Working pixels to the canvas, of the last frames.
    _positions: list[FloatArray] = field(default_factory=list)

    def restart(self) -> None:
        """Continues on another canvas."""
        self._positions.clear()

    def move(self, change: FloatArray) -> None:
        """Moves the last frames along with the canvas; `change`, float64[3, 3], is old to new."""
        self._positions = [change @ matrix for matrix in self._positions]

    def update(
        self, to_canvas: FloatArray, shape: tuple[int, int], interval: int, height: float
    ) -> ViewMotion:
        """The motion of the view.

        Args:
            to_canvas: float64[3, 3], the frame's pixels to the canvas.
            shape: (height, width) of the frame, px.
            interval: tau, frames.
            height: the largest h / (H - h) of tall objects; 0 where there are none.
        """
        self._positions.append(to_canvas)
        del self._positions[: -interval - 1]
        middle, earlier = centre(shape)[None], self._positions[0]
        step = project(to_canvas, middle)[0] - project(earlier, middle)[0]
        translation = self._translation(inverse(to_canvas) @ earlier, shape) if height > 0.0 else None
        return ViewMotion(translation, step, bool(np.hypot(*step) >= MIN_STEP_PX), to_canvas, height)

    def _translation(self, to_later: FloatArray, shape: tuple[int, int]) -> CameraTranslation | None:
        """The translation between two frames, from the ground's homography; None where it is too small."""
        focal, (x, y) = FOCAL_LENGTH * shape[1], centre(shape)
        camera = np.array([[focal, 0.0, x], [0.0, focal, y], [0.0, 0.0, 1.0]])
        _, _, translations, normals = cv2.decomposeHomographyMat(to_later, camera)
        # Each solution comes with both signs.
        number = max(range(len(normals)), key=lambda number: float(normals[number].ravel() @ self._normal))
        translation, normal = translations[number].ravel(), normals[number].ravel()
        length = float(np.linalg.norm(translation))
        if not length >= MIN_TRANSLATION:
            return None
        rate = min(NORMAL_RATE * length, MAX_NORMAL_RATE)
        mean = self._normal + rate * (normal - self._normal)
        self._normal = mean / np.linalg.norm(mean)
        before = translation if self._mean is None else self._mean
        smooth = np.asarray(before + TRANSLATION_RATE * (translation - before), np.float64)
        self._mean = smooth
        return CameraTranslation(camera @ smooth, normal @ inverse(camera))
