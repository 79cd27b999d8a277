"""Joint alignment: one homography aligns all patches of a keyframe with a frame."""

import math
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import FloatArray, GreyArray, corners, inverse, project
from streamkit_stitcher.registration.gauss_newton import scaling_of, worst_deviation
from streamkit_stitcher.registration.patch_steps import improve, settle
from streamkit_stitcher.registration.patches import PatchLevel

_PASSES: Final = 3
_SETTLED: Final = 0.3
_WILD: Final = 10.0


@dataclass(frozen=True, eq=False)
class JointAlignment:
    """A keyframe aligned with a frame.

    Attributes:
        key_to_frame: float64[3, 3], px of the level.
        key_points: float64[k, 2], centres of the correlated patches within the threshold, px of the keyframe.
        frame_points: float64[k, 2], their positions in the frame.
        numbers: int64[k], their numbers in the keyframe.
        variances: float64[k], sum of both coordinates' variances, px squared; infinite off the plane.
        rmse: root mean square residual, px.
        compared: number of correlated patches, k or more.
        visible_count: number of patches in view, as many or more.
        deviation: standard deviation of the homography at the worst corner of the frame, px of the keyframe.
        off_plane: int64[m], correlated patches whose residuals exceed their covariances: roofs, cars.
        on_plane: int64[l], the other correlated patches.
    """

    key_to_frame: FloatArray
    key_points: FloatArray
    frame_points: FloatArray
    numbers: npt.NDArray[np.int64]
    variances: FloatArray
    rmse: float
    compared: int
    visible_count: int
    deviation: float
    off_plane: npt.NDArray[np.int64]
    on_plane: npt.NDArray[np.int64]


def align_coarsely(
    patches: PatchLevel, image: GreyArray, key_to_frame: FloatArray, most: int, passes: int, settled: float
) -> FloatArray | None:
    """Improves a predicted motion until it converges, else None.

    Args:
        patches: of the keyframe.
        image: the frame at the same reduction.
        key_to_frame: prediction, right to a few px of this level.
        most: leading patches that are used.
        passes: most iterations.
        settled: largest displacement of a patch in the last iteration.
    """
    if not len(patches.numbers):
        return None
    pixels, matrix = np.ascontiguousarray(image), key_to_frame.copy()
    centres, numbers, usable = patches.centres[:most], patches.numbers[:most], patches.usable[:most]
    scaling = scaling_of(centres)
    found = settle(pixels, centres, patches.probes, numbers, usable, scaling, passes, settled, matrix)
    return matrix if found else None


def align_jointly(
    patches: PatchLevel, image: GreyArray, key_to_frame: FloatArray, threshold: float
) -> JointAlignment | None:
    """Aligns the keyframe with a frame, to a few hundredths of a pixel; None without convergence.

    Each patch is compared with the frame through the homography's local affine part; the homography minimises
    all differences, weighted by each patch's contrast and correlation in both directions. Outliers such as
    cars are rejected while all patches have about equal weights: otherwise the corners of a few tall roofs,
    with more contrast than all the ground, would define the plane. `key_to_frame` must be right to about half
    a pixel; `threshold` is the largest residual of an inlier.

    Source: Baker and Matthews, Lucas-Kanade 20 years on, IJCV 2004, section 3.2 (inverse compositional).
    """
    pixels, scaling, matrix = np.ascontiguousarray(image), scaling_of(patches.centres), key_to_frame.copy()
    for _ in range(_PASSES):
        step = improve(
            pixels,
            patches.centres,
            patches.probes,
            patches.numbers,
            patches.usable,
            patches.inverse_hessian,
            scaling,
            matrix,
        )
        if step.size < _SETTLED or step.size > _WILD:
            break
    if not step.size < _SETTLED:
        return None
    residuals, correlated, on_plane = step.residuals, step.correlated, step.on_plane
    squares = np.einsum("in,in->n", residuals, residuals)
    agreeing = np.flatnonzero(correlated & (squares < threshold**2))
    key_points = patches.centres[agreeing]
    xx, xy, yy = step.information[:, agreeing]
    solved, covariance = cv2.invert(step.normal, flags=cv2.DECOMP_CHOLESKY)
    outline = project(inverse(matrix), corners(image.shape[:2]))
    return JointAlignment(
        matrix,
        key_points,
        project(matrix, key_points + residuals[:, agreeing].T),
        patches.numbers[agreeing],
        np.where(on_plane[agreeing], (xx + yy) / (xx * yy - xy * xy), np.inf),
        math.sqrt(float(squares[agreeing].sum()) / max(1, len(agreeing))),
        int(np.count_nonzero(correlated)),
        step.visible_count,
        worst_deviation(np.asarray(step.variance * covariance), scaling, outline) if solved else math.inf,
        patches.numbers[correlated & ~on_plane],
        patches.numbers[correlated & on_plane],
    )
