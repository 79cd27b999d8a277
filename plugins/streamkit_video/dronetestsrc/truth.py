"""Ground truth of a rendered frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from streamkit.geometry.homography import FloatArray
from streamkit.geometry.scaling import scale_boxes, scale_homographies, scale_points, scale_vectors

IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class TrueRegistration:
    """The exact homographies of a rendered frame; the ground is flat, so they hold for every ground pixel.

    Attributes:
        to_previous: float64[3, 3], maps pixels of this frame to the previous frame; identity on the first.
        to_reference: float64[3, 3], maps pixels of this frame to the first frame.
    """

    to_previous: FloatArray
    to_reference: FloatArray

    def scaled(self, scaling: FloatArray, previous_scaling: FloatArray) -> TrueRegistration:
        """The truth of the scaled frame; both float64[3, 3], of this frame and of the previous one."""
        return TrueRegistration(
            *scale_homographies(scaling, previous_scaling, self.to_previous, self.to_reference)
        )


@dataclass(frozen=True, slots=True, eq=False)
class TrueTargets:
    """The cars of a rendered frame, one row each, in order of their ids.

    Only fully visible cars are included: all four corners of the body's rectangle lie between the centres of
    the frame's border pixels. Shadows do not count; a car occluded by another one is included.

    Attributes:
        ids: int64[n], constant over the frames.
        centres: float64[n, 2], x y of the body, px of this frame.
        lengths: float64[n], px of this frame.
        widths: float64[n], px of this frame.
        angles: float64[n], direction of travel, rad from +x towards +y, in -pi to pi.
        velocities: float64[n, 2], motion over the ground in px/s along this frame's axes, without the motion
            of the camera.
    """

    ids: IntArray
    centres: FloatArray
    lengths: FloatArray
    widths: FloatArray
    angles: FloatArray
    velocities: FloatArray

    def __len__(self) -> int:
        return len(self.ids)

    def scaled(self, scaling: FloatArray) -> TrueTargets:
        """The truth of the frame that an affine homography makes of this one, float64[3, 3]."""
        boxes = scale_boxes(scaling, self.lengths, self.widths, self.angles)
        velocities = scale_vectors(scaling, self.velocities)
        return TrueTargets(self.ids, scale_points(scaling, self.centres), *boxes, velocities)
