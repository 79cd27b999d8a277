"""All patches of a keyframe aligned at once: the homography that suits them, in a few passes."""

import math
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import FloatArray, GreyArray, MaskArray, corners, inverse, project
from streamkit_stitcher.registration.gauss_newton import Scaling, monomials
from streamkit_stitcher.registration.joint_level import JointLevel
from streamkit_stitcher.registration.patch_steps import improve, settle

_PASSES: Final = 3
_SETTLED: Final = 0.3
_WILD: Final = 10.0
# How the eight parameters of a homography near the identity move a point in x and in y, by its monomials.
_ACROSS: Final[FloatArray] = np.zeros((8, 6))
_ACROSS[[0, 1, 2, 6, 7], [3, 4, 5, 0, 1]] = 1, 1, 1, -1, -1
_DOWN: Final[FloatArray] = np.zeros((8, 6))
_DOWN[[3, 4, 5, 6, 7], [3, 4, 5, 1, 2]] = 1, 1, 1, -1, -1


@dataclass(frozen=True, eq=False)
class JointAlignment:
    """A keyframe found in a frame.

    Attributes:
        key_to_frame: float64[3, 3], px of the level.
        key_points: float64[k, 2], centres of the patches that look alike and lie where the homography tells,
            px of the keyframe.
        frame_points: float64[k, 2], where each of them lies in the frame.
        numbers: int64[k], which of the keyframe's patches they are.
        variances: float64[k], sum of those of a place's two coordinates, px squared; infinite for patches off
            the plane.
        rmse: root mean square distance of their places from those that the homography tells, px.
        compared: patches that look alike, k or more.
        sought: patches that should have been in view, as many or more.
        deviation: how far off the homography may put the worst corner of the frame on the keyframe, one
            standard deviation, px.
        likeness: median correlation of the patches where the homography tells, with the keyframe's.
        off_plane: int64[m], which patches look alike but do not lie where the homography tells, by more than
            their covariances allow: roofs, cars, what was brought by chance.
        on_plane: int64[l], which do.
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
    correlation: float
    off_plane: npt.NDArray[np.int64]
    on_plane: npt.NDArray[np.int64]


def align_coarsely(
    level: JointLevel,
    image: GreyArray,
    key_to_frame: FloatArray,
    count: int,
    passes: int,
    settled: float,
) -> FloatArray | None:
    """Improves a predicted motion until it hardly changes any more.

    Args:
        level: patches of the keyframe.
        image: uint8[h, w], the frame at the same reduction.
        key_to_frame: float64[3, 3], right to a few px of this level.
        count: of the first patches to use.
        passes: most passes.
        settled: the last change of a patch's place, px.

    Returns:
        float64[3, 3], or None where the patches are not seen or do not settle.
    """
    patches, matrix = level.patches.first(count), key_to_frame.copy()
    found = settle(
        np.ascontiguousarray(image),
        patches.centres,
        patches.probes,
        patches.usable,
        _numbers(level.scaling),
        passes,
        settled,
        matrix,
    )
    return matrix if found else None


def align_jointly(
    level: JointLevel,
    image: GreyArray,
    key_to_frame: FloatArray,
    threshold: float,
) -> JointAlignment | None:
    """Finds the keyframe in a frame, to a few hundredths of a pixel.

    Every patch is compared with the frame through the homography's local affine part; the homography moves to
    where all of them differ least, each counting by how well its contrast and likeness fix it in either
    direction. Patches that want to be elsewhere than the others, as cars do, are left out. Which do is told
    while every patch counts for about as much ground as any other: the corners of a few tall roofs, of more
    contrast than all the ground, would have the plane through the roofs otherwise.

    Args:
        level: patches of the keyframe.
        image: uint8[h, w], the frame.
        key_to_frame: float64[3, 3], right to about half a pixel.
        threshold: largest distance of a patch that agrees, px.

    Returns:
        The alignment, or None where the patches are not seen or do not settle.

    Source: Baker and Matthews, Lucas-Kanade 20 years on, IJCV 2004, section 3.2 (inverse compositional).
    """
    patches, count, frame = level.patches, len(level.numbers), np.ascontiguousarray(image)
    seen = _Seen(
        key_to_frame.copy(),
        np.empty((3, count)),
        np.empty((3, count)),
        np.empty((8, 8)),
        np.empty(count, dtype=np.bool_),
        np.empty(count, dtype=np.bool_),
    )
    for _ in range(_PASSES):
        size, visible_count, variance = improve(
            frame,
            patches.centres,
            patches.probes,
            patches.usable,
            _numbers(level.scaling),
            patches.inverse_hessian,
            seen.key_to_frame,
            seen.products,
            seen.information,
            seen.normal,
            seen.alike,
            seen.near,
        )
        if size > _WILD:
            return None
        if size < _SETTLED:
            return _aligned(level, frame, seen, visible_count, variance, threshold)
    return None


@dataclass(frozen=True, eq=False)
class _Seen:
    """What `improve` works on, and tells of the patches; the names are those of its arguments."""

    key_to_frame: FloatArray
    products: FloatArray
    information: FloatArray
    normal: FloatArray
    alike: MaskArray
    near: MaskArray


def _numbers(scaling: Scaling) -> FloatArray:
    return np.array([*scaling.middle, scaling.size])


def _aligned(
    level: JointLevel, image: GreyArray, seen: _Seen, visible_count: int, variance: float, threshold: float
) -> JointAlignment:
    residuals, alike, near = seen.products[:2], seen.alike, seen.near
    squares = np.einsum("in,in->n", residuals, residuals)
    agreeing = np.flatnonzero(alike & (squares < threshold**2))
    key_points = level.patches.centres[agreeing]
    xx, xy, yy = seen.information[:, agreeing]
    frame_to_key = inverse(seen.key_to_frame)
    return JointAlignment(
        seen.key_to_frame,
        key_points,
        project(seen.key_to_frame, key_points + residuals[:, agreeing].T),
        level.numbers[agreeing],
        np.where(near[agreeing], (xx + yy) / (xx * yy - xy * xy), np.inf),
        math.sqrt(float(squares[agreeing].sum()) / max(1, len(agreeing))),
        int(np.count_nonzero(alike)),
        visible_count,
        _deviation(seen.normal, variance, level.scaling, project(frame_to_key, corners(image.shape[:2]))),
        _median(seen.products[2, near]),
        level.numbers[alike & ~near],
        level.numbers[alike & near],
    )


def _median(values: FloatArray) -> float:
    return float(np.partition(values, len(values) // 2)[len(values) // 2])


def _deviation(normal: FloatArray, variance: float, scaling: Scaling, outline: FloatArray) -> float:
    """How far off a motion may put the worst of some points, float64[n, 2] px, one standard deviation, px."""
    solved, covariance = cv2.invert(normal, flags=cv2.DECOMP_CHOLESKY)
    if not solved:
        return math.inf
    powers = monomials((outline - scaling.middle) / scaling.size)
    slopes = np.concatenate([_ACROSS @ powers, _DOWN @ powers], axis=1)
    worst = float((slopes * (covariance @ slopes)).sum(axis=0).max()) * variance
    return math.sqrt(worst) if worst >= 0 else math.inf
