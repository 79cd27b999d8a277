"""A bundle adjustment's input, and its cost."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import FloatArray, MaskArray
from streamkit_stitcher.bundle_adjustment.lens import Lens

IndexArray = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class PlaneProblem:
    """Frames of a plane and their observations of its points.

    Attributes:
        cameras: float64[n, 3, 3], plane coordinates to pixels of each frame, last element 1.
        points: float64[m, 2], on the plane.
        camera_index: int64[k], the frame of each observation.
        point_index: int64[k], its point; at most one observation per frame and point.
        observed: float64[k, 2], its position in the frame, px.
        fixed: bool[n], frames that do not move: at least one, which is the gauge, unless the lens is known.
        lens: of all frames, which then see a level plane; None if unknown.
    """

    cameras: FloatArray
    points: FloatArray
    camera_index: IndexArray
    point_index: IndexArray
    observed: FloatArray
    fixed: MaskArray
    lens: Lens | None = None

    def check(self) -> None:
        """Checks sizes and indices.

        Raises:
            ValueError: sizes differ, an index is out of range, or no frame is fixed.
        """
        count = len(self.observed)
        if not (len(self.camera_index) == len(self.point_index) == count):
            raise ValueError(
                f"observations: {count} positions need as many camera and point indices, got "
                f"{len(self.camera_index)} and {len(self.point_index)}"
            )
        for name, index, limit in (
            ("camera_index", self.camera_index, len(self.cameras)),
            ("point_index", self.point_index, len(self.points)),
        ):
            if count and not (index.min() >= 0 and index.max() < limit):
                raise ValueError(f"{name} must lie in 0 to {limit - 1}, got {index.min()} to {index.max()}")
        has_gauge = self.fixed.any() or self.lens is not None
        if len(self.fixed) != len(self.cameras) or not has_gauge:
            raise ValueError(
                "fixed: one flag per camera, and at least one set: without a camera that holds still the "
                "plane may drift freely"
            )


def projected(cameras: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Projects points by a homography each: points, and the third homogeneous coordinate, float64[k]."""
    mapped = np.einsum("kij,kj->ki", cameras[:, :, :2], points) + cameras[:, :, 2]
    return mapped[:, :2] / mapped[:, 2:], mapped[:, 2]


def robust_cost(residuals: FloatArray, huber: float) -> tuple[float, FloatArray]:
    """Half the sum of Huber's function of residuals float64[k, 2], and their weights, float64[k].

    The cost grows linearly from a length of `huber` on.
    """
    lengths = np.hypot(*residuals.T)
    # The square up to `huber`; beyond, 2 huber |r| - huber^2.
    bounded = np.minimum(lengths, huber)
    return float((bounded * (lengths - 0.5 * bounded)).sum()), huber / np.maximum(lengths, huber)
