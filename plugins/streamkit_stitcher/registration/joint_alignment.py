"""Joint alignment: one homography aligns all patches of a keyframe with a frame."""

import math
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import FloatArray, GreyArray, MaskArray, corners, inverse, project
from streamkit_stitcher.registration.gauss_newton import Scaling, worst_deviation
from streamkit_stitcher.registration.patch_steps import improve, settle
from streamkit_stitcher.registration.patches import PatchLevel, prepare

_PASSES: Final = 3
_SETTLED: Final = 0.3
_WILD: Final = 10.0


@dataclass(frozen=True, eq=False)
class JointLevel:
    """Patches of one pyramid level, in an order whose every leading part covers the whole frame.

    Attributes:
        patches: the patches.
        numbers: int64[n], their numbers in the keyframe.
        scaling: of their centres.
    """

    patches: PatchLevel
    numbers: npt.NDArray[np.int64]
    scaling: Scaling

    def without(self, left_out: MaskArray) -> "JointLevel":
        """Marks patches as not usable, bool[n]."""
        return replace(self, patches=replace(self.patches, usable=self.patches.usable & ~left_out))

    def part(self, chosen: npt.NDArray[np.int64]) -> "JointLevel":
        """Some of the patches, by their indices."""
        return JointLevel(self.patches.part(chosen), self.numbers[chosen], self.scaling)


def spread_order(count: int) -> npt.NDArray[np.int64]:
    """The numbers below `count`, each leading part evenly spread, int64[count].

    Source: van der Corput, Verteilungsfunktionen, 1935.
    """
    numbers, reversed_bits = np.arange(count), np.zeros(count, dtype=np.int64)
    for bit in range(max(1, count - 1).bit_length()):
        reversed_bits = reversed_bits << 1 | numbers >> bit & 1
    return np.argsort(reversed_bits, kind="stable")


def joint_level(patches: GreyArray, centres: FloatArray, numbers: npt.NDArray[np.int64]) -> JointLevel:
    """Prepares n >= 1 patches from `cut_patches`, their centres, and their numbers in the keyframe."""
    return JointLevel(prepare(patches, centres), numbers, Scaling.of(centres))


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
    level: JointLevel, image: GreyArray, key_to_frame: FloatArray, count: int, passes: int, settled: float
) -> FloatArray | None:
    """Improves a predicted motion until it converges, else None.

    Args:
        level: patches of the keyframe.
        image: the frame at the same reduction.
        key_to_frame: prediction, right to a few px of this level.
        count: number of leading patches to use.
        passes: most iterations.
        settled: largest displacement of a patch in the last iteration.
    """
    patches, matrix = level.patches.part(slice(count)), key_to_frame.copy()
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
    level: JointLevel, image: GreyArray, key_to_frame: FloatArray, threshold: float
) -> JointAlignment | None:
    """Aligns the keyframe with a frame, to a few hundredths of a pixel; None without convergence.

    Each patch is compared with the frame through the homography's local affine part; the homography minimises
    all differences, weighted by each patch's contrast and correlation in both directions. Outliers such as
    cars are rejected while all patches have about equal weights: otherwise the corners of a few tall roofs,
    with more contrast than all the ground, would define the plane. `key_to_frame` must be right to about half
    a pixel; `threshold` is the largest residual of an inlier.

    Source: Baker and Matthews, Lucas-Kanade 20 years on, IJCV 2004, section 3.2 (inverse compositional).
    """
    patches, count, pixels = level.patches, len(level.numbers), np.ascontiguousarray(image)
    buffers = _Buffers(
        key_to_frame.copy(),
        np.empty((3, count)),
        np.empty((3, count)),
        np.empty((8, 8)),
        np.empty(count, dtype=np.bool_),
        np.empty(count, dtype=np.bool_),
    )
    for _ in range(_PASSES):
        size, visible_count, variance = improve(
            pixels,
            patches.centres,
            patches.probes,
            patches.usable,
            _numbers(level.scaling),
            patches.inverse_hessian,
            buffers.key_to_frame,
            buffers.products,
            buffers.information,
            buffers.normal,
            buffers.alike,
            buffers.near,
        )
        if size > _WILD:
            return None
        if size < _SETTLED:
            return _aligned(level, pixels, buffers, visible_count, variance, threshold)
    return None


@dataclass(frozen=True, eq=False)
class _Buffers:
    """Output arrays of `improve`, named as its arguments."""

    key_to_frame: FloatArray
    products: FloatArray
    information: FloatArray
    normal: FloatArray
    alike: MaskArray
    near: MaskArray


def _numbers(scaling: Scaling) -> FloatArray:
    return np.array([*scaling.middle, scaling.size])


def _aligned(
    level: JointLevel,
    image: GreyArray,
    buffers: _Buffers,
    visible_count: int,
    variance: float,
    threshold: float,
) -> JointAlignment:
    residuals, alike, near = buffers.products[:2], buffers.alike, buffers.near
    squares = np.einsum("in,in->n", residuals, residuals)
    agreeing = np.flatnonzero(alike & (squares < threshold**2))
    key_points = level.patches.centres[agreeing]
    xx, xy, yy = buffers.information[:, agreeing]
    solved, inverted = cv2.invert(buffers.normal, flags=cv2.DECOMP_CHOLESKY)
    covariance = np.asarray(inverted, dtype=np.float64)
    outline = project(inverse(buffers.key_to_frame), corners(image.shape[:2]))
    return JointAlignment(
        buffers.key_to_frame,
        key_points,
        project(buffers.key_to_frame, key_points + residuals[:, agreeing].T),
        level.numbers[agreeing],
        np.where(near[agreeing], (xx + yy) / (xx * yy - xy * xy), np.inf),
        math.sqrt(float(squares[agreeing].sum()) / max(1, len(agreeing))),
        int(np.count_nonzero(alike)),
        visible_count,
        worst_deviation(covariance, level.scaling, outline, variance) if solved else math.inf,
        level.numbers[alike & ~near],
        level.numbers[alike & near],
    )
