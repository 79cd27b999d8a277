"""The registration of one frame to the reference plane."""

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from streamkit.geometry.homography import IDENTITY, FloatArray, corners, scale_change
from streamkit.geometry.registration_status import RegistrationStatus

# Largest predicted error of a frame that is ok, px: 99.5 % are then within 2 px.
OK_STD: Final = 1.0
# Well within the limits of a mosaic, see `mosaic.is_paintable`.
_PLANE_SCALE: Final = (0.3, 3.3)
# Photographs that lean 12 degrees one way and the other, of a camera that sees 60 degrees.
_MAX_DEPTH_RATIO: Final = 1.75


@dataclass(frozen=True, eq=False)
class FrameRegistration:
    """The homographies of one frame.

    Attributes:
        to_previous: the frame to the previous frame of the stream.
        to_reference: the frame to the reference plane.
        reference: number of the reference plane; goes up with each restart and each change of the plane.
        status: how reliable the matrices are.
        reference_change: old plane to new where the plane moved under this frame, else None.
        keyframe: whether the frame became a keyframe.
        matches: points compared.
        inliers: matches that agree with the motion.
        rmse: root mean square residual of the inliers.
        corner_std: predicted error of `to_reference` at the worst corner, px, against its keyframe.
        measured: whether `to_reference` was measured against a keyframe.
        key_index: the keyframe it was measured against, or that it became.
        to_key: the frame to that keyframe.
        rebase: the part of `reference_change` that moves the whole plane to another reference keyframe, else
            None.
        opens_plane: whether the frame starts a plane that needs another mosaic, though `reference_change`
            relates them.
    """

    to_previous: FloatArray
    to_reference: FloatArray
    reference: int
    status: RegistrationStatus
    reference_change: FloatArray | None = None
    keyframe: bool = False
    matches: int = 0
    inliers: int = 0
    rmse: float = 0.0
    corner_std: float = 0.0
    measured: bool = False
    key_index: int = 0
    to_key: FloatArray = field(default_factory=lambda: IDENTITY)
    rebase: FloatArray | None = None
    opens_plane: bool = False


def depth_ratio(to_plane: FloatArray, shape: tuple[int, int]) -> float:
    """Ratio of the farthest to the nearest corner's depth; the frame is stretched by its square.

    1 for a camera that looks straight down on the plane; infinite where the horizon is in view.
    """
    depths = to_plane[2, :2] @ corners(shape).T + to_plane[2, 2]
    near, far = float(np.min(depths)), float(np.max(depths))
    return far / near if near > 0 else float("inf")


def is_stretched(to_plane: FloatArray, shape: tuple[int, int]) -> bool:
    """Whether the plane stretches a frame too much for a mosaic."""
    low, high = _PLANE_SCALE
    return not (
        depth_ratio(to_plane, shape) < _MAX_DEPTH_RATIO and low < scale_change(to_plane, shape) < high
    )
