"""Sub-pixel alignment of small patches of a key picture in a later picture of the same ground."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from streamkit_stitcher.homographies import FloatArray, GreyArray, MaskArray, project, to_reduced

RADIUS: Final = 7
_SIDE: Final = 2 * RADIUS + 1
_ITERATIONS: Final = 6
_CONVERGED: Final = 0.1
_ENOUGH: Final = 0.85
_SETTLED: Final = 1.5
_MAX_SHIFT: Final = 4.0
_MIN_CONTRAST: Final = 2.0
_MIN_CORRELATION: Final = 0.6
_MOSTLY: Final = 0.7
_SingleArray = npt.NDArray[np.float32]
_OFFSETS: Final[_SingleArray] = np.stack(
    np.meshgrid(*2 * [np.arange(-RADIUS, RADIUS + 1, dtype=np.float32)])
).reshape(2, _SIDE * _SIDE)


def pyramid(images: Sequence[GreyArray], levels: int) -> tuple[GreyArray, ...]:
    """Continues a series of halvings of an image by block averages.

    Args:
        images: uint8[h, w] and the halvings there are already, one or more in all.
        levels: number of images to return.

    Returns:
        The image itself and its halvings, fewer where a side would fall below 1 px. An odd last row or column
        is dropped on the way, so that pixel x of level k stays at full-size x * 2**k + (2**k - 1) / 2.
    """
    result = list(images)
    while len(result) < levels and min(result[-1].shape) >= 2:
        result.append(halved(result[-1]))
    return tuple(result)


def halved(grey: GreyArray) -> GreyArray:
    """Averages 2 x 2 blocks of uint8[h, w, ...] into uint8[h // 2, w // 2, ...]."""
    height, width = grey.shape[0] // 2, grey.shape[1] // 2
    even = grey[: height * 2, : width * 2]
    return np.asarray(cv2.resize(even, (width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)


@dataclass(frozen=True, eq=False)
class PatchLevel:
    """Patches of one pyramid level, ready for alignment.

    Attributes:
        centres: float64[n, 2], patch centres in px of this level.
        probes: float32[n, 4, 225], what a sampled patch is multiplied with: x and y slopes of the key patch
            per px, the key patch itself with zero mean and unit deviation, and its mean.
        slope_sums: float64[n, 2], sums of the slopes.
        slope_products: float64[n, 2], products of the slopes with the key patch.
        inverse_hessian: float64[n, 2, 2], inverse of the slopes' normal matrix.
        usable: bool[n], patches with contrast in both directions.
    """

    centres: FloatArray
    probes: _SingleArray
    slope_sums: FloatArray
    slope_products: FloatArray
    inverse_hessian: FloatArray
    usable: MaskArray

    def part(self, chosen: npt.NDArray[np.int64]) -> "PatchLevel":
        """Some of the patches, by their indices."""
        return PatchLevel(
            self.centres[chosen],
            self.probes[chosen],
            self.slope_sums[chosen],
            self.slope_products[chosen],
            self.inverse_hessian[chosen],
            self.usable[chosen],
        )


def cut_patches(image: GreyArray, centres: FloatArray) -> GreyArray:
    """Samples 17 x 17 px around each centre.

    Args:
        image: uint8[h, w].
        centres: float64[n, 2], x y.

    Returns:
        uint8[n, 17, 17]; beyond the border the edge pixels repeat.
    """
    reach = np.arange(-RADIUS - 1, RADIUS + 2, dtype=np.float32)
    columns = centres[:, 0, np.newaxis, np.newaxis] + reach[np.newaxis, np.newaxis, :]
    rows = centres[:, 1, np.newaxis, np.newaxis] + reach[np.newaxis, :, np.newaxis]
    columns, rows = np.broadcast_arrays(columns, rows)
    side = len(reach)
    sampled = cv2.remap(
        image,
        columns.reshape(-1, side * side).astype(np.float32),
        rows.reshape(-1, side * side).astype(np.float32),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return np.asarray(sampled, dtype=np.uint8).reshape(-1, side, side)


def prepare(patches: GreyArray, centres: FloatArray) -> PatchLevel:
    """Works out the slopes and normal matrices of patches once, for any number of alignments.

    Args:
        patches: uint8[n, 17, 17] from `cut_patches`.
        centres: float64[n, 2], their centres.

    Source: Baker and Matthews, Lucas-Kanade 20 years on, IJCV 2004, section 3.2 (inverse compositional).
    """
    grey = patches.astype(np.float32)
    inner = grey[:, 1:-1, 1:-1].reshape(len(grey), _SIDE * _SIDE)
    centred = inner - inner.mean(axis=1, keepdims=True)
    deviation = np.sqrt((centred**2).mean(axis=1, keepdims=True))
    scale = np.maximum(deviation, 1e-3)
    across = (grey[:, 1:-1, 2:] - grey[:, 1:-1, :-2]) / 2
    down = (grey[:, 2:, 1:-1] - grey[:, :-2, 1:-1]) / 2
    steepest = np.stack([across, down], axis=1).reshape(len(grey), 2, _SIDE * _SIDE) / scale[:, np.newaxis]
    hessian = np.einsum("nip,njp->nij", steepest, steepest).astype(np.float64)
    determinant = hessian[:, 0, 0] * hessian[:, 1, 1] - hessian[:, 0, 1] ** 2
    trace = hessian[:, 0, 0] + hessian[:, 1, 1]
    usable = (deviation[:, 0] > _MIN_CONTRAST) & (determinant > 0.01 * trace**2)
    hessian[~usable] = np.eye(2)
    appearance = centred / scale
    even = np.full((len(grey), 1, _SIDE * _SIDE), 1 / _SIDE**2, dtype=np.float32)
    probes = np.concatenate([steepest, appearance[:, np.newaxis], even], axis=1)
    products = np.einsum("nip,np->ni", steepest, appearance).astype(np.float64)
    sums = steepest.sum(axis=2).astype(np.float64)
    return PatchLevel(centres, probes.astype(np.float32), sums, products, np.linalg.inv(hessian), usable)


@dataclass(frozen=True, eq=False)
class Alignment:
    """Patches of a key picture that were found in a frame.

    Attributes:
        key_points: float64[k, 2], their positions in the key picture.
        frame_points: float64[k, 2], the same ground in the frame.
        patches: int64[k], their indices.
        variances: float64[k], of one coordinate of a position, px squared, by what is left of the difference
            of the pictures and by the contrast that fixes the position.
        sought: patches that should have been in view, k or more.
    """

    key_points: FloatArray
    frame_points: FloatArray
    patches: npt.NDArray[np.int64]
    variances: FloatArray
    sought: int


def align(
    level: PatchLevel, image: GreyArray, key_to_frame: FloatArray, tolerance: float = _CONVERGED
) -> Alignment:
    """Finds where patches of the key picture lie in a frame, to a few hundredths of a pixel.

    Each patch is compared with the frame resampled through the homography's local affine part, so rotation,
    scale and perspective cost no accuracy; brightness and contrast are normalised patch by patch.

    Args:
        level: patches of the key picture.
        image: uint8[h, w], the frame at the same reduction.
        key_to_frame: float64[3, 3], predicted motion in px of this level, right to about 3 px.
        tolerance: the last step that most patches may still make, px.

    Returns:
        The patches that converged.
    """
    visible = level.usable & _visible(project(key_to_frame, level.centres), image.shape)
    chosen = np.flatnonzero(visible)
    sought = len(chosen)
    if not sought:
        return Alignment(np.empty((0, 2)), np.empty((0, 2)), chosen, np.empty(0), 0)
    if len(chosen) < _MOSTLY * len(visible):
        level, visible = level.part(chosen), visible[chosen]
    else:
        # Copying most of the patches costs more than aligning the few that cannot be seen.
        chosen = np.arange(len(visible))
    shift, correlation, step = _iterate(level, image, key_to_frame, visible, tolerance)
    settled = visible & (step < _SETTLED * tolerance) & (correlation > _MIN_CORRELATION)
    good = settled & (np.hypot(shift[:, 0], shift[:, 1]) < _MAX_SHIFT)
    key_points = level.centres[good]
    # Pictures of unit deviation that correlate by c differ by 2 - 2 c.
    variances = (1 - correlation[good]) * np.trace(level.inverse_hessian[good], axis1=1, axis2=2)
    frame_points = project(key_to_frame, key_points + shift[good])
    return Alignment(key_points, frame_points, chosen[good], np.maximum(variances, 0.0), sought)


def _visible(points: FloatArray, shape: Sequence[int]) -> MaskArray:
    height, width = shape[0], shape[1]
    margin = RADIUS + 3
    inside = (points >= margin) & (points < (width - margin, height - margin))
    return np.asarray(inside.all(axis=1), dtype=np.bool_)


def _iterate(
    level: PatchLevel, image: GreyArray, key_to_frame: FloatArray, visible: MaskArray, tolerance: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Gauss-Newton on each patch's shift: (shift, correlation, size of the last step)."""
    places, local = _linearised(key_to_frame, level.centres)
    # Where the patches lie; their shifts go through the same local affine parts.
    spread = np.matmul(local.transpose(1, 0, 2), _OFFSETS)
    spread += places.T[:, :, np.newaxis]
    maps = spread
    shift = np.zeros((len(places), 2))
    enough = _ENOUGH * np.count_nonzero(visible)
    for _ in range(_ITERATIONS):
        sampled = cv2.remap(image, maps[0], maps[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        products, deviation = _probed(np.asarray(sampled, dtype=np.float32), level.probes)
        # The slopes times (sampled - mean) / deviation - key patch, without forming that difference.
        gradient = (products[:, :2] - products[:, 3:] * level.slope_sums) / deviation - level.slope_products
        update = np.einsum("nij,nj->ni", level.inverse_hessian, gradient)
        shift = np.minimum(np.maximum(shift - update, -2 * _MAX_SHIFT), 2 * _MAX_SHIFT)
        step = np.hypot(update[:, 0], update[:, 1])
        if np.count_nonzero(visible & (step < tolerance)) > enough:
            break
        maps = spread + np.einsum("nij,nj->in", local, shift.astype(np.float32))[:, :, np.newaxis]
    return shift, products[:, 2] / (_SIDE * _SIDE * deviation[:, 0]), step


def _probed(sampled: _SingleArray, probes: _SingleArray) -> tuple[FloatArray, FloatArray]:
    """Products with the probes, float64[n, 4], and the deviation of the samples, float64[n, 1]."""
    products = np.matmul(probes, sampled[:, :, np.newaxis])[:, :, 0].astype(np.float64)
    square = np.einsum("np,np->n", sampled, sampled)[:, np.newaxis] / sampled.shape[1]
    deviation = np.sqrt(np.maximum(square - products[:, 3:] ** 2, 1e-6))
    return products, deviation


def _linearised(matrix: FloatArray, points: FloatArray) -> tuple[_SingleArray, _SingleArray]:
    """Where a homography maps points, float32[n, 2], and its local affine parts there, float32[n, 2, 2]."""
    weights = points @ matrix[2, :2] + matrix[2, 2]
    mapped = project(matrix, points)
    numerator = matrix[np.newaxis, :2, :2] - mapped[:, :, np.newaxis] * matrix[np.newaxis, 2:, :2]
    local = numerator / weights[:, np.newaxis, np.newaxis]
    return mapped.astype(np.float32), local.astype(np.float32)


def reduced_motion(key_to_frame: FloatArray, level: int) -> FloatArray:
    """The full-size motion `key_to_frame` in px of pyramid level `level`."""
    return to_reduced(key_to_frame, 2**level)
