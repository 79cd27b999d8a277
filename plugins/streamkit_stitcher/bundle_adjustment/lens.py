"""A lens whose focal length is known: what that says of the homographies of a level plane."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from streamkit.geometry.homography import FloatArray

# Standard deviations: of the shape of a unit square of the plane, by a focal length that is off by a tenth at
# a tilt of 6 deg, by distortion and relief; and of the tilt of a camera that looks straight down, rad.
_SHAPE_STD: Final = 1e-3
_TILT_STD: Final = 0.1
_STEP: Final = 1e-6


@dataclass(frozen=True, eq=False)
class Lens:
    """A pinhole with square pixels.

    Attributes:
        focal_px: focal length, px.
        middle: float64[2], the principal point, px.
    """

    focal_px: float
    middle: FloatArray

    def seen_through(self, similarity: FloatArray) -> "Lens":
        """That of frames that are scaled and shifted, float64[3, 3]."""
        scale = float(similarity[0, 0])
        return Lens(self.focal_px * scale, self.middle * scale + similarity[:2, 2])

    def rays(self, cameras: FloatArray) -> FloatArray:
        """Plane to directions of view, float64[n, 3, 3], by homographies from the plane to pixels."""
        x, y = (self.middle / self.focal_px).tolist()
        scale = 1 / self.focal_px
        inverse = np.array([[scale, 0, -x], [0, scale, -y], [0, 0, 1]])
        return np.asarray(inverse @ cameras)

    def foot(self, camera: FloatArray) -> FloatArray:
        """The point of the plane below a camera, float64[2], by its homography from the plane to pixels.

        Raises:
            numpy.linalg.LinAlgError: the homography is singular.
        """
        rays = self.rays(camera)
        point = np.linalg.solve(rays, np.cross(rays[:, 0], rays[:, 1]))
        return np.asarray(point[:2] / point[2])

    def residuals(self, cameras: FloatArray) -> FloatArray:
        """Violations, float64[n, 4], in standard deviations, of what a camera does to a level plane.

        The first two columns of a homography, as directions of view, have the same length and are at right
        angles; their third elements are the camera's tilt.

        Source: Hartley and Zisserman, Multiple View Geometry, section 8.1.1; Zhang, A flexible new technique
        for camera calibration, PAMI 2000.
        """
        rays = self.rays(cameras)
        across, down = rays[:, :, 0], rays[:, :, 1]
        squares = (across**2).sum(axis=1), (down**2).sum(axis=1)
        size = (squares[0] + squares[1]) / 2
        shape = np.stack([(squares[0] - squares[1]) / 2, (across * down).sum(axis=1)]) / size
        tilt = np.stack([across[:, 2], down[:, 2]]) / np.sqrt(size)
        return np.concatenate([shape / _SHAPE_STD, tilt / _TILT_STD]).T

    def slopes(self, cameras: FloatArray) -> FloatArray:
        """float64[n, 4, 8], derivatives of the residuals by the homographies' first eight elements."""
        found = np.empty((len(cameras), 4, 8))
        before = self.residuals(cameras)
        for element in range(8):
            moved = cameras.copy()
            moved.reshape(-1, 9)[:, element] += _STEP
            found[:, :, element] = (self.residuals(moved) - before) / _STEP
        return found
