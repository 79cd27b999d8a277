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
from streamkit_stitcher.registration.gauss_newton import Scaling
from streamkit_stitcher.registration.patches import PatchLevel, measure, prepare

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
class JointLevel:
    """Patches of one pyramid level, each leading part of them spread over the whole picture.

    Attributes:
        patches: the patches.
        numbers: int64[n], which of the key picture's they are.
        scaling: of their centres.
        slopes: float64[8, 2, n], how far each parameter of a homography near the identity moves the centres
            in x and in y, in units of the scaling.
    """

    patches: PatchLevel
    numbers: npt.NDArray[np.int64]
    scaling: Scaling
    slopes: FloatArray


@dataclass(frozen=True, eq=False)
class JointAlignment:
    """A key picture found in a frame.

    Attributes:
        key_to_frame: float64[3, 3], px of the level.
        key_points: float64[k, 2], centres of the patches that look alike and lie where the homography tells,
            px of the key picture.
        frame_points: float64[k, 2], where each of them lies in the frame.
        numbers: int64[k], which of the key picture's patches they are.
        variances: float64[k], sum of those of a place's two coordinates, px squared.
        rmse: root mean square distance of their places from those that the homography tells, px.
        compared: patches that look alike, k or more.
        sought: patches that should have been in view, as many or more.
        deviation: how far off the homography may put the worst corner of the frame on the key picture, one
            standard deviation, px.
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


def spread_order(count: int) -> npt.NDArray[np.int64]:
    """The numbers below `count` so that each leading part is spread evenly over them all, int64[count].

    Source: van der Corput, Verteilungsfunktionen, 1935.
    """
    numbers, reversed_bits = np.arange(count), np.zeros(count, dtype=np.int64)
    for bit in range(max(1, count - 1).bit_length()):
        reversed_bits = reversed_bits << 1 | numbers >> bit & 1
    return np.argsort(reversed_bits, kind="stable")


def joint_level(patches: GreyArray, centres: FloatArray, numbers: npt.NDArray[np.int64]) -> JointLevel:
    """Prepares patches for any number of alignments.

    Args:
        patches: uint8[n, 17, 17] from `cut_patches`, n >= 1.
        centres: float64[n, 2], their centres, px of the level.
        numbers: int64[n], which of the key picture's patches they are.
    """
    scaling = Scaling.of(centres)
    slopes = _slopes((centres - scaling.middle) / scaling.size)
    return JointLevel(prepare(patches, centres), numbers, scaling, slopes)


def align_coarsely(
    level: JointLevel, image: GreyArray, key_to_frame: FloatArray, count: int, passes: int, settled: float
) -> FloatArray | None:
    """Improves a predicted motion until it hardly changes any more.

    Args:
        level: patches of the key picture.
        image: uint8[h, w], the frame at the same reduction.
        key_to_frame: float64[3, 3], right to a few px of this level.
        count: patches to use.
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
    level: JointLevel, image: GreyArray, key_to_frame: FloatArray, count: int, threshold: float
) -> JointAlignment | None:
    """Finds the key picture in a frame, to a few hundredths of a pixel.

    Every patch is compared with the frame through the homography's local affine part; the homography moves to
    where all of them differ least, each counting by how well its contrast and likeness fix it in either
    direction. Patches that want to be elsewhere than the others, as cars do, are left out.

    Args:
        level: patches of the key picture.
        image: uint8[h, w], the frame.
        key_to_frame: float64[3, 3], right to about half a pixel.
        count: patches to use.
        threshold: largest distance of a patch that agrees, px.

    Returns:
        The alignment, or None where the patches are not seen or do not settle.

    Source: Baker and Matthews, Lucas-Kanade 20 years on, IJCV 2004, section 3.2 (inverse compositional).
    """
    count = min(count, len(level.numbers))
    for _ in range(_PASSES):
        step = _step(level, image, key_to_frame, count)
        if step is None or step.size > _WILD:
            return None
        key_to_frame = normalised(key_to_frame @ step.matrix)
        if step.size < _SETTLED:
            return _aligned(level, image, key_to_frame, step, threshold)
    return None


def _aligned(
    level: JointLevel, image: GreyArray, key_to_frame: FloatArray, step: "_Step", threshold: float
) -> JointAlignment:
    squares = np.einsum("in,in->n", step.residuals, step.residuals)
    agreeing = np.flatnonzero(step.alike & (squares < threshold**2))
    key_points = level.patches.centres[agreeing]
    xx, xy, yy = step.information[:, agreeing]
    return JointAlignment(
        key_to_frame,
        key_points,
        project(key_to_frame, key_points + step.residuals[:, agreeing].T),
        level.numbers[agreeing],
        (xx + yy) / (xx * yy - xy * xy),
        math.sqrt(float(squares[agreeing].sum()) / max(1, len(agreeing))),
        int(np.count_nonzero(step.alike)),
        step.sought,
        _deviation(step, level.scaling, inverse(key_to_frame), (image.shape[0], image.shape[1])),
    )


@dataclass(frozen=True, eq=False)
class _Step:
    """One improvement of the homography.

    Attributes:
        matrix: float64[3, 3], where the key picture's points should have been for the motion so far.
        size: the farthest it moves a patch in view, px.
        residuals: float64[2, n], where each patch is seen less where the homography tells now, px.
        information: float64[3, n], inverse covariance of each patch's place, see `_information`.
        alike: bool[n], patches in view that look like the key picture's.
        sought: patches in view.
        normal: float64[8, 8], of the equations; its inverse times `variance` is the parameters' covariance.
        variance: of a patch's place in units of what was expected.
    """

    matrix: FloatArray
    size: float
    residuals: FloatArray
    information: FloatArray
    alike: MaskArray
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
    solved = _solved(level, shift, correlation * near)
    if solved is None:
        return None
    parameters, moves, _ = solved
    return _matrix(level.scaling, parameters), float(np.abs(moves[:, visible]).max())


def _step(level: JointLevel, image: GreyArray, key_to_frame: FloatArray, count: int) -> _Step | None:
    shift, correlation, visible = measure(level.patches.first(count), image, key_to_frame)
    alike = visible & (correlation > _ALIKE)
    sought = int(np.count_nonzero(visible))
    found = int(np.count_nonzero(alike))
    if found < max(_FEWEST, sought // 3):
        return None
    information = _information(level.patches.inverse_hessian[:count], correlation)
    _, near = _together(shift, alike, found)
    first = _solved(level, shift, information * near)
    if first is None:
        return None
    squares = _weighted_squares(shift - first[1], information)
    typical = float(np.partition(squares[alike], found // 2)[found // 2])
    kept = alike & (squares < _TRIM * typical)
    second = _solved(level, shift, information * kept)
    if second is None:
        return None
    parameters, moves, normal = second
    apart = shift - moves
    freedom = max(1, 2 * int(np.count_nonzero(kept)) - 8)
    return _Step(
        _matrix(level.scaling, parameters),
        float(np.abs(moves[:, visible]).max()),
        apart,
        information,
        alike,
        sought,
        normal,
        float(_weighted_squares(apart, information)[kept].sum()) / freedom,
    )


def _together(shift: FloatArray, chosen: MaskArray, count: int) -> tuple[FloatArray, MaskArray]:
    """The median shift of `count` chosen patches, float64[2], and which move about as it does, bool[n].

    A corner of the picture that moves by itself would bend a homography to it before it could be told apart.
    """
    middle = np.partition(shift[:, chosen], count // 2, axis=1)[:, count // 2]
    apart = shift - middle[:, np.newaxis]
    squares = np.einsum("in,in->n", apart, apart)
    typical = float(np.partition(squares[chosen], count // 2)[count // 2])
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


def _weighted_squares(apart: FloatArray, information: FloatArray) -> FloatArray:
    x, y = apart
    return np.asarray((information[0] * x + 2 * information[1] * y) * x + information[2] * y * y)


def _solved(
    level: JointLevel, shift: FloatArray, information: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """The step that suits shifts of the first patches best, by their inverse covariances.

    Args:
        level: the patches.
        shift: float64[2, n], px.
        information: float64[3, n], or float64[n] where it is the same in x and y.

    Returns:
        Its parameters float64[8], how it moves each of the patches float64[2, n], and the normal matrix.
    """
    count, size = shift.shape[1], level.scaling.size
    slopes = level.slopes[:, :, :count]
    weighted = slopes * information[::2] if information.ndim > 1 else slopes * information
    if information.ndim > 1:
        weighted += slopes[:, ::-1] * information[1]
    weighted, slopes = weighted.reshape(8, -1), slopes.reshape(8, -1)
    normal = weighted @ slopes.T
    wanted = weighted @ shift.reshape(-1, 1)
    solved, found = cv2.solve(normal, wanted / size, flags=cv2.DECOMP_CHOLESKY)
    if not solved:
        return None
    parameters = np.asarray(found[:, 0], dtype=np.float64)
    return parameters, ((parameters * size) @ slopes).reshape(2, count), normal


def _matrix(scaling: Scaling, parameters: FloatArray) -> FloatArray:
    """The homography near the identity of some parameters, in px."""
    step = np.eye(3)
    step.ravel()[:8] += parameters
    return scaling.forth @ step @ scaling.back


def _slopes(points: FloatArray) -> FloatArray:
    """How points float64[n, 2] move in x and in y with each parameter, float64[8, 2, n]."""
    x, y = points.T
    slopes = np.zeros((8, 2, len(points)))
    slopes[0, 0] = slopes[3, 1] = x
    slopes[1, 0] = slopes[4, 1] = y
    slopes[2, 0] = slopes[5, 1] = 1
    slopes[6] = -x * points.T
    slopes[7] = -y * points.T
    return slopes


def _deviation(step: _Step, scaling: Scaling, frame_to_key: FloatArray, shape: tuple[int, int]) -> float:
    solved, covariance = cv2.invert(step.normal, flags=cv2.DECOMP_CHOLESKY)
    if not solved:
        return math.inf
    outline = (project(frame_to_key, corners(shape)) - scaling.middle) / scaling.size
    slopes = _slopes(outline).reshape(8, -1)
    worst = float((slopes * (covariance @ slopes)).sum(axis=0).max()) * step.variance
    return math.sqrt(worst) if worst >= 0 else math.inf
