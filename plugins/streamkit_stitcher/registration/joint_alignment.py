"""All patches of a key picture aligned at once: the homography that suits them, in a few passes."""

import math
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from streamkit_stitcher.homographies import (
    FloatArray,
    GreyArray,
    MaskArray,
    corners,
    inverse,
    normalised,
    project,
    translation,
)
from streamkit_stitcher.registration.gauss_newton import Scaling, monomials
from streamkit_stitcher.registration.joint_level import ACROSS, DOWN, JointLevel, solved_step, step_matrix
from streamkit_stitcher.registration.patches import measure

_FAR: Final = 1.0
_FEWEST: Final = 10
_FAINT: Final = 0.2
_ALIKE: Final = 0.6
_TRIM: Final = 9.0
_PASSES: Final = 3
_SETTLED: Final = 0.3
_WILD: Final = 10.0
_CLOSE: Final = 0.3
# What no patch is better than, px: the lens, the shutter, the ground are not quite a plane's.
_FLOOR: Final = 0.04


@dataclass(frozen=True, eq=False)
class JointAlignment:
    """A key picture found in a frame.

    Attributes:
        key_to_frame: float64[3, 3], px of the level.
        key_points: float64[k, 2], centres of the patches that look alike and lie where the homography tells,
            px of the key picture.
        frame_points: float64[k, 2], where each of them lies in the frame.
        numbers: int64[k], which of the key picture's patches they are.
        variances: float64[k], sum of those of a place's two coordinates, px squared; infinite for patches off
            the plane.
        rmse: root mean square distance of their places from those that the homography tells, px.
        compared: patches that look alike, k or more.
        sought: patches that should have been in view, as many or more.
        deviation: how far off the homography may put the worst corner of the frame on the key picture, one
            standard deviation, px.
        likeness: median correlation of the patches where the homography tells, with the key picture's.
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
    sought: int
    deviation: float
    likeness: float
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
        level: patches of the key picture.
        image: uint8[h, w], the frame at the same reduction.
        key_to_frame: float64[3, 3], right to a few px of this level.
        count: of the first patches to use.
        passes: most passes.
        settled: the last change of a patch's place, px.

    Returns:
        float64[3, 3], or None where the patches are not seen or do not settle.
    """
    count = min(count, len(level.numbers))
    for _ in range(passes):
        step = _coarse_step(level, image, key_to_frame, count)
        if step is None or step[1] > _WILD:
            return None
        key_to_frame = normalised(key_to_frame @ step[0])
        if step[1] < settled:
            return key_to_frame
    return None


def align_jointly(
    level: JointLevel,
    image: GreyArray,
    key_to_frame: FloatArray,
    threshold: float,
) -> JointAlignment | None:
    """Finds the key picture in a frame, to a few hundredths of a pixel.

    Every patch is compared with the frame through the homography's local affine part; the homography moves to
    where all of them differ least, each counting by how well its contrast and likeness fix it in either
    direction. Patches that want to be elsewhere than the others, as cars do, are left out. Which do is told
    while every patch counts for about as much ground as any other: the corners of a few tall roofs, of more
    contrast than all the ground, would have the plane through the roofs otherwise.

    Args:
        level: patches of the key picture.
        image: uint8[h, w], the frame.
        key_to_frame: float64[3, 3], right to about half a pixel.
        threshold: largest distance of a patch that agrees, px.

    Returns:
        The alignment, or None where the patches are not seen or do not settle.

    Source: Baker and Matthews, Lucas-Kanade 20 years on, IJCV 2004, section 3.2 (inverse compositional).
    """
    for _ in range(_PASSES):
        step = _step(level, image, key_to_frame)
        if step is None or step.size > _WILD:
            return None
        key_to_frame = normalised(key_to_frame @ step.matrix)
        if step.size < _SETTLED:
            return _aligned(level, image, key_to_frame, step, threshold)
    return None


def _aligned(
    level: JointLevel, image: GreyArray, key_to_frame: FloatArray, step: "_Step", threshold: float
) -> JointAlignment:
    squares = _squares(step.residuals)
    agreeing = np.flatnonzero(step.alike & (squares < threshold**2))
    key_points = level.patches.centres[agreeing]
    xx, xy, yy = step.information[:, agreeing]
    return JointAlignment(
        key_to_frame,
        key_points,
        project(key_to_frame, key_points + step.residuals[:, agreeing].T),
        level.numbers[agreeing],
        np.where(step.near[agreeing], (xx + yy) / (xx * yy - xy * xy), np.inf),
        math.sqrt(float(squares[agreeing].sum()) / max(1, len(agreeing))),
        int(np.count_nonzero(step.alike)),
        step.sought,
        _deviation(step, level.scaling, inverse(key_to_frame), (image.shape[0], image.shape[1])),
        _median(step.correlation[step.near]),
        level.numbers[step.alike & ~step.near],
        level.numbers[step.alike & step.near],
    )


@dataclass(frozen=True, eq=False)
class _Step:
    """One improvement of the homography.

    Attributes:
        matrix: float64[3, 3], where the key picture's points should have been for the motion so far.
        size: the farthest it moves a patch in view, px.
        residuals: float64[2, n], where each patch is seen less where the homography tells now, px.
        information: float64[3, n], inverse covariance of each patch's place, see `_information`.
        correlation: float64[n], how much patches look like the key picture's, -1 to 1.
        alike: bool[n], patches in view that look like the key picture's.
        near: bool[n], patches where the homography tells, as far as their covariances allow.
        sought: patches in view.
        normal: float64[8, 8], of the equations; its inverse times `variance` is the parameters' covariance.
        variance: of a patch's place in units of what was expected.
    """

    matrix: FloatArray
    size: float
    residuals: FloatArray
    information: FloatArray
    correlation: FloatArray
    alike: MaskArray
    near: MaskArray
    sought: int
    normal: FloatArray
    variance: float


def _coarse_step(
    level: JointLevel, image: GreyArray, key_to_frame: FloatArray, count: int
) -> tuple[FloatArray, float] | None:
    """The step of the patches that move together, float64[3, 3], and the farthest it moves one, px."""
    shift, correlation, visible = measure(level.patches.first(count), image, key_to_frame)
    valid = visible & (correlation > _FAINT)
    found = int(np.count_nonzero(valid))
    if found < max(_FEWEST, int(np.count_nonzero(visible)) // 3):
        return None
    middle, near = _together(shift, valid, found)
    far = math.hypot(*middle.tolist())
    if far > _FAR:
        return translation(middle), far
    solved = solved_step(level, shift, correlation * near)
    if solved is None:
        return None
    parameters, moves, _ = solved
    return step_matrix(level.scaling, parameters), float(np.abs(moves[:, visible]).max())


def _step(level: JointLevel, image: GreyArray, key_to_frame: FloatArray) -> _Step | None:
    shift, correlation, visible = measure(level.patches, image, key_to_frame)
    alike = visible & (correlation > _ALIKE)
    sought = int(np.count_nonzero(visible))
    found = int(np.count_nonzero(alike))
    if found < max(_FEWEST, sought // 3):
        return None
    information = _information(level.patches.inverse_hessian, correlation)
    even = _evened(information, alike)
    near = _together(shift, alike, found)[1]
    solved = solved_step(level, shift, even * near)
    if solved is None:
        return None
    near = _near(_weighted_squares(shift - solved[1], information), alike)
    solved = solved_step(level, shift, information * near)
    if solved is None:
        return None
    parameters, moves, normal = solved
    apart = shift - moves
    freedom = max(1, 2 * int(np.count_nonzero(near)) - 8)
    return _Step(
        step_matrix(level.scaling, parameters),
        float(np.abs(moves[:, visible]).max()),
        apart,
        information,
        correlation,
        alike,
        near,
        sought,
        normal,
        float(_weighted_squares(apart, information)[near].sum()) / freedom,
    )


def _evened(information: FloatArray, alike: MaskArray) -> FloatArray:
    """How much patches count by inverse covariances float64[3, n], none more than the median of `alike`."""
    xx, xy, yy = information
    weights = (xx * yy - xy * xy) / (xx + yy)
    return np.asarray(np.minimum(weights, _median(weights[alike])))


def _near(squares: FloatArray, alike: MaskArray) -> MaskArray:
    """Which patches `alike` lie no farther off than most of them, by their squared distances."""
    return np.asarray(alike & (squares < _TRIM * _median(squares[alike])))


def _median(values: FloatArray) -> float:
    return float(np.partition(values, len(values) // 2)[len(values) // 2])


def _together(shift: FloatArray, chosen: MaskArray, count: int) -> tuple[FloatArray, MaskArray]:
    """The median shift of `count` chosen patches, float64[2], and which move about as it does, bool[n].

    A corner of the picture that moves by itself would bend a homography to it before it could be told apart.
    """
    middle = np.partition(shift[:, chosen], count // 2, axis=1)[:, count // 2]
    apart = shift - middle[:, np.newaxis]
    squares = _squares(apart)
    typical = _median(squares[chosen])
    return middle, chosen & (squares <= max(_TRIM * typical, _CLOSE**2))


def _information(inverse_hessian: FloatArray, correlation: FloatArray) -> FloatArray:
    """Inverse covariance of each patch's place, float64[3, n]: x x, x y, y y, 1 / px^2."""
    # Pictures of unit deviation that correlate by c differ by 2 - 2 c.
    noise = 2 * np.maximum(1 - correlation, 1e-3)
    information = inverse_hessian.reshape(-1, 4).T[[3, 1, 0]] * noise
    information[::2] += _FLOOR**2
    information /= information[0] * information[2] - information[1] * information[1]
    np.negative(information[1], out=information[1])
    return np.asarray(information, dtype=np.float64)


def _squares(apart: FloatArray) -> FloatArray:
    """Squared lengths of float64[2, n]."""
    return np.asarray(np.einsum("in,in->n", apart, apart))


def _weighted_squares(apart: FloatArray, information: FloatArray) -> FloatArray:
    x, y = apart
    return np.asarray((information[0] * x + 2 * information[1] * y) * x + information[2] * y * y)


def _deviation(step: _Step, scaling: Scaling, frame_to_key: FloatArray, shape: tuple[int, int]) -> float:
    solved, covariance = cv2.invert(step.normal, flags=cv2.DECOMP_CHOLESKY)
    if not solved:
        return math.inf
    outline = (project(frame_to_key, corners(shape)) - scaling.middle) / scaling.size
    powers = monomials(outline)
    slopes = np.concatenate([ACROSS @ powers, DOWN @ powers], axis=1)
    worst = float((slopes * (covariance @ slopes)).sum(axis=0).max()) * step.variance
    return math.sqrt(worst) if worst >= 0 else math.inf
