"""Sub-pixel alignment of small patches of a keyframe, one by one."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import FloatArray, GreyArray, project
from streamkit_stitcher.registration.patch_steps import search
from streamkit_stitcher.registration.patches import PatchLevel

_CONVERGED: Final = 0.1
_SETTLED: Final = 1.5
_MAX_SHIFT: Final = 4.0
_MIN_CORRELATION: Final = 0.6


@dataclass(frozen=True, eq=False)
class Alignment:
    """Patches of a keyframe found in a frame.

    Attributes:
        key_points: float64[k, 2], in the keyframe.
        frame_points: float64[k, 2], in the frame.
        patches: int64[k], their indices.
        variances: float64[k], of one coordinate of a position, px squared, by correlation and contrast.
        visible_count: number of patches in view, k or more.
    """

    key_points: FloatArray
    frame_points: FloatArray
    patches: npt.NDArray[np.int64]
    variances: FloatArray
    visible_count: int


def align(
    level: PatchLevel, image: GreyArray, key_to_frame: FloatArray, tolerance: float = _CONVERGED
) -> Alignment:
    """Aligns patches of the keyframe with a frame, to a few hundredths of a pixel.

    Each patch is compared with the frame resampled through the homography's local affine part; brightness
    and contrast are normalised patch by patch.

    Args:
        level: patches of the keyframe.
        image: the frame at the same reduction.
        key_to_frame: prediction in px of this level, right to about 3 px.
        tolerance: largest last step of most patches.
    """
    count = len(level.centres)
    shift, products = np.empty((count, 2)), np.empty((3, count))
    visible_count = search(
        np.ascontiguousarray(image),
        level.centres,
        level.probes,
        level.usable,
        key_to_frame,
        tolerance,
        2 * _MAX_SHIFT,
        shift,
        products,
    )
    correlation, step = products[2], np.hypot(products[0], products[1])
    good = (correlation > _MIN_CORRELATION) & (step < _SETTLED * tolerance)
    good &= np.hypot(shift[:, 0], shift[:, 1]) < _MAX_SHIFT
    # Images of unit deviation with correlation c differ by 2 - 2 c.
    variances = (1 - correlation[good]) * np.trace(level.inverse_hessian[good], axis1=1, axis2=2)
    key_points = level.centres[good]
    return Alignment(
        key_points,
        project(key_to_frame, key_points + shift[good]),
        np.flatnonzero(good),
        np.maximum(variances, 0.0),
        visible_count,
    )
